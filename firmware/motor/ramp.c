/* SPDX-License-Identifier: Apache-2.0 */
#include "ramp.h"

void ramp_init(struct ramp *ramp)
{
    const struct ramp fresh = {.power = 0};
    *ramp = fresh;
}

static int16_t magnitude_of(int16_t power)
{
    return (int16_t)(power < 0 ? -power : power);
}

/* Whether a motor may have power in this direction; one that has it in the other loses it. */
static bool is_ready(struct ramp *ramp, bool is_reverse)
{
    if (is_reverse == ramp->is_reverse)
        return true;
    if (ramp->rested_ms < RAMP_REST_MS)
        return false;
    ramp->is_reverse = is_reverse;
    return true;
}

void ramp_step(struct ramp *ramp, int16_t wanted)
{
    if (ramp->power != 0)
        ramp->rested_ms = 0;
    else if (ramp->rested_ms < RAMP_REST_MS)
        ramp->rested_ms++;
    if (wanted == 0 || !is_ready(ramp, wanted < 0)) {
        ramp->power = 0;
        return;
    }
    const int16_t most = (int16_t)(magnitude_of(ramp->power) + RAMP_RISE);
    const int16_t magnitude = magnitude_of(wanted) < most ? magnitude_of(wanted) : most;
    ramp->power = (int16_t)(ramp->is_reverse ? -magnitude : magnitude);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "infrared.h"

#include "../link/streams.h"

#include <string.h>

void infrared_init(struct infrared *infrared)
{
    memset(infrared, 0, sizeof *infrared);
    infrared->told_ms = STREAM_INFRARED_MS;
}

bool infrared_tick(struct infrared *infrared, uint32_t now_ms)
{
    if (infrared->samples > 0)
        return now_ms - infrared->frame_ms >= (uint32_t)(infrared->samples * INFRARED_SPACING_MS);
    if (now_ms % INFRARED_PERIOD_MS != 0)
        return false;
    infrared->frame_ms = now_ms;
    return true;
}

static uint16_t middle(uint16_t a, uint16_t b, uint16_t c)
{
    const uint16_t low = a < b ? a : b;
    const uint16_t high = a < b ? b : a;
    if (c < low)
        return low;
    return c > high ? high : c;
}

bool infrared_add(struct infrared *infrared, const uint16_t counts[INFRARED_COUNT], struct infrared_payload *done,
                  uint32_t *done_ms)
{
    memcpy(infrared->readings[infrared->samples], counts, sizeof infrared->readings[0]);
    infrared->samples++;
    if (infrared->samples < INFRARED_SAMPLES)
        return false;
    infrared->samples = 0;
    for (uint8_t i = 0; i < INFRARED_COUNT; i++)
        done->counts[i] = middle(infrared->readings[0][i], infrared->readings[1][i], infrared->readings[2][i]);
    *done_ms = infrared->frame_ms;
    return infrared->frame_ms % infrared->told_ms == 0;
}

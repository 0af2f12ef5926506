/* SPDX-License-Identifier: Apache-2.0 */
#include "telemetry.h"

#include "../link/streams.h"

#define SECOND_MS 1000
#define BALANCE_AT 105 /* of its period, where that is longer */
#define POWER_AT 255
#define STATUS_AT 755
#define LAST_WORDS_AT 855 /* not with the status: each takes its time to encode */

void telemetry_init(struct telemetry *telemetry)
{
    telemetry->phase_ms = 0;
    telemetry->odometry_ms = STREAM_ODOMETRY_MS;
    telemetry->balance_ms = STREAM_BALANCE_MS;
    telemetry->state = UINT8_MAX; /* no state: the first one is told at once */
}

uint8_t telemetry_step(struct telemetry *telemetry, uint8_t state)
{
    const uint16_t phase = telemetry->phase_ms;
    uint8_t due = 0;
    if (phase % telemetry->odometry_ms == 0)
        due |= TELEMETRY_ODOMETRY;
    if (phase % telemetry->balance_ms == BALANCE_AT % telemetry->balance_ms || state != telemetry->state)
        due |= TELEMETRY_BALANCE;
    if (phase % SECOND_MS == POWER_AT)
        due |= TELEMETRY_POWER;
    if (phase % SECOND_MS == STATUS_AT)
        due |= TELEMETRY_STATUS;
    if (phase % SECOND_MS == LAST_WORDS_AT)
        due |= TELEMETRY_LAST_WORDS;
    telemetry->state = state;
    telemetry->phase_ms = (uint16_t)((phase + TELEMETRY_STEP_MS) % STREAMS_CYCLE_MS);
    return due;
}

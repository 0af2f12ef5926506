/* SPDX-License-Identifier: Apache-2.0 */
#include "streams.h"

#include "frame.h"

#define ON_LINE(payload) (FRAME_HEADER + sizeof(struct payload) + FRAME_CHECK + 2) /* COBS adds one, the delimiter too */
#define SECONDS (STREAMS_CYCLE_MS / 1000)
#define COMMANDS_PER_SECOND 10
#define FIXED (SECONDS * (2 * ON_LINE(status_payload) + ON_LINE(power_payload) + ON_LINE(last_words_payload) + \
               COMMANDS_PER_SECOND * ON_LINE(drive_payload)))

void streams_built_in(float *values)
{
    values[SETTING_ODOMETRY_MS] = STREAM_ODOMETRY_MS;
    values[SETTING_BALANCE_MS] = STREAM_BALANCE_MS;
    values[SETTING_SONAR_MS] = STREAM_SONAR_MS;
    values[SETTING_INFRARED_MS] = STREAM_INFRARED_MS;
}

bool streams_is_period(uint8_t stream, float period_ms)
{
    const uint16_t ms = (uint16_t)period_ms;
    const uint16_t step_ms = stream == SETTING_INFRARED_MS ? STREAM_INFRARED_MS : 5;
    return (float)ms == period_ms && ms != 0 && ms % step_ms == 0 && STREAMS_CYCLE_MS % ms == 0;
}

uint16_t streams_load(const float periods_ms[STREAM_COUNT])
{
    const uint8_t bytes[STREAM_COUNT] = {
        ON_LINE(odometry_payload), ON_LINE(balance_payload), ON_LINE(sonar_payload), ON_LINE(infrared_payload),
    };
    uint16_t load = FIXED;
    for (uint8_t i = 0; i < STREAM_COUNT; i++)
        load = (uint16_t)(load + bytes[i] * (STREAMS_CYCLE_MS / (uint16_t)periods_ms[i]));
    return load;
}

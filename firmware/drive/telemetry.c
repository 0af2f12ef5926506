/* SPDX-License-Identifier: Apache-2.0 */
#include "telemetry.h"

#define SECOND_MS 1000
#define ODOMETRY_MS 20
#define BALANCE_MS 500
#define BALANCE_AT 105
#define POWER_AT 255
#define STATUS_AT 755

void telemetry_init(struct telemetry *telemetry)
{
    telemetry->phase_ms = 0;
    telemetry->state = UINT8_MAX; /* no state: the first one is told at once */
}

uint8_t telemetry_step(struct telemetry *telemetry, uint8_t state)
{
    const uint16_t phase = telemetry->phase_ms;
    uint8_t due = 0;
    if (phase % ODOMETRY_MS == 0)
        due |= TELEMETRY_ODOMETRY;
    if (phase % BALANCE_MS == BALANCE_AT || state != telemetry->state)
        due |= TELEMETRY_BALANCE;
    if (phase == POWER_AT)
        due |= TELEMETRY_POWER;
    if (phase == STATUS_AT)
        due |= TELEMETRY_STATUS;
    telemetry->state = state;
    telemetry->phase_ms = (uint16_t)((phase + TELEMETRY_STEP_MS) % SECOND_MS);
    return due;
}

/* SPDX-License-Identifier: Apache-2.0
 *
 * When the drive board tells what: odometry every 20 ms, balance twice a second and at once when the state changes,
 * power and status once a second. The slow ones are spread over the second so that they never meet.
 */
#ifndef CRUNCH_DRIVE_TELEMETRY_H
#define CRUNCH_DRIVE_TELEMETRY_H

#include <stdint.h>

#define TELEMETRY_STEP_MS 5

enum telemetry_due { TELEMETRY_ODOMETRY = 1, TELEMETRY_BALANCE = 2, TELEMETRY_POWER = 4, TELEMETRY_STATUS = 8 };

struct telemetry {
    uint16_t phase_ms; /* within the second */
    uint8_t state;     /* last one told */
};

void telemetry_init(struct telemetry *telemetry);

/* One step of 5 ms; returns the set of frames due now. */
uint8_t telemetry_step(struct telemetry *telemetry, uint8_t state);

#endif

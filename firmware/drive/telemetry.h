/* SPDX-License-Identifier: Apache-2.0
 *
 * When the drive board tells what: odometry every 20 ms and balance twice a second if nothing else is set, balance also
 * at once when the state changes, power, status and last words once a second. The slow ones are spread over the second
 * so that they do not meet.
 */
#ifndef CRUNCH_DRIVE_TELEMETRY_H
#define CRUNCH_DRIVE_TELEMETRY_H

#include <stdint.h>

#define TELEMETRY_STEP_MS 5

enum telemetry_due {
    TELEMETRY_ODOMETRY = 1, TELEMETRY_BALANCE = 2, TELEMETRY_POWER = 4, TELEMETRY_STATUS = 8, TELEMETRY_LAST_WORDS = 16,
};

struct telemetry {
    uint16_t phase_ms; /* within STREAMS_CYCLE_MS */
    uint16_t odometry_ms, balance_ms; /* periods */
    uint8_t state;     /* last one told */
};

void telemetry_init(struct telemetry *telemetry);

/* One step of 5 ms; returns the set of frames due now. */
uint8_t telemetry_step(struct telemetry *telemetry, uint8_t state);

#endif

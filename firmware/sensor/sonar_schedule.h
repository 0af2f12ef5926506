/* SPDX-License-Identifier: Apache-2.0
 *
 * Which sonars fire when, and what a sweep heard. Two groups of four (0 2 4 6, then 1 3 5 7) fire one slot apart: each
 * of the eight speaks 12.5 times a second at most and no neighbours fire together. Pure: the caller fires and listens.
 */
#ifndef CRUNCH_SENSOR_SONAR_SCHEDULE_H
#define CRUNCH_SENSOR_SONAR_SCHEDULE_H

#include "../link/channels.h"

#include <stdbool.h>
#include <stdint.h>

#define SONAR_EVEN 0x55
#define SONAR_ODD 0xAA
#define SONAR_TIMEOUT_US 36000u /* later than this nothing can be an echo of this slot's ping */
#define SONAR_BLANK_US 170u     /* the burst still rings: 3 cm */

struct sonar_schedule {
    uint16_t period_ms; /* between sweeps */
    uint32_t sweep_ms; /* when the sweep's first slot fired */
    uint8_t listening; /* sonars that fired in this slot and have not heard yet */
    uint8_t slot;      /* 0 even, 1 odd */
    bool is_sweeping;
    bool has_swept;
    struct sonar_payload sweep;
};

void sonar_schedule_init(struct sonar_schedule *schedule);

/* Called every ms; returns the set of sonars to fire now. When a sweep is complete it is copied to `*done`, its first
 * slot's time to `*done_ms`, and `*is_done` is true. */
uint8_t sonar_schedule_tick(struct sonar_schedule *schedule, uint32_t now_ms, struct sonar_payload *done,
                            uint32_t *done_ms, bool *is_done);

/* The first echo after the blanking time counts; later ones, and those of sonars that did not fire, do not. */
void sonar_schedule_echo(struct sonar_schedule *schedule, uint8_t sonar, uint16_t echo_us);

#endif

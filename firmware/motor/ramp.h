/* SPDX-License-Identifier: Apache-2.0
 *
 * One motor's way from the power that it has to the one that is wanted, a ms at a time. Nothing measures the current,
 * so the power rises slowly: a motor that has not gathered speed draws the more the more it gets. It falls at once.
 * Who turns back rests first, so that neither both switches of a side of the bridge are ever closed nor the motor's
 * own voltage comes on top of the battery's.
 */
#ifndef CRUNCH_MOTOR_RAMP_H
#define CRUNCH_MOTOR_RAMP_H

#include <stdbool.h>
#include <stdint.h>

#define RAMP_RISE 40     /* of power in a ms: full in a quarter of a second */
#define RAMP_REST_MS 100 /* without power between forward and reverse */

struct ramp {
    int16_t power;     /* now, of MOTOR_FULL_POWER */
    bool is_reverse;   /* the direction that it has or had last */
    uint8_t rested_ms; /* since it had power; stays at RAMP_REST_MS */
};

/* No power, and no rest yet: a first reverse waits for it. */
void ramp_init(struct ramp *ramp);

/* One ms; 0 is no power at once. */
void ramp_step(struct ramp *ramp, int16_t wanted);

#endif

/* SPDX-License-Identifier: Apache-2.0
 *
 * What the motor board may do, and why it stopped.
 *
 * | state     | reason           | how it comes                                              | the motors            |
 * | disarmed  | boot or watchdog | a start                                                   | stand                 |
 * | armed     | none             | powers, unless the battery is empty                       | have them (ramp.h)    |
 * | disarmed  | command          | a stop                                                    | coast                 |
 * | link lost | link             | powers that were not told anew before their deadline      | coast                 |
 * | fault     | battery          | below 9.9 V for 1 s                                       | coast, whatever comes |
 * | disarmed  | battery          | above 10.5 V for 1 s: from now on powers move it again    | coast                 |
 *
 * A hang: the watchdog resets the board after 120 ms (avr/watchdog.h).
 */
#ifndef CRUNCH_MOTOR_SUPERVISOR_H
#define CRUNCH_MOTOR_SUPERVISOR_H

#include "command.h"

#define MOTOR_EMPTY_MV 9900   /* 3.3 V a cell */
#define MOTOR_RESTED_MV 10500 /* what an empty one shows without a load is less */
#define MOTOR_BATTERY_MS 1000

struct motor_supervisor {
    uint8_t state;        /* enum drive_state */
    uint8_t reason;       /* enum stop_reason of the last stop */
    uint8_t acknowledged; /* sequence of the last command accepted */
    uint16_t refused;     /* commands refused since boot; stays at its maximum */
    int16_t wanted[MOTORS];
    uint16_t left_ms;     /* until the deadline */
    uint16_t battery_ms;  /* that the battery has been other than it is taken for */
    bool is_empty;
};

/* Stands, for this reason. */
void motor_supervisor_init(struct motor_supervisor *supervisor, uint8_t reason);

/* Obeys a command, or counts it as refused. With an empty battery powers are acknowledged and move nothing. */
void motor_supervisor_obey(struct motor_supervisor *supervisor, const struct motor_command *command);

/* One step of 1 ms; `wanted` is 0 from the step on in which the motors are to stop. */
void motor_supervisor_step(struct motor_supervisor *supervisor, uint16_t battery_mv);

#endif

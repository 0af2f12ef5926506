/* SPDX-License-Identifier: Apache-2.0
 *
 * What the drive board may do, and why it stopped: the rules of safety, apart from the balance law.
 *
 * | hazard         | rule                                                                                    |
 * | arming         | asked for, held still for 1 s, then upright within 0.2 rad for 0.4 s; a stop, or 20 s   |
 * |                | of waiting, end the wish; never with a gyro whose zero cannot be, or that does not even |
 * |                | shiver (tilt.h), with an empty battery, at the charger, or while a motor is spared      |
 * | fall           | beyond 0.7 rad the motors are off in the same step; latched until armed again. Beyond   |
 * |                | 0.25 rad, too, where the motors are at their limit, or gyro at its own for 50 ms        |
 * | link lost      | 400 ms without a valid command: speed and turn to zero, balancing goes on               |
 * | stall          | a duty above 0.95 for 0.4 s: off                                                        |
 * | blocked wheel  | a duty above 0.3 for 0.4 s in all while its wheel stands still: off                     |
 * | picked up      | the wheels gain 0.6 m/s that the body does not (agreement.h), for 50 ms: off            |
 * | over-current   | a motor above 5 A for 20 ms: off. Above 3 A for 100 ms: both motors' duties are held    |
 * |                | down, by 4 a second, until it is not; they may rise again by 1 a second                 |
 * | battery        | below 24 V for 0.2 s no moves until it is above 25 V; charger connected: no moves       |
 * | sensor dead    | gyro or accelerometer at an end of the converter's range for 20 ms: off                 |
 * | sensors part   | gyro and accelerometer tell of 0.6 m/s that the wheels do not, for 50 ms: off           |
 * | hang           | the watchdog resets the board after 120 ms (avr/watchdog.h): off, disarmed; the next     |
 * |                | start tells its last words                                                              |
 */
#ifndef CRUNCH_DRIVE_SUPERVISOR_H
#define CRUNCH_DRIVE_SUPERVISOR_H

#include "agreement.h"
#include "command.h"

#define SUPERVISOR_STEP_MS 5
#define SUPERVISOR_LINK_MS 400
#define SUPERVISOR_FALL_TILT 0.7f /* rad */
#define SUPERVISOR_LOST_TILT 0.25f
#define SUPERVISOR_ARM_TILT 0.2f
#define SUPERVISOR_ARM_MS 400
#define SUPERVISOR_ARM_PATIENCE_MS 20000

struct drive_health { /* what one step of the loop knows */
    float tilt;
    float tilt_rate;
    bool is_rested;     /* the gyro's zero is known and the body is still */
    uint16_t rail_steps;
    enum accord accord;
    float duty[2];        /* left and right, magnitudes that the last step wanted, 0 to 1 */
    float wheel_speed[2]; /* magnitudes against the body, m/s */
    uint16_t battery_mv;
    uint16_t charger_mv;
    uint16_t motor_ma;  /* greater of the two magnitudes */
};

struct supervisor {
    uint8_t state;       /* enum drive_state */
    uint8_t reason;      /* enum stop_reason of the last stop */
    bool is_arm_wanted;
    uint8_t acknowledged; /* sequence of the last command accepted */
    uint16_t refused;     /* commands refused since boot; stays at its maximum */
    struct drive_wish wish;
    uint16_t silent_ms;  /* since the last valid command; stays at its maximum */
    uint16_t upright_ms; /* counters of conditions that must last */
    uint16_t wanted_ms;
    uint16_t saturated_ms;
    uint16_t tumbling_ms;
    uint16_t stuck_ms[2]; /* left and right */
    uint16_t discord_ms;
    uint16_t current_ms;
    uint16_t stay_ms;
    uint8_t stays;         /* enum stop_reason why it may not move; STOP_NONE if it may */
    uint8_t warm_steps;
    float ceiling; /* magnitude that no duty may exceed, 0 to 1 */
};

void supervisor_init(struct supervisor *supervisor);

/* Obeys a command, or counts it as refused. */
void supervisor_obey(struct supervisor *supervisor, const struct command *command);

/* Counts a command that was not worth obeying. */
void supervisor_refuse(struct supervisor *supervisor);

/* One step of 5 ms; returns true while the motors may run. */
bool supervisor_step(struct supervisor *supervisor, const struct drive_health *health);

/* What to drive now: the wish, or zero when nothing may move. */
struct drive_wish supervisor_wish(const struct supervisor *supervisor);

/* True while the robot balances. */
bool supervisor_is_balancing(const struct supervisor *supervisor);

#endif

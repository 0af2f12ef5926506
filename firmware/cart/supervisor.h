/* SPDX-License-Identifier: Apache-2.0
 *
 * Whether the cart may run, and why it stopped.
 *
 * | state     | reason           | how it comes                                                   | the cart             |
 * | disarmed  | boot or watchdog | a start                                                        | stands               |
 * | armed     | none             | a run's command, unless the battery is empty                   | runs (program.h)     |
 * | disarmed  | none             | the run's last bump                                            | stands               |
 * | disarmed  | command          | a stop                                                         | stands at once       |
 * | disarmed  | blocked          | CART_FAILED_DRIVES drives in a row that met nothing            | stands               |
 * | link lost | link             | a run on a leash, and no command for that long                 | stands at once       |
 * | fault     | battery          | below 6.0 V for 1 s                                            | stands, come what may |
 * | disarmed  | battery          | above 6.6 V for 1 s: from now on a command makes it run again  | stands               |
 *
 * A hang: the watchdog resets the board after 120 ms (avr/watchdog.h).
 */
#ifndef CRUNCH_CART_SUPERVISOR_H
#define CRUNCH_CART_SUPERVISOR_H

#include "command.h"

#define CART_EMPTY_MV 6000  /* six cells at 1.0 V */
#define CART_RESTED_MV 6600
#define CART_BATTERY_MS 1000
#define CART_FAILED_DRIVES 3 /* it is held, or lifted, or its bumper is broken */

struct cart_supervisor {
    uint8_t state;        /* enum drive_state */
    uint8_t reason;       /* enum stop_reason of the last stop */
    uint8_t acknowledged; /* sequence of the last command accepted */
    uint16_t refused;     /* commands refused since boot; stays at its maximum */
    uint32_t leash_ms;    /* 0: none */
    uint32_t silent_ms;   /* since the last command that was accepted */
    uint16_t battery_ms;  /* that the battery has been other than it is taken for */
    uint8_t failed;       /* drives in a row */
    bool is_empty;
};

/* Stands, for this reason. */
void cart_supervisor_init(struct cart_supervisor *supervisor, uint8_t reason);

/* Obeys a command, or counts it as refused. */
void cart_supervisor_obey(struct cart_supervisor *supervisor, const struct cart_command *command);

/* Takes note of a stage that ended, and whether it was the run's last. */
void cart_supervisor_note(struct cart_supervisor *supervisor, const struct cart_stage *ended, bool is_last);

/* One step of 1 ms. Only while it is armed may the cart run. */
void cart_supervisor_step(struct cart_supervisor *supervisor, uint16_t battery_mv);

#endif

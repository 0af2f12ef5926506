/* SPDX-License-Identifier: Apache-2.0
 *
 * The watchdog (120 ms), and what outlives a reset. The ATmega32's watchdog has no interrupt, so that a board's last
 * words must lie in memory that no start-up code clears, ready to be told by the next start.
 */
#ifndef CRUNCH_AVR_WATCHDOG_H
#define CRUNCH_AVR_WATCHDOG_H

#include "../link/teller.h"

struct last_words {
    uint8_t reset_cause;    /* MCUCSR at this start */
    uint16_t boot_count;    /* starts since power was switched on, this one included */
    uint16_t worst_loop_us; /* of the run before, to be kept up to date, */
    struct ending ending;   /* as this; all 0 after power-on */
};

/* What the last run left, renewed for this one. */
struct last_words *watchdog_last_words(void);

void watchdog_start(void);

/* Once per completed step, and nowhere else. */
void watchdog_pet(void);

#endif

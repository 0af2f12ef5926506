/* SPDX-License-Identifier: Apache-2.0 */
#include "watchdog.h"

#include <avr/io.h>
#include <avr/wdt.h>

#define KEPT 0x5AFEu

#define NOINIT __attribute__((section(".noinit")))
static uint16_t is_kept NOINIT; /* KEPT unless memory lost its power */
static struct last_words words NOINIT;

/* Runs before main, before memory is cleared: silicon leaves the watchdog on after it has bitten. */
void watchdog_early(void) __attribute__((naked, used, section(".init3")));
void watchdog_early(void)
{
    words.reset_cause = MCUCSR;
    MCUCSR = 0;
    wdt_disable();
}

struct last_words *watchdog_last_words(void)
{
    if (is_kept != KEPT || (words.reset_cause & (_BV(PORF) | _BV(BORF)))) {
        words.boot_count = 0;
        words.worst_loop_us = 0;
        words.ending = (struct ending){0};
    }
    is_kept = KEPT;
    words.boot_count++;
    return &words;
}

void watchdog_start(void)
{
    wdt_enable(WDTO_120MS);
}

void watchdog_pet(void)
{
    wdt_reset();
}

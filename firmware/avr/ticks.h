/* SPDX-License-Identifier: Apache-2.0
 *
 * The board's clock: Timer2 in CTC mode, 1 kHz. 16 MHz / 64 / 250; one count of the timer is 4 us.
 */
#ifndef CRUNCH_AVR_TICKS_H
#define CRUNCH_AVR_TICKS_H

#include <stdint.h>

/* Starts the clock; `each_ms` is called from the interrupt. */
void ticks_init(void (*each_ms)(void));

/* ms since the start. */
uint32_t ticks_ms(void);

/* us since the start, to 4 us; wraps at 65536. */
uint16_t ticks_us(void);

#endif

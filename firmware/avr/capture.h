/* SPDX-License-Identifier: Apache-2.0
 *
 * The sonars' triggers and echoes. PB0 triggers the even four, PB1 the odd four. A module holds its echo output high
 * from its burst to the echo; neighbours are OR-ed into four lines: ICP1 (PD6), INT0 (PD2), INT1 (PD3), INT2 (PB2).
 * Timer1 runs free at 0.5 us and is read at each falling edge: by the hardware on ICP1, by the interrupt on the
 * others, which is late by some us.
 */
#ifndef CRUNCH_AVR_CAPTURE_H
#define CRUNCH_AVR_CAPTURE_H

#include <stdbool.h>
#include <stdint.h>

#define CAPTURE_LINES 4
#define CAPTURE_MS 30 /* to be closed by then: Timer1 wraps after 32.7 ms, a module without echo gives up after 36 */

void capture_init(void);

/* Triggers one group and listens anew. */
void capture_fire(bool is_odd);

/* Nothing is heard until the next firing. */
void capture_close(void);

/* Takes one line's first echo since the firing, in us after it; false if there is no new one. */
bool capture_take(uint8_t *line, uint16_t *echo_us);

#endif

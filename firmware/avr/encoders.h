/* SPDX-License-Identifier: Apache-2.0
 *
 * The wheels' quadrature encoders: left A on INT0 (PD2) and B on PB0, right A on INT1 (PD3) and B on PB1. Each edge
 * of A counts one, so that 500 lines make the 1000 ticks of a turn.
 */
#ifndef CRUNCH_AVR_ENCODERS_H
#define CRUNCH_AVR_ENCODERS_H

#include <stdint.h>

void encoders_init(void);

/* Both counters at one moment; they wrap. */
void encoders_read(uint16_t *left, uint16_t *right);

#endif

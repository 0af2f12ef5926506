/* SPDX-License-Identifier: Apache-2.0
 *
 * Master of the two-wire bus: SCL on PC0, SDA on PC1, 400 kHz, pulled up outside. An interrupt moves each byte; nobody
 * waits for the bus, but for 0.1 ms where it hangs.
 */
#ifndef CRUNCH_AVR_TWI_H
#define CRUNCH_AVR_TWI_H

#include <stdint.h>

#define TWI_WRITTEN 2 /* at most, in one transfer */
#define TWI_READ 12

void twi_init(void);

/* Begins a transfer to a 7-bit address: writes some bytes, then reads some, which may be none. May be called from an
 * interrupt; nothing happens while one is under way. */
void twi_begin(uint8_t address, const uint8_t *bytes, uint8_t to_write, uint8_t to_read);

/* The bytes that the last transfer read, until the next begins; NULL if it failed, was never begun, or is not over: then
 * it is given up, and a part that still holds the data line is clocked until it lets go. */
const uint8_t *twi_end(void);

#endif

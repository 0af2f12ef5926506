/* SPDX-License-Identifier: Apache-2.0
 *
 * The EEPROM, byte by byte: the hardware writes one in 8.5 ms by itself while the program goes on. Addresses count from
 * the settings' record, which lies a few cells from the start: those are the first that a dip of the supply spoils.
 */
#ifndef CRUNCH_AVR_EEPROM_H
#define CRUNCH_AVR_EEPROM_H

#include <stdbool.h>
#include <stdint.h>

/* False while a byte is being written; only then may the others be called, or they wait for it. */
bool eeprom_is_free(void);

uint8_t eeprom_read(uint8_t at);

/* Begins to write a byte that differs. */
void eeprom_write(uint8_t at, uint8_t byte);

#endif

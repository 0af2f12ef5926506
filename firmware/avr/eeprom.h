/* SPDX-License-Identifier: Apache-2.0
 *
 * One record of at most 64 bytes near the start of the EEPROM: its length, its bytes, and a CRC-16 over both. An erased or
 * half-written record is none.
 */
#ifndef CRUNCH_AVR_EEPROM_H
#define CRUNCH_AVR_EEPROM_H

#include <stdbool.h>
#include <stdint.h>

#define EEPROM_MAX_RECORD 64

/* False, and `record` is as it was, unless the EEPROM holds a sound record of this size. */
bool eeprom_load(void *record, uint8_t size);

/* Takes up to 9 ms per byte that differs and pets the watchdog meanwhile: not to be called while balancing. */
void eeprom_store(const void *record, uint8_t size);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#include "eeprom.h"

#include <avr/eeprom.h>

#define FIRST 4

static uint8_t *cell(uint8_t at)
{
    return (uint8_t *)(uint16_t)(FIRST + at);
}

bool eeprom_is_free(void)
{
    return eeprom_is_ready();
}

uint8_t eeprom_read(uint8_t at)
{
    return eeprom_read_byte(cell(at));
}

void eeprom_write(uint8_t at, uint8_t byte)
{
    eeprom_write_byte(cell(at), byte);
}

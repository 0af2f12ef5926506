/* SPDX-License-Identifier: Apache-2.0 */
#include "eeprom.h"

#include "../link/crc.h"
#include "watchdog.h"

#include <avr/eeprom.h>
#include <string.h>

struct stored {
    uint8_t size;
    uint8_t bytes[EEPROM_MAX_RECORD];
    uint16_t crc;
};

#define AT ((uint8_t *)4) /* cells at the start are the first that a dip of the supply spoils */

static uint16_t crc_of(const struct stored *stored)
{
    uint16_t crc = crc16_update(CRC16_INITIAL, stored->size);
    for (uint8_t i = 0; i < stored->size; i++)
        crc = crc16_update(crc, stored->bytes[i]);
    return crc;
}

bool eeprom_load(void *record, uint8_t size)
{
    struct stored stored;
    eeprom_read_block(&stored, AT, sizeof stored);
    if (size > EEPROM_MAX_RECORD || stored.size != size || stored.crc != crc_of(&stored))
        return false;
    memcpy(record, stored.bytes, size);
    return true;
}

void eeprom_store(const void *record, uint8_t size)
{
    struct stored stored = {.size = size};
    if (size > EEPROM_MAX_RECORD)
        return;
    memcpy(stored.bytes, record, size);
    stored.crc = crc_of(&stored);
    const uint8_t *bytes = (const uint8_t *)&stored;
    for (uint8_t i = 0; i < sizeof stored; i++) {
        eeprom_update_byte(AT + i, bytes[i]);
        watchdog_pet();
    }
}

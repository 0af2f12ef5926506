/* SPDX-License-Identifier: Apache-2.0
 *
 * Says whether a record can be loaded: from an erased EEPROM, after it was stored, as one of another size, after one of
 * its bytes was spoiled; and once more the loaded bytes. */
#include "../../../firmware/avr/eeprom.h"

#include <avr/eeprom.h>
#include <avr/io.h>

static void say(uint8_t byte)
{
    while (!(UCSRA & _BV(UDRE)))
        ;
    UDR = byte;
}

int main(void)
{
    const uint8_t record[5] = {1, 0, 255, 3, 9};
    uint8_t loaded[5] = {0};
    UBRRL = 25;
    UCSRB = _BV(TXEN);
    say(eeprom_load(loaded, sizeof loaded));
    eeprom_store(record, sizeof record);
    say(eeprom_load(loaded, sizeof loaded));
    say(eeprom_load(loaded, 4));
    eeprom_write_byte((uint8_t *)7, 7);
    say(eeprom_load(loaded, sizeof loaded));
    for (uint8_t i = 0; i < sizeof loaded; i++)
        say(loaded[i]);
    for (;;)
        ;
}

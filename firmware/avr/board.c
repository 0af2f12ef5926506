/* SPDX-License-Identifier: Apache-2.0 */
#include "../link/board.h"

#include "eeprom.h"
#include "ticks.h"
#include "uart.h"

#include <avr/io.h>
#include <avr/sleep.h>

uint32_t board_ms(void)
{
    return ticks_ms();
}

uint16_t board_us(void)
{
    return ticks_us();
}

bool board_receive(uint8_t *byte)
{
    return uart_receive(byte);
}

bool board_is_sending(void)
{
    return uart_is_sending();
}

bool board_send_next(struct outbox *outbox)
{
    uint8_t frame[LINK_MAX_ENCODED];
    if (uart_is_sending())
        return false;
    const uint8_t size = outbox_take(outbox, frame);
    if (size > 0)
        uart_send(frame, size);
    return size > 0;
}

void board_note_loop(struct teller *teller, uint16_t start_us)
{
    const uint16_t loop_us = (uint16_t)(ticks_us() - start_us);
    if (loop_us > teller->worst_loop_us)
        teller->worst_loop_us = loop_us;
}

void board_load(uint8_t *record, uint8_t size)
{
    for (uint8_t at = 0; at < size; at++)
        record[at] = eeprom_read(at);
}

void board_keep(struct adjuster *adjuster, struct teller *teller)
{
    struct settings_work work;
    if (!settings_work(&adjuster->settings, &work) || !eeprom_is_free())
        return;
    if (!work.is_write)
        work.byte = eeprom_read(work.at);
    else if (eeprom_read(work.at) != work.byte)
        eeprom_write(work.at, work.byte);
    adjust_did(adjuster, teller, work.byte);
}

/* An interrupt just before the sleep is served late by the time to the next one: 1 ms at most, the clock's. */
void board_sleep(void)
{
    sleep_cpu();
}

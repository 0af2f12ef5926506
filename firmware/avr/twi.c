/* SPDX-License-Identifier: Apache-2.0 */
#include "twi.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdbool.h>
#include <stddef.h>
#include <util/delay.h>
#include <util/twi.h>

#define SCL _BV(PC0)
#define SDA _BV(PC1)
#define BIT_RATE 12 /* 16 MHz / (16 + 2 x 12) */
#define HALF_CLOCK_US 5
#define CLOCKS 9    /* free a part that is in the middle of a byte */
#define GO (_BV(TWINT) | _BV(TWEN) | _BV(TWIE))

enum { NOTHING, UNDER_WAY, DONE };

static volatile uint8_t state;       /* NOTHING to UNDER_WAY by twi_begin, on by the interrupt, reset by twi_end */
static uint8_t part;                 /* the address; from here on twi_begin's while nothing is under way, else the interrupt's */
static uint8_t written[TWI_WRITTEN], n_written, written_next;
static uint8_t read[TWI_READ], n_read, read_next;
static bool is_reading;

static void stop(uint8_t outcome)
{
    TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
    state = outcome;
}

/* The next byte to write, or whatever follows the last one. */
static void go_on(void)
{
    if (written_next < n_written) {
        TWDR = written[written_next++];
        TWCR = GO;
    } else if (n_read > 0) {
        is_reading = true;
        TWCR = GO | _BV(TWSTA);
    } else {
        stop(DONE);
    }
}

/* All bytes but the last are acknowledged. */
static void ask(void)
{
    TWCR = (uint8_t)(GO | (read_next + 1 < n_read ? _BV(TWEA) : 0));
}

ISR(TWI_vect)
{
    switch (TW_STATUS) {
    case TW_START:
    case TW_REP_START:
        TWDR = (uint8_t)(part << 1 | (is_reading ? TW_READ : TW_WRITE));
        TWCR = GO;
        break;
    case TW_MT_SLA_ACK:
    case TW_MT_DATA_ACK:
        go_on();
        break;
    case TW_MR_SLA_ACK:
        ask();
        break;
    case TW_MR_DATA_ACK:
        read[read_next++] = TWDR;
        ask();
        break;
    case TW_MR_DATA_NACK:
        read[read_next++] = TWDR;
        stop(DONE);
        break;
    default: /* nobody there, or somebody else's bits */
        stop(NOTHING);
    }
}

void twi_init(void)
{
    TWBR = BIT_RATE;
    TWCR = _BV(TWEN);
}

void twi_begin(uint8_t address, const uint8_t *bytes, uint8_t to_write, uint8_t to_read)
{
    if (state == UNDER_WAY || to_write > TWI_WRITTEN || to_read > TWI_READ)
        return;
    part = address;
    for (uint8_t i = 0; i < to_write; i++)
        written[i] = bytes[i];
    n_written = to_write;
    n_read = to_read;
    written_next = read_next = 0;
    is_reading = false;
    state = UNDER_WAY;
    TWCR = GO | _BV(TWSTA);
}

/* By hand: a line is pulled low or let go, never driven high. */
static void clock_free(void)
{
    PORTC &= (uint8_t)~(SCL | SDA);
    for (uint8_t i = 0; i < CLOCKS; i++) {
        DDRC |= SCL;
        _delay_us(HALF_CLOCK_US);
        DDRC &= (uint8_t)~SCL;
        _delay_us(HALF_CLOCK_US);
    }
}

const uint8_t *twi_end(void)
{
    const uint8_t outcome = state;
    if (outcome == UNDER_WAY) {
        TWCR = 0; /* the pins are the port's again */
        clock_free();
        twi_init();
    }
    state = NOTHING;
    return outcome == DONE ? read : NULL;
}

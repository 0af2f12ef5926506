/* SPDX-License-Identifier: Apache-2.0 */
#include "capture.h"

#include "../sensor/sonar_schedule.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>
#include <util/delay.h>

#define TRIGGER_EVEN _BV(PB0)
#define TRIGGER_ODD _BV(PB1)
#define TRIGGER_US 12
#define COUNTS_PER_US 2
#define BLANK_COUNTS (SONAR_BLANK_US * COUNTS_PER_US) /* a glitch of the trigger is no echo, and hides none */

static volatile uint16_t echoes[CAPTURE_LINES]; /* Timer1; each written by its interrupt only */
static volatile uint8_t waiting;                /* set of lines: filled with interrupts off, emptied by interrupts */
static volatile uint8_t heard;                  /* set of lines: filled by interrupts, emptied with interrupts off */
static uint16_t fired;                          /* Timer1 */

static inline void note(uint8_t line, uint16_t time)
{
    const uint8_t bit = (uint8_t)(1u << line);
    if (!(waiting & bit) || (uint16_t)(time - fired) < BLANK_COUNTS)
        return;
    waiting &= (uint8_t)~bit;
    echoes[line] = time;
    heard |= bit;
}

ISR(TIMER1_CAPT_vect)
{
    note(0, ICR1);
}

ISR(INT0_vect)
{
    note(1, TCNT1);
}

ISR(INT1_vect)
{
    note(2, TCNT1);
}

ISR(INT2_vect)
{
    note(3, TCNT1);
}

void capture_init(void)
{
    DDRB |= TRIGGER_EVEN | TRIGGER_ODD;
    TCCR1A = 0;
    TCCR1B = _BV(CS11); /* clock / 8; falling edge on ICP1 */
    MCUCR |= _BV(ISC01) | _BV(ISC11); /* falling edges; INT2's is its reset state */
    GIFR = _BV(INTF0) | _BV(INTF1) | _BV(INTF2);
    GICR |= _BV(INT0) | _BV(INT1) | _BV(INT2);
    TIMSK |= _BV(TICIE1);
}

void capture_fire(bool is_odd)
{
    const uint8_t trigger = is_odd ? TRIGGER_ODD : TRIGGER_EVEN;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        heard = 0;
        waiting = (1u << CAPTURE_LINES) - 1;
        PORTB |= trigger;
        fired = TCNT1;
    }
    _delay_us(TRIGGER_US);
    PORTB &= (uint8_t)~trigger;
}

void capture_close(void)
{
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) waiting = 0;
}

bool capture_take(uint8_t *line, uint16_t *echo_us)
{
    for (uint8_t i = 0; i < CAPTURE_LINES; i++) {
        const uint8_t bit = (uint8_t)(1u << i);
        if (!(heard & bit))
            continue;
        ATOMIC_BLOCK(ATOMIC_RESTORESTATE) heard &= (uint8_t)~bit;
        *line = i;
        *echo_us = (uint16_t)((uint16_t)(echoes[i] - fired) / COUNTS_PER_US);
        return true;
    }
    return false;
}

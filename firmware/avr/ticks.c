/* SPDX-License-Identifier: Apache-2.0 */
#include "ticks.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#define TOP 249
#define US_PER_COUNT 4u

static volatile uint32_t ms; /* written by the interrupt only */
static void (*on_ms)(void);

ISR(TIMER2_COMP_vect)
{
    ms++;
    on_ms();
}

void ticks_init(void (*each_ms)(void))
{
    on_ms = each_ms;
    OCR2 = TOP;
    TCCR2 = _BV(WGM21) | _BV(CS22); /* CTC, clock / 64 */
    TIMSK |= _BV(OCIE2);
}

uint32_t ticks_ms(void)
{
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) now = ms;
    return now;
}

uint16_t ticks_us(void)
{
    uint16_t whole;
    uint8_t count;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        whole = (uint16_t)ms;
        count = TCNT2;
        if (TIFR & _BV(OCF2)) { /* the ms is over, but not yet counted */
            whole++;
            count = TCNT2;
        }
    }
    return (uint16_t)(whole * 1000u + count * US_PER_COUNT);
}

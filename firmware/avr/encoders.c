/* SPDX-License-Identifier: Apache-2.0 */
#include "encoders.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdbool.h>
#include <util/atomic.h>

#define LEFT_A _BV(PD2)
#define RIGHT_A _BV(PD3)
#define LEFT_B _BV(PB0)
#define RIGHT_B _BV(PB1)

static volatile uint16_t left_ticks, right_ticks; /* each written by its interrupt only */

/* Forward, A leads B: after an edge of A the two differ. */
static uint16_t counted(uint16_t ticks, bool a, bool b)
{
    return (uint16_t)(a != b ? ticks + 1 : ticks - 1);
}

ISR(INT0_vect)
{
    left_ticks = counted(left_ticks, PIND & LEFT_A, PINB & LEFT_B);
}

ISR(INT1_vect)
{
    right_ticks = counted(right_ticks, PIND & RIGHT_A, PINB & RIGHT_B);
}

void encoders_init(void)
{
    PORTD |= LEFT_A | RIGHT_A; /* pull-ups for open collectors */
    PORTB |= LEFT_B | RIGHT_B;
    MCUCR |= _BV(ISC00) | _BV(ISC10); /* any edge */
    GIFR = _BV(INTF0) | _BV(INTF1);
    GICR |= _BV(INT0) | _BV(INT1);
}

void encoders_read(uint16_t *left, uint16_t *right)
{
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        *left = left_ticks;
        *right = right_ticks;
    }
}

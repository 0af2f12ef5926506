/* SPDX-License-Identifier: Apache-2.0 */
#include "pwm.h"

#include <avr/io.h>
#include <stdbool.h>

#define LEFT_FORWARD _BV(PD6)
#define RIGHT_FORWARD _BV(PD7)
#define BRAKE _BV(PC6)
#define LEFT_PWM _BV(PD5)
#define RIGHT_PWM _BV(PD4)

void pwm_init(void)
{
    PORTC |= BRAKE;
    DDRC |= BRAKE;
    DDRD |= LEFT_FORWARD | RIGHT_FORWARD | LEFT_PWM | RIGHT_PWM;
    ICR1 = PWM_FULL - 1;
    TCCR1A = _BV(WGM11);
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS10);
}

static uint16_t magnitude_of(int16_t duty)
{
    return (uint16_t)(duty < 0 ? -duty : duty);
}

static void point(uint8_t pin, bool is_forward)
{
    if (is_forward)
        PORTD |= pin;
    else
        PORTD &= (uint8_t)~pin;
}

void pwm_drive(int16_t left, int16_t right)
{
    const uint16_t left_on = magnitude_of(left), right_on = magnitude_of(right);
    point(LEFT_FORWARD, left >= 0);
    point(RIGHT_FORWARD, right >= 0);
    /* On for OCR1x + 1 counts: none at all is the pin's own low level. */
    if (left_on > 0)
        OCR1A = left_on - 1;
    if (right_on > 0)
        OCR1B = right_on - 1;
    TCCR1A = (uint8_t)(_BV(WGM11) | (left_on > 0 ? _BV(COM1A1) : 0) | (right_on > 0 ? _BV(COM1B1) : 0));
    PORTC &= (uint8_t)~BRAKE;
}

void pwm_off(void)
{
    TCCR1A = _BV(WGM11);
    PORTC |= BRAKE;
}

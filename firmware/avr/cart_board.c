/* SPDX-License-Identifier: Apache-2.0
 *
 * The bumper cart's board, an ATmega32 at 16 MHz. The bridge is a TB6612FNG: a motor whose two inputs differ turns while
 * its PWM is high and is shorted while it is low; with both inputs low it coasts, with both high it is shorted.
 *
 * | pins          | part                                                                             |
 * | PA3           | battery's voltage over 1:4                                                       |
 * | PB0, PB1      | encoders' B (encoders.h)                | PD2, PD3 encoders' A on INT0, INT1     |
 * | PB2, PB3, PB4 | bumper's left, middle and right switch to ground, with the chip's pull-ups       |
 * | PC0, PC1      | left motor forward and reverse: the bridge's AIN1, AIN2                          |
 * | PC6, PC7      | right motor forward and reverse: BIN1, BIN2                                      |
 * | PD5, PD4      | PWM of the left and the right motor, on OC1A, OC1B: PWMA, PWMB; pulled low       |
 * | PD0, PD1      | line to the host (uart.h)                                                        |
 *
 * Timer1 makes the PWM (mode 14, ICR1 on top) at 8 kHz; Timer2 is the clock; Timer0 is free.
 */
#include "../cart/board.h"

#include "adc.h"
#include "encoders.h"
#include "ticks.h"
#include "uart.h"
#include "watchdog.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#define SWITCHES (_BV(PB2) | _BV(PB3) | _BV(PB4))
#define LEFT_FORWARD _BV(PC0)
#define LEFT_REVERSE _BV(PC1)
#define RIGHT_FORWARD _BV(PC6)
#define RIGHT_REVERSE _BV(PC7)
#define LEFT_PWM _BV(PD5)
#define RIGHT_PWM _BV(PD4)
#define DIRECTIONS (LEFT_FORWARD | LEFT_REVERSE | RIGHT_FORWARD | RIGHT_REVERSE)
#define POWER_PER_COUNT 5
#define PWM_FULL (MOTOR_FULL_POWER / POWER_PER_COUNT)

enum { BATTERY = 3 };

static struct last_words *last_words;

static void bridge_init(void)
{
    PORTD &= (uint8_t)~(LEFT_PWM | RIGHT_PWM);
    DDRD |= LEFT_PWM | RIGHT_PWM;
    PORTC &= (uint8_t)~DIRECTIONS;
    DDRC |= DIRECTIONS;
    ICR1 = PWM_FULL - 1;
    TCCR1A = _BV(WGM11);
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS10);
}

struct boot board_init(void)
{
    bridge_init();
    last_words = watchdog_last_words();
    encoders_init();
    PORTB |= SWITCHES;
    uart_init();
    adc_init(BATTERY_READINGS);
    ticks_init(adc_sweep);
    MCUCR |= _BV(SE); /* idle: the only mode in which all parts go on */
    watchdog_start();
    sei();
    const struct boot boot = {
        .reset_cause = last_words->reset_cause, .count = last_words->boot_count, .build = BUILD,
        .worst_loop_us = last_words->worst_loop_us,
    };
    return boot;
}

bool board_battery(uint16_t *sum)
{
    uint16_t sums[ADC_CHANNELS];
    if (!adc_take(sums))
        return false;
    *sum = sums[BATTERY];
    return true;
}

void board_sense(struct cart_sensed *sensed)
{
    encoders_read(&sensed->ticks[0], &sensed->ticks[1]);
    sensed->bumper = (uint8_t)((~PINB & SWITCHES) >> PB2); /* left, middle, right: as in program.h */
}

static uint16_t counts_of(int16_t power)
{
    return (uint16_t)((power < 0 ? -power : power) / POWER_PER_COUNT);
}

static uint8_t pins_of(int16_t power, uint8_t forward, uint8_t reverse)
{
    if (power == 0)
        return forward | reverse;
    return power > 0 ? forward : reverse;
}

void board_drive(int16_t left, int16_t right)
{
    const uint16_t left_on = counts_of(left), right_on = counts_of(right);
    /* On for OCR1x + 1 counts: none at all is the pin's own low level. */
    OCR1A = left_on > 0 ? left_on - 1 : 0;
    OCR1B = right_on > 0 ? right_on - 1 : 0;
    const uint8_t pins = pins_of(left, LEFT_FORWARD, LEFT_REVERSE) | pins_of(right, RIGHT_FORWARD, RIGHT_REVERSE);
    PORTC = (uint8_t)((PORTC & ~DIRECTIONS) | pins);
    TCCR1A = (uint8_t)(_BV(WGM11) | (left_on > 0 ? _BV(COM1A1) : 0) | (right_on > 0 ? _BV(COM1B1) : 0));
}

void board_pet(uint16_t worst_loop_us)
{
    last_words->worst_loop_us = worst_loop_us;
    watchdog_pet();
}

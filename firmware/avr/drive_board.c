/* SPDX-License-Identifier: Apache-2.0
 *
 * The drive board on an ATmega32 at 16 MHz.
 *
 * | pins       | part                                                                                   |
 * | PA0        | gyro (ADXRS150), 2.5 V at rest, 12.5 mV per deg/s, forward fall positive               |
 * | PA1, PA2   | accelerometer (ADXL203) forward and upward, 2.5 V at 0 g, 1 V per g; upward not used    |
 * | PA3, PA4   | battery: voltage over 1:8; current by Hall sensor, 2.5 V at rest, 100 mV per A         |
 * | PA5        | charger's voltage over 1:8                                                             |
 * | PA6, PA7   | current sense of the left and right bridge, 2.2 kohm                                   |
 * | PB0, PB1   | encoders' B (encoders.h)              | PD2, PD3 encoders' A on INT0, INT1             |
 * | PD6, PD7   | bridges' direction (pwm.h)            | PD4, PD5 bridges' PWM on OC1B, OC1A            |
 * | PC6        | bridges' BRAKE                        | PC7      GRANT to the sensor board, pulled low |
 * | PD0, PD1   | modem (uart.h)                        | PC0, PC1 the bus of another IMU (twi.h)        |
 *
 * Timer1 makes the PWM, Timer2 the clock; Timer0 is free.
 */
#include "../drive/board.h"

#include "adc.h"
#include "encoders.h"
#include "imu.h"
#include "pwm.h"
#include "ticks.h"
#include "uart.h"
#include "watchdog.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#define GRANT _BV(PC7)

enum { BATTERY = 3, CURRENT, CHARGER, LEFT_MOTOR, RIGHT_MOTOR };

_Static_assert(TILT_OVERSAMPLING == POWER_READINGS, "one converter sums for both");

static struct last_words *last_words;
static bool is_reverse[2];

static void each_ms(void)
{
    adc_sweep();
    imu_tick();
}

struct boot board_init(void)
{
    last_words = watchdog_last_words();
    pwm_init();
    DDRC |= GRANT;
    encoders_init();
    uart_init();
    adc_init(TILT_OVERSAMPLING);
    imu_init();
    ticks_init(each_ms);
    MCUCR |= _BV(SE); /* idle: the only mode in which all parts go on */
    watchdog_start();
    sei();
    const struct boot boot = {
        .reset_cause = last_words->reset_cause, .count = last_words->boot_count, .build = BUILD,
        .worst_loop_us = last_words->worst_loop_us, .ending = last_words->ending,
    };
    return boot;
}

bool board_sample(struct drive_samples *samples)
{
    uint16_t sums[ADC_CHANNELS];
    if (!adc_take(sums))
        return false;
    const struct supply_sums supplies = {
        .battery = sums[BATTERY], .current = sums[CURRENT], .charger = sums[CHARGER],
        .motors = {sums[LEFT_MOTOR], sums[RIGHT_MOTOR]},
    };
    samples->inertial = imu_sums(sums);
    samples->supplies = power_supplies(&supplies, is_reverse);
    encoders_read(&samples->left_ticks, &samples->right_ticks);
    return true;
}

static int16_t counts_of(float duty)
{
    return (int16_t)(duty * (float)PWM_FULL);
}

void board_drive(const struct duties *duties)
{
    is_reverse[0] = duties->left < 0.0f;
    is_reverse[1] = duties->right < 0.0f;
    pwm_drive(counts_of(duties->left), counts_of(duties->right));
}

void board_motors_off(void)
{
    pwm_off();
}

void board_grant(bool is_granted)
{
    if (is_granted)
        PORTC |= GRANT;
    else
        PORTC &= (uint8_t)~GRANT;
}

void board_pet(uint16_t worst_loop_us, const struct ending *ending)
{
    last_words->worst_loop_us = worst_loop_us;
    last_words->ending = *ending;
    watchdog_pet();
}

/* SPDX-License-Identifier: Apache-2.0
 *
 * The sensor board on an ATmega32 at 16 MHz.
 *
 * | pins               | part                                                                    |
 * | PA0 to PA7         | GP2D12 infra-red sensors 0 to 7                                         |
 * | PB0, PB1           | triggers of the even and the odd sonars (capture.h)                     |
 * | PD6, PD2, PD3, PB2 | echoes of sonars 0 or 1, 2 or 3, 4 or 5, 6 or 7: ICP1, INT0, INT1, INT2 |
 * | PD7                | GRANT from the drive board                                              |
 * | PD0, PD1           | modem (uart.h)                                                          |
 *
 * Timer1 times the echoes, Timer2 is the clock; Timer0 is free.
 */
#include "../sensor/board.h"

#include "adc.h"
#include "capture.h"
#include "ticks.h"
#include "uart.h"
#include "watchdog.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#define GRANT _BV(PD7)

_Static_assert(BOARD_LISTEN_MS <= CAPTURE_MS, "Timer1 wraps");
_Static_assert(INFRARED_COUNT == ADC_CHANNELS, "one input each");
_Static_assert(SENSOR_ECHO_LINES == CAPTURE_LINES, "one input each");

static struct last_words *last_words;

static void nothing(void)
{
}

struct boot board_init(void)
{
    last_words = watchdog_last_words();
    capture_init();
    uart_init();
    adc_init(1);
    ticks_init(nothing);
    MCUCR |= _BV(SE); /* idle: the only mode in which all parts go on */
    watchdog_start();
    sei();
    const struct boot boot = {
        .reset_cause = last_words->reset_cause, .count = last_words->boot_count, .build = BUILD,
        .worst_loop_us = last_words->worst_loop_us,
    };
    return boot;
}

void board_fire(uint8_t sonars)
{
    capture_fire(sonars == SONAR_ODD);
}

bool board_echo(uint8_t *line, uint16_t *echo_us)
{
    return capture_take(line, echo_us);
}

void board_stop_listening(void)
{
    capture_close();
}

void board_start_infrared(void)
{
    adc_sweep();
}

bool board_infrared(uint16_t counts[INFRARED_COUNT])
{
    return adc_take(counts);
}

bool board_is_granted(void)
{
    return (PIND & GRANT) != 0;
}

void board_pet(uint16_t worst_loop_us)
{
    last_words->worst_loop_us = worst_loop_us;
    watchdog_pet();
}

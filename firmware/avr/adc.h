/* SPDX-License-Identifier: Apache-2.0
 *
 * All eight ADC inputs (PA0 to PA7), 10 bits against AVCC, 104 us each. Every conversion is started in software and
 * read before the multiplexer moves on. So many sweeps are summed into one result.
 */
#ifndef CRUNCH_AVR_ADC_H
#define CRUNCH_AVR_ADC_H

#include <stdbool.h>
#include <stdint.h>

#define ADC_CHANNELS 8
#define ADC_FIRST 2 /* of a sweep; the last are inputs 0 and 1, gyro and accelerometer, which are to be fresh */

/* A result is the sum of `sweeps`, at most 64. */
void adc_init(uint8_t sweeps);

/* Starts a sweep, which takes 0.85 ms; nothing if one is under way. May be called from an interrupt. */
void adc_sweep(void);

/* Takes the newest result; false if there is none since the last call. */
bool adc_take(uint16_t sums[ADC_CHANNELS]);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#include "adc.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <string.h>
#include <util/atomic.h>

#define REFERENCE _BV(REFS0) /* AVCC */

static uint8_t sweeps_per_result;
static uint16_t sums[ADC_CHANNELS];   /* the interrupt's own */
static uint8_t sweeps;                /* the interrupt's own */
static uint8_t channel = ADC_FIRST;   /* the interrupt's own; the first between sweeps */
static uint16_t result[ADC_CHANNELS]; /* written by the interrupt, read with interrupts off */
static volatile bool is_fresh;        /* set by the interrupt, cleared by adc_take */

static void finish_sweep(void)
{
    if (++sweeps < sweeps_per_result)
        return;
    memcpy(result, sums, sizeof result);
    memset(sums, 0, sizeof sums);
    sweeps = 0;
    is_fresh = true;
}

ISR(ADC_vect)
{
    sums[channel] = (uint16_t)(sums[channel] + ADC);
    channel = (uint8_t)((channel + 1) % ADC_CHANNELS);
    if (channel == ADC_FIRST)
        finish_sweep();
    ADMUX = (uint8_t)(REFERENCE | channel);
    if (channel != ADC_FIRST)
        ADCSRA |= _BV(ADSC);
}

void adc_init(uint8_t sweeps_to_sum)
{
    sweeps_per_result = sweeps_to_sum;
    ADMUX = REFERENCE | ADC_FIRST;
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0); /* 125 kHz */
}

void adc_sweep(void)
{
    if (channel == ADC_FIRST)
        ADCSRA |= _BV(ADSC);
}

bool adc_take(uint16_t taken[ADC_CHANNELS])
{
    if (!is_fresh)
        return false;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        memcpy(taken, result, sizeof result);
        is_fresh = false;
    }
    return true;
}

/* SPDX-License-Identifier: Apache-2.0
 *
 * The ATmega32's side: the same, told on the serial line as fast as it goes, for ever. */
#include "../parity/parity.h"

#include <avr/io.h>

static struct parity parity;
static uint8_t step[PARITY_MAX_STEP];

static void say(uint8_t byte)
{
    while (!(UCSRA & _BV(UDRE)))
        ;
    UDR = byte;
}

int main(void)
{
    UBRRL = 0;
    UCSRA = _BV(U2X);
    UCSRB = _BV(TXEN);
    parity_init(&parity, SEED);
    for (;;) {
        const uint8_t size = parity_step(&parity, step);
        say(size);
        for (uint8_t i = 0; i < size; i++)
            say(step[i]);
    }
}

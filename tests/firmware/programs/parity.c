/* SPDX-License-Identifier: Apache-2.0
 *
 * The ATmega32's side: the same, told on the serial line as fast as it goes, for ever: the whole loop, or with MODULES each file by itself. */
#ifdef MODULES
#include "../parity/modules.h"
#define part modules
#define part_init modules_init
#define part_step modules_step
#define MAX_STEP MODULES_MAX_STEP
#else
#include "../parity/parity.h"
#define part parity
#define part_init parity_init
#define part_step parity_step
#define MAX_STEP PARITY_MAX_STEP
#endif

#include <avr/io.h>

static struct part state;
static uint8_t step[MAX_STEP];

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
    part_init(&state, SEED);
    for (;;) {
        const uint8_t size = part_step(&state, step);
        say(size);
        for (uint8_t i = 0; i < size; i++)
            say(step[i]);
    }
}

/* SPDX-License-Identifier: Apache-2.0
 *
 * One ATmega32 at 16 MHz that runs a real program under simavr 1.6: voltages, pins, encoders and a serial line, in
 * plain numbers. Nothing of simavr's own structures shows here. Where simavr differs from silicon, this makes it
 * right:
 *
 *  1. it takes UBRRH and UCSRC, one address, for each other: the time per byte is set from UBRRL before every run;
 *  2. and 3. Timer0 knows Normal mode only, Timer1 not all modes: the programs use Timer2's CTC and Timer1's mode 14;
 *  4. and 5. the ADC starts in software only and is read under the present ADMUX: so do the programs. It has no noise:
 *     `on_convert` asks for a voltage at each conversion's start;
 *  6. INT0 and INT1 would be polled every cycle after each reset: switched off;
 *  7. it would sleep by the clock on the wall: it does not;
 *  8. a program's write to a port would take pulled-up inputs of that port high: it is told what is outside;
 *  9. its EEPROM writes at once: here a byte keeps it busy (EEWE) for 8.5 ms, as on silicon.
 *
 * The receiver holds two bytes, as on silicon: a third unread one is lost, and counted.
 */
#ifndef CRUNCH_VIRTUAL_AVR_MICROCONTROLLER_H
#define CRUNCH_VIRTUAL_AVR_MICROCONTROLLER_H

#include <stdbool.h>
#include <stdint.h>

#define MICROCONTROLLER_HZ 16000000
#define MICROCONTROLLER_SENT 512

struct microcontroller;

struct sent_byte { /* on the line from `start` to `end`, in cycles */
    uint64_t start, end;
    uint8_t byte;
};

struct wiring { /* what the program's surroundings do, called while it runs; any may be NULL */
    void *owner;
    void (*on_convert)(void *owner, int channel);                /* a conversion starts */
    void (*on_pin)(void *owner, char port, int bit, bool level); /* the program drives a pin of port B or C */
    bool (*on_bus_start)(void *owner, uint8_t address);          /* on the two-wire bus: whether a part answers */
    void (*on_bus_byte)(void *owner, uint8_t byte);              /* a byte for the part that answered */
    uint8_t (*on_bus_ask)(void *owner);                          /* a byte from it */
};

/* NULL if the program cannot be read. */
struct microcontroller *microcontroller_new(const char *elf, const struct wiring *wiring);
void microcontroller_free(struct microcontroller *mcu);

/* Runs to a cycle, at most 1 ms on; false if the program has crashed. */
bool microcontroller_run(struct microcontroller *mcu, uint64_t until);
uint64_t microcontroller_cycle(const struct microcontroller *mcu);

void microcontroller_voltage(struct microcontroller *mcu, int channel, double volts);
void microcontroller_pin(struct microcontroller *mcu, char port, int bit, bool level);

/* Takes a pin to a level so many cycles from now; one such order per pin and level at a time. Ports B and D. */
void microcontroller_pin_later(struct microcontroller *mcu, char port, int bit, bool level, uint64_t cycles);

/* Whether the program drives a pin high. */
bool microcontroller_output(const struct microcontroller *mcu, char port, int bit);

/* Share of the time that OC1A (0) or OC1B (1) is high in fast PWM; 0 where it is not connected. */
double microcontroller_pwm(const struct microcontroller *mcu, int output);

/* Turns encoder 0 (PD2, PB0) or 1 (PD3, PB1) to a count; its edges are spread over the next ms. */
void microcontroller_turn(struct microcontroller *mcu, int encoder, int64_t ticks);

/* Bytes for the receiver, one after the other at the line's rate; those beyond 4096 that wait are lost. */
void microcontroller_receive(struct microcontroller *mcu, const uint8_t *bytes, int32_t count);

/* Takes the bytes sent since the last call, at most MICROCONTROLLER_SENT. */
int32_t microcontroller_take_sent(struct microcontroller *mcu, struct sent_byte *sent);

uint32_t microcontroller_resets(const struct microcontroller *mcu); /* the first start included */
uint32_t microcontroller_overruns(const struct microcontroller *mcu);
uint64_t microcontroller_slept(const struct microcontroller *mcu);  /* cycles */

/* The longest time between two sleeps, in cycles, since this was asked last. */
uint64_t microcontroller_longest_awake(struct microcontroller *mcu);

/* Bytes of RAM that nothing has ever touched between data and stack. */
int32_t microcontroller_untouched(const struct microcontroller *mcu);

/* A byte of the data space, registers included: for tests that break things. */
uint8_t microcontroller_peek(const struct microcontroller *mcu, uint16_t address);
void microcontroller_poke(struct microcontroller *mcu, uint16_t address, uint8_t value);

/* Resets it as a dip of its supply does; memory keeps what it had. */
void microcontroller_brown_out(struct microcontroller *mcu);

/* Presses reset: memory and EEPROM stay. */
void microcontroller_reset(struct microcontroller *mcu);

/* A byte of the EEPROM, and a way to spoil it. */
uint8_t microcontroller_eeprom(struct microcontroller *mcu, uint16_t address);
void microcontroller_spoil(struct microcontroller *mcu, uint16_t address, uint8_t value);

/* Accesses to the EEPROM while a byte was being written, which silicon does not obey. */
uint32_t microcontroller_hasty(const struct microcontroller *mcu);

/* Lets the program hang from now on, until its watchdog bites; its interrupts go on, or do not. */
void microcontroller_hang(struct microcontroller *mcu, bool is_deaf);

#endif

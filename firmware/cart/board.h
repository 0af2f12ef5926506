/* SPDX-License-Identifier: Apache-2.0
 *
 * What the cart's main loop needs of its hardware; avr/cart_board.c has it.
 */
#ifndef CRUNCH_CART_BOARD_H
#define CRUNCH_CART_BOARD_H

#include "../link/board.h"
#include "loop.h"

/* Motors off before anything else, then all hardware on, interrupts enabled; returns what the status frame says about
 * this start. */
struct boot board_init(void);

/* Takes the battery's newest sum; true every 5 ms as long as clock and converter work. */
bool board_battery(uint16_t *sum);

/* Counters and switches as they are now. */
void board_sense(struct cart_sensed *sensed);

/* Each from -MOTOR_FULL_POWER to MOTOR_FULL_POWER; a motor without power is shorted, and brakes. */
void board_drive(int16_t left, int16_t right);

/* Keeps the watchdog quiet; `worst_loop_us` outlives a reset. */
void board_pet(uint16_t worst_loop_us);

#endif

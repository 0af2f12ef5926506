/* SPDX-License-Identifier: Apache-2.0
 *
 * What the drive board's main loop needs of its hardware; avr/drive_board.c has it. Other parts (an IMU over TWI in
 * place of the analogue gyro, say) are other files behind this header.
 */
#ifndef CRUNCH_DRIVE_BOARD_H
#define CRUNCH_DRIVE_BOARD_H

#include "../link/board.h"
#include "loop.h"

/* All hardware on, motors off, interrupts enabled; returns what the status frame says about this start. */
struct boot board_init(void);

/* The samples of a step; false while they are not complete. True every 5 ms as long as clock and converter work. */
bool board_sample(struct drive_samples *samples);

void board_drive(const struct duties *duties);
void board_motors_off(void);

/* GRANT: the line is the sensor board's. */
void board_grant(bool is_granted);

/* Keeps the watchdog quiet; what it is given outlives a reset. */
void board_pet(uint16_t worst_loop_us, const struct ending *ending);

#endif

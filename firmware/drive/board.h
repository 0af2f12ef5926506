/* SPDX-License-Identifier: Apache-2.0
 *
 * What the drive board's main loop needs of its hardware; avr/drive_board.c has it. Other parts (an IMU over TWI in
 * place of the analogue gyro, say) are other files behind this header.
 */
#ifndef CRUNCH_DRIVE_BOARD_H
#define CRUNCH_DRIVE_BOARD_H

#include "loop.h"

/* All hardware on, motors off, interrupts enabled; returns what the status frame says about this start. */
struct boot board_init(void);

/* The EEPROM, from the settings' record on. A byte is written within 8.5 ms, until when the memory is not free. */
bool board_memory_is_free(void);
uint8_t board_memory_read(uint8_t at);
void board_memory_write(uint8_t at, uint8_t byte);

uint32_t board_ms(void);
uint16_t board_us(void); /* wraps at 65536 */

/* The samples of a step; false while they are not complete. True every 5 ms as long as clock and converter work. */
bool board_sample(struct drive_samples *samples);

void board_drive(const struct duties *duties);
void board_motors_off(void);

bool board_receive(uint8_t *byte);
bool board_is_sending(void);
void board_send(const uint8_t *frame, uint8_t size);

/* GRANT: the line is the sensor board's. */
void board_grant(bool is_granted);

/* Keeps the watchdog quiet; what it is given outlives a reset. */
void board_pet(uint16_t worst_loop_us, const struct ending *ending);

/* Sleeps until something happens. */
void board_sleep(void);

#endif

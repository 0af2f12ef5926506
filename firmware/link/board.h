/* SPDX-License-Identifier: Apache-2.0
 *
 * What the boards' main loops need of the hardware that all of them have; avr/board.c has it.
 */
#ifndef CRUNCH_LINK_BOARD_H
#define CRUNCH_LINK_BOARD_H

#include "adjust.h"

uint32_t board_ms(void);
uint16_t board_us(void); /* wraps at 65536 */

bool board_receive(uint8_t *byte);
bool board_is_sending(void);

/* Begins to send the frame that waits longest, if the line is free; whether it did. */
bool board_send_next(struct outbox *outbox);

/* A loop's body that began at `start_us` has ended. */
void board_note_loop(struct teller *teller, uint16_t start_us);

/* The settings' record in the EEPROM. */
void board_load(uint8_t *record, uint8_t size);

/* One byte of a record under way, if the memory is free: a step never waits for it. */
void board_keep(struct adjuster *adjuster, struct teller *teller);

/* Sleeps until something happens. */
void board_sleep(void);

#endif

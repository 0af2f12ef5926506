/* SPDX-License-Identifier: Apache-2.0
 *
 * What the sensor board's main loop needs of its hardware; avr/sensor_board.c has it.
 */
#ifndef CRUNCH_SENSOR_BOARD_H
#define CRUNCH_SENSOR_BOARD_H

#include "../link/board.h"
#include "loop.h"

#define BOARD_LISTEN_MS 30 /* after a firing */

/* All hardware on, interrupts enabled; returns what the status frame says about this start. */
struct boot board_init(void);

/* Fires a group, SONAR_EVEN or SONAR_ODD, and listens for it. */
void board_fire(uint8_t sonars);

/* Takes one line's first echo since the firing; false if there is no new one. */
bool board_echo(uint8_t *line, uint16_t *echo_us);

/* Nothing is heard until the next firing. To be called BOARD_LISTEN_MS after each. */
void board_stop_listening(void);

/* Starts one reading of the eight infra-red sensors. */
void board_start_infrared(void);

/* Takes what it read; false while it has not ended. */
bool board_infrared(uint16_t counts[INFRARED_COUNT]);

/* GRANT: the drive board leaves the line to this one. */
bool board_is_granted(void);

/* Keeps the watchdog quiet; `worst_loop_us` outlives a reset. */
void board_pet(uint16_t worst_loop_us);

#endif

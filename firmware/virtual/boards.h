/* SPDX-License-Identifier: Apache-2.0
 *
 * The two boards on the host: the firmware's own loops (drive/loop.c, sensor/loop.c) with what stands in place of their
 * registers.
 */
#ifndef CRUNCH_VIRTUAL_BOARDS_H
#define CRUNCH_VIRTUAL_BOARDS_H

#include "../drive/loop.h"
#include "../sensor/loop.h"

#define BOARD_MEMORY 64     /* bytes of EEPROM */
#define BOARD_WRITE_MS 9    /* that a byte of it takes */

struct board_memory {
    uint8_t bytes[BOARD_MEMORY];
    uint64_t free_ms; /* when the last write ends */
};

struct drive_board {
    struct drive_loop loop;
    struct board_memory memory;
    uint64_t booted_ms;
    struct drive_samples samples; /* the inertial sums grow by one reading every ms */
    uint32_t drives_accepted, stops_accepted, arms_accepted; /* commands from the host */
};

struct sensor_board {
    struct sensor_loop loop;
    struct board_memory memory;
    uint64_t booted_ms;
};

void drive_board_init(struct drive_board *drive, struct outbox *outbox, uint16_t build);
void sensor_board_init(struct sensor_board *sensor, struct outbox *outbox, uint16_t build);

/* Somebody presses reset: all is as at the start but for the EEPROM and the count of boots. */
void drive_board_reset(struct drive_board *drive, uint64_t now_ms);
void sensor_board_reset(struct sensor_board *sensor, uint64_t now_ms);

/* A byte from the host. */
void drive_board_receive(struct drive_board *drive, uint8_t byte);

/* What the main loops do for a record of the settings under way: at most one byte each time. */
void drive_board_keep(struct drive_board *drive, uint64_t now_ms);
void sensor_board_keep(struct sensor_board *sensor, uint64_t now_ms);

/* One ADC sweep, every ms. */
void drive_board_sample(struct drive_board *drive, uint16_t gyro, uint16_t accelerometer);

/* One pass of the 200 Hz loop; returns the set of frames told. */
uint8_t drive_board_step(struct drive_board *drive);

/* The same, for a robot whose motion is given: telemetry only, upright and armed. */
uint8_t drive_board_tell(struct drive_board *drive);

#endif

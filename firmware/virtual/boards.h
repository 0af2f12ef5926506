/* SPDX-License-Identifier: Apache-2.0
 *
 * The two boards on the host: the firmware's own loops (drive/loop.c, sensor/loop.c) with what stands in place of their
 * registers.
 */
#ifndef CRUNCH_VIRTUAL_BOARDS_H
#define CRUNCH_VIRTUAL_BOARDS_H

#include "../drive/loop.h"
#include "../sensor/loop.h"

struct drive_board {
    struct drive_loop loop;
    struct drive_samples samples; /* the inertial sums grow by one reading every ms */
    uint32_t drives_accepted, stops_accepted, arms_accepted; /* commands from the host */
};

struct sensor_board {
    struct sensor_loop loop;
};

void drive_board_init(struct drive_board *drive, struct outbox *outbox, uint16_t build);
void sensor_board_init(struct sensor_board *sensor, struct outbox *outbox, uint16_t build);

/* A byte from the host. */
void drive_board_receive(struct drive_board *drive, uint8_t byte);

/* One ADC sweep, every ms. */
void drive_board_sample(struct drive_board *drive, uint16_t gyro, uint16_t accelerometer);

/* One pass of the 200 Hz loop; returns the set of frames told. */
uint8_t drive_board_step(struct drive_board *drive);

/* The same, for a robot whose motion is given: telemetry only, upright and armed. */
uint8_t drive_board_tell(struct drive_board *drive);

#endif

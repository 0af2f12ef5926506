/* SPDX-License-Identifier: Apache-2.0
 *
 * The two boards' main loops, as far as they are the same on every machine: sample, step, tell. All logic is the
 * firmware's own (drive/, sensor/, link/); what stands here in place of registers is passed in and out.
 */
#ifndef CRUNCH_VIRTUAL_BOARDS_H
#define CRUNCH_VIRTUAL_BOARDS_H

#include "../drive/supervisor.h"
#include "../drive/telemetry.h"
#include "../drive/tilt.h"
#include "../sensor/infrared.h"
#include "../sensor/sonar_schedule.h"

#include <stdbool.h>
#include <stdint.h>

struct wire { /* bytes that a board has put on the line since they were last taken */
    uint8_t *bytes;
    int32_t size, capacity;
    int32_t dropped; /* frames that found no room */
};

struct board { /* what both have */
    uint8_t source;
    uint8_t sequence;
    uint16_t boot_count;
    uint16_t build;
    uint32_t uptime_ms;
    struct wire *wire;
};

struct supplies { /* what the drive board's other ADC channels show */
    uint16_t battery_mv, charger_mv;
    int16_t battery_ma, charger_ma;
    int16_t motor_ma[2];
};

struct drive_board {
    struct board board;
    struct tilt tilt;
    struct odometry odometry;
    struct balance balance;
    struct supervisor supervisor;
    struct telemetry telemetry;
    struct frame_decoder decoder;
    struct inertial_sums sums;
    struct duties duties;
    struct supplies supplies;
    uint16_t left_ticks, right_ticks; /* the encoders' counters */
    uint32_t drives_accepted, stops_accepted, arms_accepted; /* commands from the host */
    bool told_odometry;   /* in the last step */
};

struct sensor_board {
    struct board board;
    struct sonar_schedule sonar;
    struct infrared infrared;
};

void drive_board_init(struct drive_board *drive, struct wire *wire, uint16_t build);
void sensor_board_init(struct sensor_board *sensor, struct wire *wire, uint16_t build);

/* A byte from the host. */
void drive_board_receive(struct drive_board *drive, uint8_t byte);

/* One ADC sweep, every ms. */
void drive_board_sample(struct drive_board *drive, uint16_t gyro, uint16_t accelerometer);

/* One pass of the 200 Hz loop: estimate, supervise, balance, tell. Sets `duties`. */
void drive_board_step(struct drive_board *drive);

/* The same, for a robot whose motion is given: telemetry only, upright and armed. */
void drive_board_tell(struct drive_board *drive);

/* Frames of the sensor board. */
void sensor_board_tell_sonar(struct sensor_board *sensor, const struct sonar_payload *sweep, uint32_t time_ms);
void sensor_board_tell_infrared(struct sensor_board *sensor, const struct infrared_payload *counts, uint32_t time_ms);
void sensor_board_tell_status(struct sensor_board *sensor);

#endif

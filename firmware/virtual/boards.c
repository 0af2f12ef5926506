/* SPDX-License-Identifier: Apache-2.0 */
#include "boards.h"

#include <string.h>

#define POWER_ON_RESET 0x01 /* MCUCSR: PORF */
#define LOOP_US 520         /* the loop's worst time as measured on the AVR */

static struct boot first_boot(uint16_t build)
{
    const struct boot boot = {.reset_cause = POWER_ON_RESET, .count = 1, .build = build, .worst_loop_us = LOOP_US};
    return boot;
}

void drive_board_init(struct drive_board *drive, struct outbox *outbox, uint16_t build)
{
    const struct boot boot = first_boot(build);
    memset(drive, 0, sizeof *drive);
    drive_loop_init(&drive->loop, &boot, outbox);
}

void sensor_board_init(struct sensor_board *sensor, struct outbox *outbox, uint16_t build)
{
    const struct boot boot = first_boot(build);
    sensor_loop_init(&sensor->loop, &boot, outbox);
}

void drive_board_receive(struct drive_board *drive, uint8_t byte)
{
    const enum command_kind kind = drive_loop_receive(&drive->loop, byte);
    drive->drives_accepted += kind == COMMAND_DRIVE;
    drive->stops_accepted += kind == COMMAND_STOP || kind == COMMAND_DISARM;
    drive->arms_accepted += kind == COMMAND_ARM;
}

void drive_board_sample(struct drive_board *drive, uint16_t gyro, uint16_t accelerometer)
{
    struct inertial_sums *sums = &drive->samples.inertial;
    sums->gyro = (uint16_t)(sums->gyro + gyro);
    sums->accelerometer = (uint16_t)(sums->accelerometer + accelerometer);
}

uint8_t drive_board_step(struct drive_board *drive)
{
    const uint8_t told = drive_loop_step(&drive->loop, &drive->samples);
    drive->samples.inertial.gyro = drive->samples.inertial.accelerometer = 0;
    return told;
}

uint8_t drive_board_tell(struct drive_board *drive)
{
    drive->loop.supervisor.state = DRIVE_ARMED;
    drive->loop.supervisor.reason = STOP_NONE;
    return drive_loop_tell(&drive->loop, &drive->samples);
}

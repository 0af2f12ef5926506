/* SPDX-License-Identifier: Apache-2.0 */
#include "boards.h"

#include <string.h>

#define POWER_ON_RESET 0x01 /* MCUCSR: PORF */
#define EXTERNAL_RESET 0x02 /* EXTRF */
#define LOOP_US 520         /* the loop's worst time as measured on the AVR */

_Static_assert(SETTINGS_RECORD_SIZE(SETTINGS_MAX) <= BOARD_MEMORY, "room for the record");

static struct boot first_boot(uint16_t build)
{
    const struct boot boot = {.reset_cause = POWER_ON_RESET, .count = 1, .build = build, .worst_loop_us = LOOP_US};
    return boot;
}

static struct boot next_boot(const struct boot *boot)
{
    struct boot next = *boot;
    next.reset_cause = EXTERNAL_RESET;
    next.count++;
    return next;
}

static void erase(struct board_memory *memory)
{
    memset(memory->bytes, 0xFF, sizeof memory->bytes);
    memory->free_ms = 0;
}

void drive_board_init(struct drive_board *drive, struct outbox *outbox, uint16_t build)
{
    const struct boot boot = first_boot(build);
    memset(drive, 0, sizeof *drive);
    erase(&drive->memory);
    drive_loop_init(&drive->loop, &boot, outbox);
}

void sensor_board_init(struct sensor_board *sensor, struct outbox *outbox, uint16_t build)
{
    const struct boot boot = first_boot(build);
    memset(sensor, 0, sizeof *sensor);
    erase(&sensor->memory);
    sensor_loop_init(&sensor->loop, &boot, outbox);
}

void drive_board_reset(struct drive_board *drive, uint64_t now_ms)
{
    const struct boot boot = next_boot(&drive->loop.teller.boot);
    drive_loop_init(&drive->loop, &boot, drive->loop.teller.outbox);
    drive_loop_load(&drive->loop, drive->memory.bytes);
    drive->booted_ms = now_ms;
}

void sensor_board_reset(struct sensor_board *sensor, uint64_t now_ms)
{
    const struct boot boot = next_boot(&sensor->loop.teller.boot);
    sensor_loop_init(&sensor->loop, &boot, sensor->loop.teller.outbox);
    sensor_loop_load(&sensor->loop, sensor->memory.bytes);
    sensor->booted_ms = now_ms;
}

static void keep(struct board_memory *memory, struct adjuster *adjuster, struct teller *teller, uint64_t now_ms)
{
    struct settings_work work;
    if (!settings_work(&adjuster->settings, &work) || now_ms < memory->free_ms)
        return;
    if (work.is_write && memory->bytes[work.at] != work.byte) {
        memory->bytes[work.at] = work.byte;
        memory->free_ms = now_ms + BOARD_WRITE_MS;
    }
    adjust_did(adjuster, teller, memory->bytes[work.at]);
}

void drive_board_keep(struct drive_board *drive, uint64_t now_ms)
{
    keep(&drive->memory, &drive->loop.adjuster, &drive->loop.teller, now_ms);
}

void sensor_board_keep(struct sensor_board *sensor, uint64_t now_ms)
{
    keep(&sensor->memory, &sensor->loop.adjuster, &sensor->loop.teller, now_ms);
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
    drive_loop_step(&drive->loop, &drive->samples);
    const uint8_t told = drive_loop_tell(&drive->loop, &drive->samples);
    drive->samples.inertial.gyro = drive->samples.inertial.accelerometer = 0;
    return told;
}

uint8_t drive_board_tell(struct drive_board *drive)
{
    drive->loop.supervisor.state = DRIVE_ARMED;
    drive->loop.supervisor.reason = STOP_NONE;
    return drive_loop_tell(&drive->loop, &drive->samples);
}

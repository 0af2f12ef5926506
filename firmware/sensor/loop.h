/* SPDX-License-Identifier: Apache-2.0
 *
 * The sensor board's main loop without its hardware: once a ms it says which sonars to fire and whether the infra-red
 * sensors are to be read, and makes frames of what came back. Pure: no registers, no globals.
 *
 * Neighbours share an echo line (sonars 0 and 1 the first, 2 and 3 the second, ...): they never fire together, so the
 * slot tells which of the two was heard. Who calls keeps the time: `teller.uptime_ms` must be right before each call.
 */
#ifndef CRUNCH_SENSOR_LOOP_H
#define CRUNCH_SENSOR_LOOP_H

#include "../link/adjust.h"
#include "infrared.h"
#include "sonar_schedule.h"

#define SENSOR_ECHO_LINES 4
#define SENSOR_SETTINGS 4 /* the streams' periods */

struct sensor_loop {
    struct teller teller;
    struct sonar_schedule sonar;
    struct infrared infrared;
    struct frame_decoder decoder;
    struct adjuster adjuster;
    uint16_t refused; /* adjustments without their seal; stays at its maximum */
};

struct sensor_work { /* what to do now */
    uint8_t fire;           /* set of sonars */
    bool is_infrared_due;   /* read all eight and give them to sensor_loop_infrared */
};

/* The outbox must outlive the loop. */
void sensor_loop_init(struct sensor_loop *loop, const struct boot *boot, struct outbox *outbox);

/* The settings of the EEPROM's record, SETTINGS_RECORD_SIZE(SENSOR_SETTINGS) bytes, if it is sound. */
void sensor_loop_load(struct sensor_loop *loop, const uint8_t *record);

/* A byte from the host: adjustments of this board are obeyed, noise is counted, all else is the drive board's. */
void sensor_loop_receive(struct sensor_loop *loop, uint8_t byte);

/* Called every ms. */
struct sensor_work sensor_loop_tick(struct sensor_loop *loop);

/* The first echo on a line since the last firing, `echo_us` after it. */
void sensor_loop_echo(struct sensor_loop *loop, uint8_t line, uint16_t echo_us);

void sensor_loop_infrared(struct sensor_loop *loop, const uint16_t counts[INFRARED_COUNT]);

#endif

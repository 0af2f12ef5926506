/* SPDX-License-Identifier: Apache-2.0
 *
 * The drive board's main loop without its hardware: from what was sampled to duties and frames, 200 times a second.
 * Pure: no registers, no globals; the host's build gives the same bits. Who calls it keeps the time:
 * `teller.uptime_ms` is the board's clock and must be right before each call.
 */
#ifndef CRUNCH_DRIVE_LOOP_H
#define CRUNCH_DRIVE_LOOP_H

#include "../link/adjust.h"
#include "agreement.h"
#include "power.h"
#include "settings.h"
#include "supervisor.h"
#include "telemetry.h"
#include "tilt.h"

struct drive_samples { /* what the hardware shows at one step */
    struct inertial_sums inertial;
    uint16_t left_ticks, right_ticks; /* the encoders' counters; they wrap */
    struct supplies supplies;
};

struct drive_loop {
    struct teller teller;
    struct tilt tilt;
    struct odometry odometry;
    struct agreement agreement;
    struct balance balance;
    float level; /* the setting that the balance's trim was learned with, g */
    struct supervisor supervisor;
    struct telemetry telemetry;
    struct frame_decoder decoder;
    struct ending ending; /* what would be this run's last words */
    struct adjuster adjuster;
    struct adjustment zeroing; /* to be answered when the gyro's zero is learned */
    bool is_zeroing;
    uint16_t zeroing_steps;
    struct duties wanted; /* by the balance law, */
    struct duties duties; /* and what of it the motors get until the next step */
};

/* Motors off, encoders at zero. The outbox must outlive the loop. */
void drive_loop_init(struct drive_loop *loop, const struct boot *boot, struct outbox *outbox);

/* The settings of the EEPROM's record, SETTINGS_RECORD_SIZE(DRIVE_SETTINGS) bytes, if it is sound. */
void drive_loop_load(struct drive_loop *loop, const uint8_t *record);

/* A byte from the host; returns the kind of command that it completed and that was obeyed, else COMMAND_REFUSED. */
enum command_kind drive_loop_receive(struct drive_loop *loop, uint8_t byte);

/* One step of 5 ms: estimate, supervise, balance. Sets `duties`, which the motors should get at once: a light body is
 * balanced worse with every millisecond that passes. */
void drive_loop_step(struct drive_loop *loop, const struct drive_samples *samples);

/* After each step: what is due of the telemetry, and the answer to a zeroing; returns the set of the frames due. */
uint8_t drive_loop_tell(struct drive_loop *loop, const struct drive_samples *samples);

#endif

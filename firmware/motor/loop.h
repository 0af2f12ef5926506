/* SPDX-License-Identifier: Apache-2.0
 *
 * The motor board's main loop without its hardware: once a ms from the host's commands and the battery to the motors'
 * powers, and what is told of them. Pure: no registers, no globals, no floats; the host's build gives the same bits.
 *
 * The line is this board's alone. Who calls keeps the time: `teller.uptime_ms` must be right before each call.
 */
#ifndef CRUNCH_MOTOR_LOOP_H
#define CRUNCH_MOTOR_LOOP_H

#include "../link/teller.h"
#include "battery.h"
#include "ramp.h"
#include "supervisor.h"

struct motor_loop {
    struct teller teller;
    struct frame_decoder decoder;
    struct motor_supervisor supervisor;
    struct ramp ramps[MOTORS]; /* whose powers the motors are to have now */
    uint16_t battery_mv;
};

/* Motors off. The outbox must outlive the loop. */
void motor_loop_init(struct motor_loop *loop, const struct boot *boot, struct outbox *outbox);

/* A byte from the host; returns the kind of command that it completed and that was obeyed, else MOTOR_REFUSED. */
enum motor_command_kind motor_loop_receive(struct motor_loop *loop, uint8_t byte);

/* What the converter summed of the battery. */
void motor_loop_battery(struct motor_loop *loop, uint16_t sum);

/* Called every ms. */
void motor_loop_tick(struct motor_loop *loop);

#endif

/* SPDX-License-Identifier: Apache-2.0
 *
 * The cart's main loop without its hardware: once a ms from counters, bumper and battery to the motors' powers, and what
 * is told of them. Pure: no registers, no globals, no floats; the host's build gives the same bits.
 *
 * The line is this board's alone. Who calls keeps the time: `teller.uptime_ms` must be right before each call.
 */
#ifndef CRUNCH_CART_LOOP_H
#define CRUNCH_CART_LOOP_H

#include "../link/teller.h"
#include "../motor/battery.h"
#include "../motor/ramp.h"
#include "log.h"
#include "supervisor.h"

struct cart_loop {
    struct teller teller;
    struct frame_decoder decoder;
    struct cart_supervisor supervisor;
    struct cart_program program;
    struct ramp ramps[2]; /* whose powers the motors are to have now; none is a brake */
    uint16_t battery_mv;
    uint8_t run; /* counted since boot */
    uint16_t upload_next, upload_end; /* numbers of the log's stages that are still to be told */
    struct cart_log log;
};

/* Motors off. The outbox must outlive the loop. */
void cart_loop_init(struct cart_loop *loop, const struct boot *boot, struct outbox *outbox);

/* A byte from the host; returns the kind of command that it completed and that was obeyed, else CART_REFUSED. */
enum cart_command_kind cart_loop_receive(struct cart_loop *loop, uint8_t byte);

/* What the converter summed of the battery. */
void cart_loop_battery(struct cart_loop *loop, uint16_t sum);

/* Called every ms. True when a stage was completed, which is the log's newest then. */
bool cart_loop_tick(struct cart_loop *loop, const struct cart_sensed *sensed);

#endif

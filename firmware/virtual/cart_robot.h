/* SPDX-License-Identifier: Apache-2.0
 *
 * The bumper cart on the host: the loop of its board (cart/loop.c) moves its body. What the board says is in its outbox
 * at once: the line's time is not modelled, and what nobody takes in time is lost.
 */
#ifndef CRUNCH_VIRTUAL_CART_ROBOT_H
#define CRUNCH_VIRTUAL_CART_ROBOT_H

#include "../cart/loop.h"
#include "cart_body.h"

#define CART_OUTBOX 256

struct cart_robot {
    struct cart_body body;
    struct cart_loop loop;
    struct outbox outbox;
    uint8_t room[CART_OUTBOX];
    uint16_t sum;            /* of the battery's readings */
    struct cart_stage ended; /* the last one that was recorded */
};

/* A cart that was just switched on; its body must have been made before. It must not be moved in memory. */
void cart_robot_init(struct cart_robot *robot, uint16_t build);

/* A run's frame from a host that has just heard the board. */
void cart_robot_order(struct cart_robot *robot, uint16_t bumps, uint16_t seed, uint8_t manner);

/* Lets time pass until a stage was recorded, at most so many ms; whether one was. */
bool cart_robot_run(struct cart_robot *robot, uint32_t ms);

/* What the board's converter reads of the battery now. */
uint16_t cart_robot_reading(const struct cart_body *body);

#endif

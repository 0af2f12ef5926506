/* SPDX-License-Identifier: Apache-2.0 */
#include "cart_robot.h"

#include "../link/crc.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define POWER_ON_RESET 0x01 /* MCUCSR: PORF */
#define FULL_SCALE 20.0     /* V of the battery at the converter's end */
#define MAX_COUNT 1023.0

void cart_robot_init(struct cart_robot *robot, uint16_t build)
{
    const struct boot boot = {.reset_cause = POWER_ON_RESET, .count = 1, .build = build};
    outbox_init(&robot->outbox, robot->room, CART_OUTBOX);
    cart_loop_init(&robot->loop, &boot, &robot->outbox);
    robot->sum = 0;
}

void cart_robot_order(struct cart_robot *robot, uint16_t bumps, uint16_t seed, uint8_t manner)
{
    struct run_payload payload = {
        .bumps = bumps, .seed = seed, .manner = manner, .echo_ms = (uint16_t)robot->loop.teller.uptime_ms,
    };
    uint8_t encoded[LINK_MAX_ENCODED];
    payload.check = crc32_of((const uint8_t *)&payload, offsetof(struct run_payload, check));
    const uint8_t size = frame_encode(encoded, SOURCE_HOST, CHANNEL_RUN, 0, 0, &payload, sizeof payload);
    for (uint8_t i = 0; i < size; i++)
        cart_loop_receive(&robot->loop, encoded[i]);
}

uint16_t cart_robot_reading(const struct cart_body *body)
{
    return (uint16_t)fmin(MAX_COUNT, round(body->volts / FULL_SCALE * MAX_COUNT));
}

static bool pass_ms(struct cart_robot *robot)
{
    struct cart_loop *loop = &robot->loop;
    const struct cart_sensed sensed = {
        .ticks = {cart_body_ticks(&robot->body, 0), cart_body_ticks(&robot->body, 1)},
        .bumper = cart_body_bumper(&robot->body),
    };
    loop->teller.uptime_ms++;
    robot->sum = (uint16_t)(robot->sum + cart_robot_reading(&robot->body));
    if (loop->teller.uptime_ms % BATTERY_READINGS == 0) {
        cart_loop_battery(loop, robot->sum);
        robot->sum = 0;
    }
    const bool has_ended = cart_loop_tick(loop, &sensed);
    const double powers[2] = {
        (double)loop->ramps[0].power / MOTOR_FULL_POWER, (double)loop->ramps[1].power / MOTOR_FULL_POWER,
    };
    cart_body_step(&robot->body, powers);
    return has_ended && cart_log_get(&loop->log, (uint16_t)(loop->log.count - 1), &robot->ended);
}

bool cart_robot_run(struct cart_robot *robot, uint32_t ms)
{
    for (uint32_t i = 0; i < ms; i++)
        if (pass_ms(robot))
            return true;
    return false;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "parity.h"

#include "../../../firmware/link/crc.h"

#include <string.h>

void parity_init(struct parity *parity, uint32_t seed)
{
    const struct boot boot = {.reset_cause = 1, .count = 1};
    memset(parity, 0, sizeof *parity);
    parity->random = seed;
    outbox_init(&parity->outbox, parity->bytes, PARITY_OUTBOX);
    drive_loop_init(&parity->loop, &boot, &parity->outbox);
}

/* Uniform in 0 to n - 1 (Marsaglia's xorshift). */
static uint16_t draw(struct parity *parity, uint16_t n)
{
    parity->random ^= parity->random << 13;
    parity->random ^= parity->random >> 17;
    parity->random ^= parity->random << 5;
    return (uint16_t)((parity->random >> 8) % n);
}

/* An ADC's sum: mostly near the middle, now and then anywhere, sometimes still for long. */
static uint16_t draw_sum(struct parity *parity, uint16_t spread)
{
    return draw(parity, 16) == 0 ? draw(parity, 5116) : (uint16_t)(2560 - spread / 2 + draw(parity, spread));
}

static void draw_samples(struct parity *parity, bool is_still)
{
    struct drive_samples *samples = &parity->samples;
    struct supplies *supplies = &samples->supplies;
    samples->inertial.gyro = is_still ? (uint16_t)(2560 + draw(parity, 8)) : draw_sum(parity, 800);
    samples->inertial.accelerometer = draw_sum(parity, 400);
    samples->left_ticks = (uint16_t)(samples->left_ticks + draw(parity, 17) - 8);
    samples->right_ticks = (uint16_t)(samples->right_ticks + draw(parity, 17) - 8);
    supplies->battery_mv = (uint16_t)(19000 + draw(parity, 15000));
    supplies->motor_ma[0] = (int16_t)((int16_t)draw(parity, 12000) - 6000);
    supplies->motor_ma[1] = (int16_t)((int16_t)draw(parity, 12000) - 6000);
}

static void draw_wish(struct parity *parity)
{
    const struct command command = {
        .kind = COMMAND_DRIVE,
        .wish = {((float)draw(parity, 2000) - 1000.0f) / 1000.0f, ((float)draw(parity, 8000) - 4000.0f) / 1000.0f},
    };
    supervisor_obey(&parity->loop.supervisor, &command);
}

/* As after long standing, in which the trim is learned. */
static void draw_standing(struct parity *parity)
{
    parity->loop.supervisor.wish.speed = parity->loop.supervisor.wish.turn = 0.0f;
    parity->loop.balance.wanted_speed = 0.0f;
    parity->loop.balance.standing = 4.0f;
}

/* A setting within its bounds, or not, as the host would send it; the answer is told with the step's frames. */
static void draw_adjustment(struct parity *parity)
{
    struct adjust_payload payload = {
        .board = SOURCE_DRIVE, .verb = (uint8_t)draw(parity, 4), .setting = (uint8_t)draw(parity, SETTINGS_MAX),
        .value = (float)draw(parity, 8000) / 1000.0f, .echo_ms = (uint16_t)parity->loop.teller.uptime_ms,
    };
    uint8_t bytes[LINK_MAX_ENCODED];
    if (payload.setting < 4)
        payload.value = (float)(5 * draw(parity, 100));
    payload.check = crc32_of((const uint8_t *)&payload, sizeof payload - sizeof payload.check);
    const uint8_t size = frame_encode(bytes, SOURCE_HOST, CHANNEL_ADJUST, 0, 0, &payload, sizeof payload);
    for (uint8_t i = 0; i < size; i++)
        drive_loop_receive(&parity->loop, bytes[i]);
}

static uint8_t tell_floats(const struct drive_loop *loop, uint8_t *out)
{
    const float floats[] = {
        loop->tilt.angle, loop->tilt.rate, loop->tilt.gyro_zero, loop->tilt.rest_sum, loop->tilt.rest_low,
        loop->tilt.rest_high, loop->odometry.forward.speed, loop->odometry.forward.lag, loop->odometry.turn.speed,
        loop->odometry.turn.lag, loop->balance.wanted_speed, loop->balance.wanted_turn, loop->balance.ahead,
        loop->balance.heading_ahead, loop->balance.soft_start, loop->duties.left, loop->duties.right,
        loop->supervisor.wish.speed, loop->supervisor.wish.turn, loop->balance.trim, loop->tilt.level_sum,
        loop->tilt.level, loop->agreement.wheels, loop->agreement.body,
    };
    _Static_assert(sizeof floats <= PARITY_MAX_STEP - PARITY_OUTBOX, "room for the frames");
    memcpy(out, floats, sizeof floats);
    return sizeof floats;
}

uint8_t parity_step(struct parity *parity, uint8_t out[PARITY_MAX_STEP])
{
    struct drive_loop *loop = &parity->loop;
    const bool is_still = loop->teller.uptime_ms / 2000 % 2 == 0; /* 2 s in which the gyro's zero may be learned */
    loop->teller.uptime_ms += 5;
    draw_samples(parity, is_still);
    if (!is_still)
        loop->supervisor.state = DRIVE_ARMED; /* whatever the random lean did in the last step */
    if (draw(parity, 8) == 0)
        draw_wish(parity);
    if (draw(parity, 8) == 0)
        draw_standing(parity);
    if (draw(parity, 32) == 0)
        draw_adjustment(parity);
    drive_loop_step(loop, &parity->samples);
    drive_loop_tell(loop, &parity->samples);
    if (draw(parity, 64) == 0)
        tilt_level(&loop->tilt);
    uint8_t size = tell_floats(loop, out);
    memcpy(out + size, parity->outbox.bytes, parity->outbox.size);
    size = (uint8_t)(size + parity->outbox.size);
    parity->outbox.size = 0;
    return size;
}

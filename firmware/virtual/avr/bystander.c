/* SPDX-License-Identifier: Apache-2.0 */
#include "bystander.h"

#include "../../link/crc.h"

#include <math.h>
#include <string.h>

#define ODOMETRY_MS 20
#define TWO_PI 6.283185307179586

void bystander_init(struct bystander *bystander)
{
    memset(bystander, 0, sizeof *bystander);
    frame_decoder_init(&bystander->told);
    frame_decoder_init(&bystander->asked);
}

static uint32_t board_ms(const struct bystander *bystander, uint64_t now_ms)
{
    return (uint32_t)(now_ms - bystander->boot_ms);
}

void bystander_note(struct bystander *bystander, uint64_t now_ms, const struct place *place)
{
    bystander->places[now_ms % BYSTANDER_REMEMBERS_MS] = *place;
}

void bystander_boot(struct bystander *bystander, uint64_t now_ms)
{
    bystander->boot_ms = now_ms;
    bystander->state = DRIVE_DISARMED;
    bystander->has_odometry = false;
}

static void note_truth(struct bystander *bystander, uint64_t sampled_ms)
{
    if (bystander->truth_rows == ROBOT_TRUTH_ROWS)
        return;
    const struct place *place = &bystander->places[sampled_ms % BYSTANDER_REMEMBERS_MS];
    const struct truth truth = {(double)sampled_ms * 1e-3, place->x, place->y, remainder(place->heading, TWO_PI)};
    bystander->truth[bystander->truth_rows++] = truth;
}

static void hear_odometry(struct bystander *bystander, uint64_t now_ms, uint16_t time_ms)
{
    const uint16_t age = (uint16_t)(board_ms(bystander, now_ms) - time_ms);
    bystander->odometry_ms = time_ms;
    bystander->has_odometry = true;
    if (age < BYSTANDER_REMEMBERS_MS && age <= now_ms)
        note_truth(bystander, now_ms - age);
}

void bystander_hear(struct bystander *bystander, uint64_t now_ms, uint8_t byte)
{
    struct frame frame;
    struct balance_payload balance;
    if (!frame_decoder_feed(&bystander->told, byte, &frame) || frame.source != SOURCE_DRIVE)
        return;
    if (frame.channel == CHANNEL_ODOMETRY)
        hear_odometry(bystander, now_ms, frame.time_ms);
    if (frame.channel != CHANNEL_BALANCE || frame.size != sizeof balance)
        return;
    memcpy(&balance, frame.payload, sizeof balance);
    bystander->state = balance.state;
    bystander->acknowledged = balance.acknowledged;
}

void bystander_ask(struct bystander *bystander, uint64_t now_ms, uint8_t byte)
{
    struct frame frame;
    if (!frame_decoder_feed(&bystander->asked, byte, &frame))
        return;
    const struct command command = command_of_frame(&frame, board_ms(bystander, now_ms));
    bystander->drives_accepted += command.kind == COMMAND_DRIVE;
    bystander->stops_accepted += command.kind == COMMAND_STOP || command.kind == COMMAND_DISARM;
    bystander->arms_accepted += command.kind == COMMAND_ARM;
}

/* The sequence is the last one accepted, so that who watches it sees the host's commands only. */
static uint8_t command(const struct bystander *bystander, uint8_t channel, const void *payload, uint8_t size,
                       uint16_t time_ms, uint8_t *out)
{
    out[0] = 0;
    return (uint8_t)(1 + frame_encode(out + 1, SOURCE_HOST, channel, bystander->acknowledged, time_ms, payload, size));
}

static int16_t thousandths(double value)
{
    return (int16_t)lrint(fmax(-32767.0, fmin(32767.0, value * 1000.0)));
}

uint8_t bystander_drive(const struct bystander *bystander, double speed, double turn, uint64_t now_ms, uint8_t *out)
{
    const uint16_t echo_ms = (uint16_t)board_ms(bystander, now_ms);
    struct drive_payload payload = {.speed = thousandths(speed), .turn = thousandths(turn), .echo_ms = echo_ms};
    payload.check = crc32_of((const uint8_t *)&payload, sizeof payload - sizeof payload.check);
    return command(bystander, CHANNEL_DRIVE, &payload, sizeof payload, echo_ms, out);
}

uint8_t bystander_arm(const struct bystander *bystander, uint64_t now_ms, uint8_t *out)
{
    const uint16_t echo_ms = (uint16_t)board_ms(bystander, now_ms);
    struct arm_payload payload = {.arm = 1, .echo_ms = echo_ms};
    payload.check = crc32_of((const uint8_t *)&payload, sizeof payload - sizeof payload.check);
    return command(bystander, CHANNEL_ARM, &payload, sizeof payload, echo_ms, out);
}

bool bystander_sees_balance(const struct bystander *bystander)
{
    return bystander->state == DRIVE_ARMED || bystander->state == DRIVE_LINK_LOST;
}

bool bystander_is_odometry_next(const struct bystander *bystander, uint64_t now_ms)
{
    return bystander->has_odometry &&
           (uint16_t)(board_ms(bystander, now_ms) - bystander->odometry_ms) % ODOMETRY_MS == 0;
}

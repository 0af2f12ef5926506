/* SPDX-License-Identifier: Apache-2.0
 *
 * What each board makes of any bytes on the line, for a coverage-guided fuzzer: one input is what comes over the radio.
 * Each zero, which ends a frame, also lets 5 ms pass, so that idle zeros are time. Beside the sanitizers' own rules:
 *
 *  - a frame that is accepted is the one that encodes to these very bytes;
 *  - a command that is obeyed comes from the host, ends in the CRC-32 of what is before it (worked out here by another
 *    way than the board's), and carries a fresh echo unless it stops or disarms;
 *  - wishes, duties and powers stay in their limits, and without balancing, being driven, or running, the motors are off;
 *  - no power rises faster than its ramp;
 *  - what the boards say are good frames of their own.
 */
#include "../link/seal.h"
#include "../cart/loop.h"
#include "../drive/loop.h"
#include "../motor/loop.h"
#include "../sensor/loop.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#define STEP_MS 5
#define REST_STEPS 220 /* the gyro's zero is learned */
#define OUTBOX_BYTES 256
#define MIDDLE (512 * TILT_OVERSAMPLING)
#define MAX_SPEED 0.6f
#define MAX_TURN 3.0f
#define BOARDS 4
#define FULL_BATTERY 3222 /* a sum of the converter's: 12.6 V */
#define BUMP_MS 40        /* the cart's wheels turn by a tick each 4 ms, and it bumps when it has driven for so long */

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

struct boards {
    struct drive_loop drive;
    struct sensor_loop sensor;
    struct motor_loop motor;
    struct cart_loop cart;
    struct cart_sensed sensed; /* by the cart */
    struct outbox outboxes[BOARDS];
    uint8_t rooms[BOARDS][OUTBOX_BYTES];
    struct frame_decoder decoder; /* hears what they hear */
    uint8_t piece[LINK_MAX_ENCODED];
    size_t piece_size;
};

static void insist(bool is_so)
{
    if (!is_so)
        abort();
}

/* The boards' own frames, all of them. */
static void hear(struct outbox *outbox, uint8_t source)
{
    struct frame_decoder decoder;
    struct frame frame;
    uint8_t told[LINK_MAX_ENCODED];
    frame_decoder_init(&decoder);
    for (uint8_t size; (size = outbox_take(outbox, told)) > 0;) {
        bool is_good = false;
        for (uint8_t i = 0; i < size; i++)
            is_good = frame_decoder_feed(&decoder, told[i], &frame);
        insist(is_good && frame.source == source);
    }
    insist(outbox->size == 0);
}

static bool is_within(float value, float limit)
{
    return value >= -limit && value <= limit; /* not a number is not */
}

static void pass_motors_ms(struct motor_loop *motor)
{
    const struct ramp before[MOTORS] = {motor->ramps[0], motor->ramps[1]};
    motor->teller.uptime_ms++;
    motor_loop_battery(motor, FULL_BATTERY);
    motor_loop_tick(motor);
    for (int side = 0; side < MOTORS; side++) {
        const int power = motor->ramps[side].power;
        insist(abs(power) <= MOTOR_FULL_POWER && abs(power) <= abs(before[side].power) + RAMP_RISE);
        insist(power == 0 || motor->supervisor.state == DRIVE_ARMED);
    }
    insist(motor->supervisor.state <= DRIVE_FAULT);
}

/* The cart's wheels do what they are told, and a wall is never far. */
static void pass_cart_ms(struct boards *boards)
{
    struct cart_loop *cart = &boards->cart;
    const struct ramp before[2] = {cart->ramps[0], cart->ramps[1]};
    cart->teller.uptime_ms++;
    cart_loop_battery(cart, FULL_BATTERY);
    for (int side = 0; side < 2 && cart->teller.uptime_ms % 4 == 0; side++)
        if (before[side].power != 0)
            boards->sensed.ticks[side] = (uint16_t)(boards->sensed.ticks[side] + (before[side].power > 0 ? 1 : -1));
    const bool has_driven = cart->program.state == CART_DRIVE && cart->program.stage_ms > BUMP_MS;
    boards->sensed.bumper = has_driven && !cart->program.is_resting ? CART_MIDDLE : 0;
    cart_loop_tick(cart, &boards->sensed);
    for (int side = 0; side < 2; side++) {
        const int power = cart->ramps[side].power;
        insist(abs(power) <= MOTOR_FULL_POWER && abs(power) <= abs(before[side].power) + RAMP_RISE);
        insist(power == 0 || cart->supervisor.state == DRIVE_ARMED);
    }
    insist(cart->supervisor.state <= DRIVE_FAULT && cart->program.state <= CART_TURN);
    insist(cart->upload_end <= cart->log.count);
}

static void pass_time(struct boards *boards)
{
    struct drive_loop *drive = &boards->drive;
    const uint16_t shiver = drive->teller.uptime_ms / STEP_MS % 2; /* one that does not is broken */
    const struct drive_samples samples = {
        .inertial = {.gyro = (uint16_t)(MIDDLE + shiver), .accelerometer = MIDDLE}, .supplies = {.battery_mv = 28000},
    };
    drive->teller.uptime_ms += STEP_MS;
    drive_loop_step(drive, &samples);
    drive_loop_tell(drive, &samples);
    for (uint8_t ms = 0; ms < STEP_MS; ms++) {
        boards->sensor.teller.uptime_ms++;
        sensor_loop_tick(&boards->sensor);
        pass_motors_ms(&boards->motor);
        pass_cart_ms(boards);
    }
    const bool is_off = drive->duties.left == 0.0f && drive->duties.right == 0.0f;
    insist(is_within(drive->duties.left, 1.0f) && is_within(drive->duties.right, 1.0f));
    insist(is_off || supervisor_is_balancing(&drive->supervisor));
    insist(is_within(drive->supervisor.wish.speed, MAX_SPEED) && is_within(drive->supervisor.wish.turn, MAX_TURN));
    insist(drive->supervisor.state <= DRIVE_FAULT);
    hear(&boards->outboxes[0], SOURCE_DRIVE);
    hear(&boards->outboxes[1], SOURCE_SENSOR);
    hear(&boards->outboxes[2], SOURCE_MOTOR);
    hear(&boards->outboxes[3], SOURCE_CART);
}

static void start(struct boards *boards)
{
    const struct boot boot = {.reset_cause = 1, .count = 1};
    memset(boards, 0, sizeof *boards);
    for (int i = 0; i < BOARDS; i++)
        outbox_init(&boards->outboxes[i], boards->rooms[i], OUTBOX_BYTES);
    drive_loop_init(&boards->drive, &boot, &boards->outboxes[0]);
    sensor_loop_init(&boards->sensor, &boot, &boards->outboxes[1]);
    motor_loop_init(&boards->motor, &boot, &boards->outboxes[2]);
    cart_loop_init(&boards->cart, &boot, &boards->outboxes[3]);
    frame_decoder_init(&boards->decoder);
    for (int i = 0; i < REST_STEPS; i++)
        pass_time(boards);
    boards->drive.teller.uptime_ms = boards->motor.teller.uptime_ms = boards->cart.teller.uptime_ms = 0; /* who echoes 0 is fresh for a second */
}

/* CRC-32 as the remainder of a division, highest power first. */
static uint32_t remainder_of(const uint8_t *bytes, size_t size)
{
    uint32_t remainder = 0xFFFFFFFFu, reversed = 0;
    for (size_t i = 0; i < 8 * size; i++) {
        const uint32_t bit = bytes[i / 8] >> i % 8 & 1u;
        remainder = (remainder << 1) ^ ((remainder >> 31 ^ bit) ? 0x04C11DB7u : 0u);
    }
    for (int i = 0; i < 32; i++)
        reversed |= (remainder >> i & 1u) << (31 - i);
    return ~reversed;
}

/* Also for as long as the ramp hides them. */
static void judge_powers(const struct motor_supervisor *supervisor)
{
    for (int side = 0; side < MOTORS; side++)
        insist(abs(supervisor->wanted[side]) <= MOTOR_FULL_POWER);
}

/* One that a board has obeyed. */
static void judge_command(const struct frame *frame, bool may_be_old, uint16_t now_ms)
{
    insist(frame->source == SOURCE_HOST && frame->size >= 6);
    const uint8_t *check = frame->payload + frame->size - 4, *echo = check - 2;
    const uint32_t told = check[0] | (uint32_t)check[1] << 8 | (uint32_t)check[2] << 16 | (uint32_t)check[3] << 24;
    const uint16_t age_ms = (uint16_t)(now_ms - (uint16_t)(echo[0] | echo[1] << 8));
    insist(told == remainder_of(frame->payload, frame->size - 4u));
    insist(may_be_old || age_ms <= SEAL_MAX_AGE_MS);
}

static void judge_frame(const struct boards *boards, const struct frame *frame)
{
    uint8_t encoded[LINK_MAX_ENCODED];
    const uint8_t size = frame_encode(encoded, frame->source, frame->channel, frame->sequence, frame->time_ms,
                                      frame->payload, frame->size);
    insist(size == boards->piece_size && memcmp(encoded, boards->piece, size) == 0);
}

static void receive(struct boards *boards, uint8_t byte)
{
    struct frame frame;
    if (boards->piece_size < sizeof boards->piece)
        boards->piece[boards->piece_size++] = byte;
    const bool is_good = frame_decoder_feed(&boards->decoder, byte, &frame);
    const enum command_kind kind = drive_loop_receive(&boards->drive, byte);
    const enum motor_command_kind motor_kind = motor_loop_receive(&boards->motor, byte);
    const enum cart_command_kind cart_kind = cart_loop_receive(&boards->cart, byte);
    sensor_loop_receive(&boards->sensor, byte);
    insist(is_good || (kind == COMMAND_REFUSED && motor_kind == MOTOR_REFUSED && cart_kind == CART_REFUSED));
    if (is_good)
        judge_frame(boards, &frame);
    if (kind != COMMAND_REFUSED)
        judge_command(&frame, kind == COMMAND_STOP || kind == COMMAND_DISARM, (uint16_t)boards->drive.teller.uptime_ms);
    if (motor_kind != MOTOR_REFUSED)
        judge_command(&frame, motor_kind == MOTOR_STOP, (uint16_t)boards->motor.teller.uptime_ms);
    if (cart_kind != CART_REFUSED)
        judge_command(&frame, cart_kind == CART_STOP, (uint16_t)boards->cart.teller.uptime_ms);
    if (cart_kind == CART_RUN)
        insist((frame.payload[offsetof(struct run_payload, manner)] & ~(RUN_MATCHED | RUN_COARSE)) == 0);
    judge_powers(&boards->motor.supervisor);
    if (byte != 0)
        return;
    boards->piece_size = 0;
    pass_time(boards);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    static struct boards started, boards;
    if (started.drive.teller.outbox == NULL)
        start(&started);
    boards = started;
    for (int i = 0; i < BOARDS; i++)
        outbox_init(&boards.outboxes[i], boards.rooms[i], OUTBOX_BYTES);
    boards.drive.teller.outbox = &boards.outboxes[0];
    boards.sensor.teller.outbox = &boards.outboxes[1];
    boards.motor.teller.outbox = &boards.outboxes[2];
    boards.cart.teller.outbox = &boards.outboxes[3];
    for (size_t i = 0; i < size; i++)
        receive(&boards, bytes[i]);
    return 0;
}

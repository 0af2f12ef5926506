/* SPDX-License-Identifier: Apache-2.0 */
#include "boards.h"

#include <string.h>

#define POWER_ON_RESET 0x01 /* MCUCSR: PORF */
#define LOOP_US 520         /* the loop's worst time as measured on the AVR */
#define MAX_DUTY_BYTE 127.0f

static void tell(struct board *board, uint8_t channel, uint32_t time_ms, const void *payload, uint8_t size)
{
    struct wire *wire = board->wire;
    if (wire->capacity - wire->size < LINK_MAX_ENCODED) {
        wire->dropped++; /* whole frames or nothing */
        return;
    }
    wire->size += frame_encode(wire->bytes + wire->size, board->source, channel, board->sequence, (uint16_t)time_ms,
                               payload, size);
    board->sequence++;
}

static void board_init(struct board *board, uint8_t source, struct wire *wire, uint16_t build)
{
    const struct board fresh = {.source = source, .boot_count = 1, .build = build, .wire = wire};
    *board = fresh;
}

void drive_board_init(struct drive_board *drive, struct wire *wire, uint16_t build)
{
    memset(drive, 0, sizeof *drive);
    board_init(&drive->board, SOURCE_DRIVE, wire, build);
    tilt_init(&drive->tilt);
    odometry_init(&drive->odometry, 0, 0);
    balance_init(&drive->balance);
    supervisor_init(&drive->supervisor);
    telemetry_init(&drive->telemetry);
    frame_decoder_init(&drive->decoder);
}

void drive_board_receive(struct drive_board *drive, uint8_t byte)
{
    struct frame frame;
    if (!frame_decoder_feed(&drive->decoder, byte, &frame))
        return;
    const struct command command = command_of_frame(&frame, (uint16_t)drive->board.uptime_ms);
    supervisor_obey(&drive->supervisor, &command);
    drive->drives_accepted += command.kind == COMMAND_DRIVE;
    drive->stops_accepted += command.kind == COMMAND_STOP || command.kind == COMMAND_DISARM;
    drive->arms_accepted += command.kind == COMMAND_ARM;
}

void drive_board_sample(struct drive_board *drive, uint16_t gyro, uint16_t accelerometer)
{
    drive->sums.gyro = (uint16_t)(drive->sums.gyro + gyro);
    drive->sums.accelerometer = (uint16_t)(drive->sums.accelerometer + accelerometer);
}

static float magnitude(float value)
{
    return value < 0.0f ? -value : value;
}

static float greater(float a, float b)
{
    return a > b ? a : b;
}

static int16_t rounded(float value, float limit)
{
    if (value > limit)
        value = limit;
    if (value < -limit)
        value = -limit;
    return (int16_t)(value < 0.0f ? value - 0.5f : value + 0.5f);
}

static void tell_odometry(struct drive_board *drive)
{
    const struct odometry_payload payload = {
        .left_ticks = (int16_t)drive->left_ticks,
        .right_ticks = (int16_t)drive->right_ticks,
        .tilt = rounded(drive->tilt.angle * 10000.0f, 32767.0f),
    };
    tell(&drive->board, CHANNEL_ODOMETRY, drive->board.uptime_ms, &payload, sizeof payload);
}

static void tell_balance(struct drive_board *drive)
{
    const struct balance_payload payload = {
        .tilt_rate = rounded(drive->tilt.rate * 1000.0f, 32767.0f),
        .position_error = rounded(drive->balance.ahead * -1000.0f, 32767.0f),
        .left_duty = (int8_t)rounded(drive->duties.left * MAX_DUTY_BYTE, MAX_DUTY_BYTE),
        .right_duty = (int8_t)rounded(drive->duties.right * MAX_DUTY_BYTE, MAX_DUTY_BYTE),
        .state = drive->supervisor.state,
        .reason = drive->supervisor.reason,
        .acknowledged = drive->supervisor.acknowledged,
    };
    tell(&drive->board, CHANNEL_BALANCE, drive->board.uptime_ms, &payload, sizeof payload);
}

static void tell_power(struct drive_board *drive)
{
    const struct supplies *supplies = &drive->supplies;
    const struct power_payload payload = {
        .battery_mv = supplies->battery_mv, .battery_ma = supplies->battery_ma,
        .charger_mv = supplies->charger_mv, .charger_ma = supplies->charger_ma,
        .left_motor_ma = supplies->motor_ma[0], .right_motor_ma = supplies->motor_ma[1],
    };
    tell(&drive->board, CHANNEL_POWER, drive->board.uptime_ms, &payload, sizeof payload);
}

static void tell_status(struct board *board, const struct supervisor *supervisor, uint16_t rx_errors)
{
    const struct status_payload payload = {
        .version = LINK_PROTOCOL_VERSION,
        .state = supervisor ? supervisor->state : 0,
        .reason = supervisor ? supervisor->reason : STOP_BOOT,
        .reset_cause = POWER_ON_RESET,
        .uptime_ms = board->uptime_ms,
        .boot_count = board->boot_count,
        .worst_loop_us = LOOP_US,
        .rx_errors = rx_errors,
        .build = board->build,
    };
    tell(board, CHANNEL_STATUS, board->uptime_ms, &payload, sizeof payload);
}

static void tell_due(struct drive_board *drive)
{
    const uint8_t due = telemetry_step(&drive->telemetry, drive->supervisor.state);
    drive->told_odometry = (due & TELEMETRY_ODOMETRY) != 0;
    if (due & TELEMETRY_ODOMETRY)
        tell_odometry(drive);
    if (due & TELEMETRY_BALANCE)
        tell_balance(drive);
    if (due & TELEMETRY_POWER)
        tell_power(drive);
    if (due & TELEMETRY_STATUS)
        tell_status(&drive->board, &drive->supervisor,
                    (uint16_t)(drive->decoder.rejected + drive->supervisor.refused));
}

static struct drive_health health_of(const struct drive_board *drive, bool is_rested, const struct rolled *rolled)
{
    const float turning = magnitude(rolled->turn_rate) * 0.5f * ODOMETRY_TRACK;
    const struct supplies *supplies = &drive->supplies;
    const int16_t left = supplies->motor_ma[0], right = supplies->motor_ma[1];
    const struct drive_health health = {
        .tilt = drive->tilt.angle,
        .is_rested = is_rested,
        .rail_steps = drive->tilt.rail_steps,
        .duty = greater(magnitude(drive->duties.left), magnitude(drive->duties.right)),
        .wheel_speed = magnitude(drive->odometry.forward.speed) + turning,
        .battery_mv = supplies->battery_mv,
        .charger_mv = supplies->charger_mv,
        .motor_ma = (uint16_t)greater(magnitude((float)left), magnitude((float)right)),
    };
    return health;
}

static void drive_off(struct drive_board *drive)
{
    balance_init(&drive->balance);
    drive->duties.left = drive->duties.right = 0.0f;
}

void drive_board_step(struct drive_board *drive)
{
    const bool was_balancing = supervisor_is_balancing(&drive->supervisor);
    tilt_step(&drive->tilt, &drive->sums);
    const bool is_rested = !was_balancing && tilt_rest(&drive->tilt, &drive->sums);
    if (was_balancing)
        drive->tilt.is_rested = false;
    const struct rolled rolled =
        odometry_step(&drive->odometry, drive->left_ticks, drive->right_ticks, drive->tilt.rate);
    const struct drive_health health = health_of(drive, is_rested, &rolled);
    if (supervisor_step(&drive->supervisor, &health)) {
        const struct lean lean = {drive->tilt.angle, drive->tilt.rate};
        const struct drive_wish wish = supervisor_wish(&drive->supervisor, &health);
        drive->duties =
            balance_step(&drive->balance, &lean, &rolled, &wish, (float)drive->supplies.battery_mv / 1000.0f);
    } else {
        drive_off(drive);
    }
    drive->sums.gyro = drive->sums.accelerometer = 0;
    tell_due(drive);
}

void drive_board_tell(struct drive_board *drive)
{
    drive->supervisor.state = DRIVE_ARMED;
    drive->supervisor.reason = STOP_NONE;
    tell_due(drive);
}

void sensor_board_init(struct sensor_board *sensor, struct wire *wire, uint16_t build)
{
    memset(sensor, 0, sizeof *sensor);
    board_init(&sensor->board, SOURCE_SENSOR, wire, build);
    sonar_schedule_init(&sensor->sonar);
    infrared_init(&sensor->infrared);
}

void sensor_board_tell_sonar(struct sensor_board *sensor, const struct sonar_payload *sweep, uint32_t time_ms)
{
    tell(&sensor->board, CHANNEL_SONAR, time_ms, sweep, sizeof *sweep);
}

void sensor_board_tell_infrared(struct sensor_board *sensor, const struct infrared_payload *counts, uint32_t time_ms)
{
    tell(&sensor->board, CHANNEL_INFRARED, time_ms, counts, sizeof *counts);
}

void sensor_board_tell_status(struct sensor_board *sensor)
{
    tell_status(&sensor->board, NULL, 0);
}

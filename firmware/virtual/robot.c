/* SPDX-License-Identifier: Apache-2.0 */
#include "robot.h"

#include "../link/streams.h"

#include <math.h>
#include <string.h>

#define DRIVE_STEP_MS SUPERVISOR_STEP_MS
#define SENSOR_BOOT_MS 12   /* the sensor board wakes so much later */
#define ARMING_PATIENCE_MS 10000
#define TWO_PI 6.283185307179586
#define METRES_PER_TICK (TWO_PI * BODY_WHEEL_RADIUS / BODY_TICKS_PER_TURN)

void robot_init(struct robot *robot, const struct caster *walls, const double pose[3], uint64_t seed, uint16_t build)
{
    memset(robot, 0, sizeof *robot);
    body_init(&robot->body, walls, seed);
    robot->body.x = pose[0];
    robot->body.y = pose[1];
    robot->body.heading = pose[2];
    robot->body.is_held = true;
    inertial_init(&robot->inertial, seed);
    rangefinders_init(&robot->rangefinders, walls, seed);
    outbox_init(&robot->outbox, robot->bytes, ROBOT_WIRE_BYTES);
    drive_board_init(&robot->drive, &robot->outbox, build);
    sensor_board_init(&robot->sensor, &robot->outbox, build);
}

void robot_script(struct robot *robot, const double *rolled, const double *poses, int32_t count)
{
    robot->script.rolled = rolled;
    robot->script.poses = poses;
    robot->script.count = count;
    telemetry_init(&robot->drive.loop.telemetry);
    robot->start_ms = robot->now_ms;
}

double robot_time(const struct robot *robot)
{
    return (double)(robot->now_ms - robot->start_ms) * 1e-3;
}

/* The script's pose now, between two of its rows. */
static struct place scripted_place(const struct robot *robot)
{
    const uint64_t elapsed = robot->now_ms - robot->start_ms;
    const int32_t last = robot->script.count - 1;
    const uint64_t index = elapsed / ROBOT_SCRIPT_MS;
    const int32_t row = index < (uint64_t)last ? (int32_t)index : last;
    const double part = row < last ? (double)(elapsed % ROBOT_SCRIPT_MS) / ROBOT_SCRIPT_MS : 0.0;
    const double *a = robot->script.poses + 3 * (size_t)row;
    const double *b = row < last ? a + 3 : a;
    const struct place place = {
        a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2]), 0.0,
    };
    return place;
}

struct place robot_place(const struct robot *robot)
{
    if (robot->script.count > 0)
        return scripted_place(robot);
    const struct body *body = &robot->body;
    const struct place place = {body->x, body->y, body->heading, body->tilt};
    return place;
}

static void note_truth(struct robot *robot)
{
    if (robot->truth_rows == ROBOT_TRUTH_ROWS)
        return;
    const struct place place = robot_place(robot);
    const struct truth truth = {robot_time(robot), place.x, place.y, remainder(place.heading, TWO_PI)};
    robot->truth[robot->truth_rows++] = truth;
}

static uint16_t count_ticks(double metres)
{
    return (uint16_t)(int64_t)floor(metres / METRES_PER_TICK);
}

static int16_t milli(double value)
{
    return (int16_t)fmax(-32767.0, fmin(32767.0, value * 1000.0));
}

static void read_supplies(struct robot *robot)
{
    struct supplies *supplies = &robot->drive.samples.supplies;
    const struct body *body = &robot->body;
    supplies->battery_mv = (uint16_t)(body->battery.volts * 1000.0);
    supplies->battery_ma = milli(body->battery.amperes);
    supplies->charger_mv = (uint16_t)(robot->charger_volts * 1000.0);
    supplies->charger_ma = 0;
    supplies->motor_ma[0] = milli(body->motor_amperes[0]);
    supplies->motor_ma[1] = milli(body->motor_amperes[1]);
}

static void run_drive(struct robot *robot)
{
    uint16_t gyro, accelerometer;
    inertial_read(&robot->inertial, &robot->body, &gyro, &accelerometer);
    drive_board_sample(&robot->drive, gyro, accelerometer);
    if ((robot->now_ms + 1) % DRIVE_STEP_MS != 0)
        return;
    robot->drive.samples.left_ticks = count_ticks(robot->body.wheels[0] * BODY_WHEEL_RADIUS);
    robot->drive.samples.right_ticks = count_ticks(robot->body.wheels[1] * BODY_WHEEL_RADIUS);
    read_supplies(robot);
    if (drive_board_step(&robot->drive) & TELEMETRY_ODOMETRY)
        note_truth(robot);
    drive_board_keep(&robot->drive, robot->now_ms);
}

static void run_scripted_drive(struct robot *robot)
{
    const uint64_t elapsed = robot->now_ms - robot->start_ms;
    if (elapsed % DRIVE_STEP_MS != 0 || elapsed / ROBOT_SCRIPT_MS >= (uint64_t)robot->script.count)
        return;
    const double *rolled = robot->script.rolled + 2 * (size_t)(elapsed / ROBOT_SCRIPT_MS);
    robot->drive.samples.left_ticks = count_ticks(rolled[0]);
    robot->drive.samples.right_ticks = count_ticks(rolled[1]);
    battery_drain(&robot->body.battery, 0.5, DRIVE_STEP_MS * 1e-3);
    read_supplies(robot);
    if (drive_board_tell(&robot->drive) & TELEMETRY_ODOMETRY)
        note_truth(robot);
}

static void fire(struct robot *robot, uint8_t sonars)
{
    const struct place place = robot_place(robot);
    sonar_ping(&robot->rangefinders, &place, sonars, robot->sonar_ranges);
    for (uint8_t i = 0; i < SENSOR_COUNT; i++) {
        if (!(sonars >> i & 1) || robot->sonar_ranges[i] == INFINITY)
            continue;
        const double echo_us = 2e6 * robot->sonar_ranges[i] / SOUND_SPEED;
        sensor_loop_echo(&robot->sensor.loop, i / 2, (uint16_t)(echo_us + 0.5));
    }
}

static void read_infrared(struct robot *robot)
{
    uint16_t counts[INFRARED_COUNT];
    if (robot->sensor.loop.infrared.samples == 0) { /* a GP2D12 holds its output while it measures again */
        const struct place place = robot_place(robot);
        infrared_look(&robot->rangefinders, &place, robot->infrared_distances);
    }
    for (int i = 0; i < INFRARED_COUNT; i++)
        counts[i] = infrared_read(&robot->rangefinders, robot->infrared_distances[i]);
    sensor_loop_infrared(&robot->sensor.loop, counts);
}

static void run_sensor(struct robot *robot)
{
    struct sensor_loop *loop = &robot->sensor.loop;
    if (robot->now_ms < robot->sensor.booted_ms + SENSOR_BOOT_MS)
        return;
    loop->teller.uptime_ms = (uint32_t)(robot->now_ms - robot->sensor.booted_ms - SENSOR_BOOT_MS);
    const struct sensor_work work = sensor_loop_tick(loop);
    if (work.fire)
        fire(robot, work.fire);
    if (work.is_infrared_due)
        read_infrared(robot);
    sensor_board_keep(&robot->sensor, robot->now_ms);
}

static void tick(struct robot *robot)
{
    robot->drive.loop.teller.uptime_ms = (uint32_t)(robot->now_ms - robot->drive.booted_ms);
    if (robot->script.count > 0) {
        run_scripted_drive(robot);
        run_sensor(robot);
    } else {
        run_drive(robot);
        run_sensor(robot);
        const struct duties *duties = &robot->drive.loop.duties;
        body_step(&robot->body, robot->duties);
        robot->duties[0] = (double)duties->left; /* a step takes its time on the board */
        robot->duties[1] = (double)duties->right;
        if (supervisor_is_balancing(&robot->drive.loop.supervisor))
            robot->body.is_held = false; /* the hand lets go */
    }
    robot->now_ms++;
}

void robot_advance(struct robot *robot, int32_t ms)
{
    robot->outbox.size = (uint16_t)(robot->outbox.size - robot->taken); /* answers may have come since */
    memmove(robot->bytes, robot->bytes + robot->taken, robot->outbox.size);
    robot->truth_rows = 0;
    for (int32_t i = 0; i < ms; i++)
        tick(robot);
    robot->taken = robot->outbox.size;
}

static bool is_odometry_next(const struct robot *robot)
{
    return (robot->now_ms + 1) % DRIVE_STEP_MS == 0 && robot->drive.loop.telemetry.phase_ms % STREAM_ODOMETRY_MS == 0;
}

bool robot_stand(struct robot *robot)
{
    const struct command arm = {.kind = COMMAND_ARM, .sequence = robot->drive.loop.supervisor.acknowledged};
    supervisor_obey(&robot->drive.loop.supervisor, &arm);
    for (int32_t i = 0; i < ARMING_PATIENCE_MS; i++) {
        robot_advance(robot, 1);
        if (supervisor_is_balancing(&robot->drive.loop.supervisor) && is_odometry_next(robot))
            break;
    }
    robot_advance(robot, 0);
    robot->start_ms = robot->now_ms;
    return supervisor_is_balancing(&robot->drive.loop.supervisor);
}

void robot_receive(struct robot *robot, const uint8_t *bytes, int32_t count)
{
    for (int32_t i = 0; i < count; i++)
        drive_board_receive(&robot->drive, bytes[i]);
    if (robot->now_ms < robot->sensor.booted_ms + SENSOR_BOOT_MS)
        return;
    for (int32_t i = 0; i < count; i++)
        sensor_loop_receive(&robot->sensor.loop, bytes[i]);
}

void robot_reset_boards(struct robot *robot)
{
    drive_board_reset(&robot->drive, robot->now_ms);
    sensor_board_reset(&robot->sensor, robot->now_ms);
}

void robot_steer(struct robot *robot, double speed, double turn)
{
    const struct command command = {
        .kind = COMMAND_DRIVE,
        .wish = {(float)speed, (float)turn},
        .sequence = robot->drive.loop.supervisor.acknowledged,
    };
    supervisor_obey(&robot->drive.loop.supervisor, &command);
}

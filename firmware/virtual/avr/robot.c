/* SPDX-License-Identifier: Apache-2.0 */
#include "robot.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MS_CYCLES (MICROCONTROLLER_HZ / 1000)
#define US_CYCLES (MICROCONTROLLER_HZ / 1000000)
#define SENSOR_BOOT_MS 12       /* the sensor board wakes so much later */
#define SENSOR_LAG ((uint64_t)SENSOR_BOOT_MS * MS_CYCLES)
#define SENSOR_FAST_PPM 100u    /* by so much its crystal is faster: in 10 s the boards' ticks meet in every phase */
#define MILLION 1000000u
#define FIRST_INPUT 2           /* of a sweep (avr/adc.h) */
#define INFRARED_SWEEPS 3       /* readings of one measurement of a GP2D12 */
#define COUNT_VOLTS (5.0 / 1023.0)
#define DIVIDER 8.0
#define HALL_MIDDLE 2.5
#define HALL_VOLTS 0.1          /* per A */
#define SENSE_VOLTS 0.8294      /* per A */
#define METRES_PER_TICK (2.0 * 3.141592653589793 * BODY_WHEEL_RADIUS / BODY_TICKS_PER_TURN)
#define ECHO_RISE_US 100        /* after the trigger */
#define ECHO_GIVE_UP_US 36000   /* a module without echo */
#define ARMING_PATIENCE_MS 10000
#define FIRST_WORD_MS 100       /* the boards have started */
#define WORD_MS 500             /* between two requests to arm */
#define STEER_MS 100

enum { GYRO, FORWARD, UPWARD, BATTERY, CURRENT, CHARGER, LEFT_MOTOR, RIGHT_MOTOR };
enum { DRIVE, SENSOR };

static const struct {
    char port;
    int bit;
} ECHO_PINS[4] = {{'D', 6}, {'D', 2}, {'D', 3}, {'B', 2}};

/* The sensor board's cycle at a time in cycles of the drive board, and the other way round. */
static uint64_t sensor_cycle(uint64_t cycle)
{
    return (cycle - SENSOR_LAG) * (MILLION + SENSOR_FAST_PPM) / MILLION;
}

static uint64_t cycle_of_sensor(uint64_t cycle)
{
    return cycle * MILLION / (MILLION + SENSOR_FAST_PPM) + SENSOR_LAG;
}

static double volts_of_count(uint16_t count)
{
    return (count + 0.3) * COUNT_VOLTS; /* whole mV on both sides of it are the same count */
}

static double drive_voltage(struct avr_robot *robot, int channel)
{
    const struct body *body = &robot->body;
    uint16_t gyro;
    switch (channel) {
    case GYRO:
        inertial_read(&robot->inertial, body, &gyro, &robot->accelerometer);
        return volts_of_count(gyro);
    case FORWARD:
        return volts_of_count(robot->accelerometer);
    case BATTERY:
        return body->battery.volts / DIVIDER;
    case CURRENT:
        return HALL_MIDDLE + HALL_VOLTS * body->battery.amperes;
    case CHARGER:
        return robot->charger_volts / DIVIDER;
    case LEFT_MOTOR:
        return SENSE_VOLTS * fabs(body->motor_amperes[0]);
    case RIGHT_MOTOR:
        return SENSE_VOLTS * fabs(body->motor_amperes[1]);
    default:
        return 0.0;
    }
}

static void on_drive_convert(void *owner, int channel)
{
    struct avr_robot *robot = owner;
    const double true_volts = drive_voltage(robot, channel);
    const bool is_forced = robot->forced >> channel & 1;
    microcontroller_voltage(robot->drive, channel, is_forced ? robot->forced_volts[channel] : true_volts);
}

static struct place place_of(const struct avr_robot *robot)
{
    const struct body *body = &robot->body;
    const struct place place = {body->x, body->y, body->heading, body->tilt};
    return place;
}

/* A GP2D12 holds its output while it measures again. */
static void on_sensor_convert(void *owner, int channel)
{
    struct avr_robot *robot = owner;
    if (channel == FIRST_INPUT && robot->infrared_sweeps++ % INFRARED_SWEEPS == 0) {
        const struct place place = place_of(robot);
        infrared_look(&robot->rangefinders, &place, robot->infrared_distances);
    }
    const uint16_t counts = infrared_read(&robot->rangefinders, robot->infrared_distances[channel]);
    microcontroller_voltage(robot->sensor, channel, volts_of_count(counts));
}

static void on_drive_pin(void *owner, char port, int bit, bool level)
{
    struct avr_robot *robot = owner;
    if (port != 'C' || bit != 7 || robot->grant_count == AVR_ROBOT_EDGES)
        return;
    const struct grant_edge edge = {microcontroller_cycle(robot->drive), level};
    robot->grants[robot->grant_count++] = edge;
    *(level ? &robot->last_rise : &robot->last_fall) = edge;
}

/* A trigger's rising edge: four modules burst, and their lines fall when they hear, or have waited long enough. */
static void on_sensor_pin(void *owner, char port, int bit, bool level)
{
    struct avr_robot *robot = owner;
    if (port != 'B' || bit > 1 || !level)
        return;
    double ranges[SENSOR_COUNT];
    const struct place place = place_of(robot);
    sonar_ping(&robot->rangefinders, &place, bit == 0 ? 0x55 : 0xAA, ranges);
    for (int line = 0; line < 4; line++) {
        const double range = ranges[2 * line + bit];
        const double echo_us = range == INFINITY ? ECHO_GIVE_UP_US : 2e6 * range / SOUND_SPEED;
        const uint64_t cycles = (uint64_t)(echo_us * US_CYCLES);
        microcontroller_pin_later(robot->sensor, ECHO_PINS[line].port, ECHO_PINS[line].bit, true,
                                  ECHO_RISE_US * US_CYCLES);
        microcontroller_pin_later(robot->sensor, ECHO_PINS[line].port, ECHO_PINS[line].bit, false, cycles);
    }
}

static bool on_bus_start(void *owner, uint8_t address)
{
    return imu_part_start(&((struct avr_robot *)owner)->imu, address);
}

static void on_bus_byte(void *owner, uint8_t byte)
{
    imu_part_take(&((struct avr_robot *)owner)->imu, byte);
}

static uint8_t on_bus_ask(void *owner)
{
    return imu_part_give(&((struct avr_robot *)owner)->imu);
}

struct avr_robot *avr_robot_new(const char *drive_elf, const char *sensor_elf, const struct caster *walls,
                                const double pose[3], uint64_t seed)
{
    struct avr_robot *robot = calloc(1, sizeof *robot);
    if (!robot)
        return NULL;
    const struct wiring drive = {robot, on_drive_convert, on_drive_pin, on_bus_start, on_bus_byte, on_bus_ask};
    const struct wiring sensor = {robot, on_sensor_convert, on_sensor_pin, NULL, NULL, NULL};
    body_init(&robot->body, walls, seed);
    robot->body.x = pose[0];
    robot->body.y = pose[1];
    robot->body.heading = pose[2];
    robot->body.is_held = true;
    inertial_init(&robot->inertial, seed);
    imu_part_init(&robot->imu, seed);
    rangefinders_init(&robot->rangefinders, walls, seed);
    bystander_init(&robot->bystander);
    robot->drive = microcontroller_new(drive_elf, &drive);
    robot->sensor = microcontroller_new(sensor_elf, &sensor);
    if (robot->drive && robot->sensor)
        return robot;
    avr_robot_free(robot);
    return NULL;
}

void avr_robot_free(struct avr_robot *robot)
{
    if (robot->drive)
        microcontroller_free(robot->drive);
    if (robot->sensor)
        microcontroller_free(robot->sensor);
    free(robot);
}

void avr_robot_duties(const struct avr_robot *robot, double duties[2])
{
    const bool is_braked = microcontroller_output(robot->drive, 'C', 6);
    for (int side = 0; side < 2; side++) {
        const double duty = is_braked ? 0.0 : microcontroller_pwm(robot->drive, side);
        duties[side] = microcontroller_output(robot->drive, 'D', 6 + side) ? duty : -duty;
    }
}

/* GRANT is high for 3 ms in 20: no older grant can meet a byte of the last ms. */
static bool is_within_grant(const struct avr_robot *robot, const struct sent_byte *sent)
{
    const uint64_t rise = robot->last_rise.cycle, fall = robot->last_fall.cycle;
    return rise > 0 && sent->end > rise && (fall < rise || sent->start < fall);
}

/* Hands one byte to the modem and looks whether the other board was speaking. */
static void collect_byte(struct avr_robot *robot, int board, const struct sent_byte *sent)
{
    if (robot->muted >> board & 1)
        return;
    for (int i = 0; i < AVR_ROBOT_RECENT; i++) {
        const struct sent_byte *theirs = &robot->recent[1 - board][i];
        robot->collisions += sent->start < theirs->end && theirs->start < sent->end;
    }
    robot->trespasses += board == DRIVE && is_within_grant(robot, sent);
    robot->recent[board][robot->sent[board]++ % AVR_ROBOT_RECENT] = *sent;
    if (board == DRIVE)
        bystander_hear(&robot->bystander, robot->now_ms, sent->byte);
    if (robot->size < AVR_ROBOT_BYTES)
        robot->bytes[robot->size++] = sent->byte;
}

/* Both boards' bytes of the last ms in the order of their time. */
static void collect(struct avr_robot *robot)
{
    struct sent_byte drive[MICROCONTROLLER_SENT], sensor[MICROCONTROLLER_SENT];
    const int32_t drives = microcontroller_take_sent(robot->drive, drive);
    const int32_t sensors = microcontroller_take_sent(robot->sensor, sensor);
    for (int32_t i = 0; i < sensors; i++) {
        sensor[i].start = cycle_of_sensor(sensor[i].start);
        sensor[i].end = cycle_of_sensor(sensor[i].end);
    }
    for (int32_t i = 0, j = 0; i < drives || j < sensors;) {
        if (j == sensors || (i < drives && drive[i].start <= sensor[j].start))
            collect_byte(robot, DRIVE, &drive[i++]);
        else
            collect_byte(robot, SENSOR, &sensor[j++]);
    }
}

static void turn_wheels(struct avr_robot *robot)
{
    for (int side = 0; side < 2; side++) {
        const double metres = robot->body.wheels[side] * BODY_WHEEL_RADIUS;
        microcontroller_turn(robot->drive, side, (int64_t)floor(metres / METRES_PER_TICK));
    }
}

static bool run_drive(struct avr_robot *robot)
{
    robot->grant_count = 0;
    turn_wheels(robot);
    const bool runs = microcontroller_run(robot->drive, (robot->now_ms + 1) * MS_CYCLES);
    if (microcontroller_resets(robot->drive) != robot->drive_starts) {
        robot->drive_starts = microcontroller_resets(robot->drive);
        bystander_boot(&robot->bystander, robot->now_ms);
        robot->last_fall.cycle = microcontroller_cycle(robot->drive); /* a reset lets go of GRANT without a word */
    }
    return runs;
}

static bool run_sensor(struct avr_robot *robot)
{
    if (robot->now_ms < SENSOR_BOOT_MS)
        return true;
    for (int32_t i = 0; i < robot->grant_count; i++) {
        const struct grant_edge *edge = &robot->grants[i];
        if (!microcontroller_run(robot->sensor, sensor_cycle(edge->cycle)))
            return false;
        microcontroller_pin(robot->sensor, 'D', 7, edge->level);
    }
    const bool runs = microcontroller_run(robot->sensor, sensor_cycle((robot->now_ms + 1) * MS_CYCLES));
    microcontroller_pin(robot->sensor, 'D', 7, microcontroller_output(robot->drive, 'C', 7)); /* reset floats it low */
    return runs;
}

static void move(struct avr_robot *robot)
{
    double duties[2];
    avr_robot_duties(robot, duties);
    if (!microcontroller_output(robot->drive, 'C', 6) && robot->now_ms > SENSOR_BOOT_MS)
        robot->body.is_held = false; /* the hand lets go when the motors come on */
    body_step(&robot->body, duties);
}

bool avr_robot_advance(struct avr_robot *robot, int32_t ms)
{
    robot->size = 0;
    robot->bystander.truth_rows = 0;
    for (int32_t i = 0; i < ms && !robot->has_crashed; i++) {
        const struct place place = place_of(robot);
        bystander_note(&robot->bystander, robot->now_ms, &place);
        imu_part_measure(&robot->imu, &robot->body);
        robot->has_crashed = !run_drive(robot) || !run_sensor(robot);
        collect(robot);
        move(robot);
        robot->now_ms++;
    }
    return !robot->has_crashed;
}

static void deliver(struct avr_robot *robot, const uint8_t *bytes, int32_t count)
{
    microcontroller_receive(robot->drive, bytes, count);
    if (robot->now_ms >= SENSOR_BOOT_MS)
        microcontroller_receive(robot->sensor, bytes, count);
}

void avr_robot_receive(struct avr_robot *robot, const uint8_t *bytes, int32_t count)
{
    for (int32_t i = 0; i < count; i++)
        bystander_ask(&robot->bystander, robot->now_ms, bytes[i]);
    deliver(robot, bytes, count);
}

void avr_robot_steer(struct avr_robot *robot, double speed, double turn)
{
    uint8_t bytes[LINK_MAX_ENCODED + 1];
    if (robot->now_ms < robot->steer_ms)
        return;
    robot->steer_ms = robot->now_ms + STEER_MS;
    bystander_ask(&robot->bystander, robot->now_ms, 0); /* the delimiter before it ends what was cut */
    deliver(robot, bytes, bystander_drive(&robot->bystander, speed, turn, robot->now_ms, bytes));
}

static void ask_to_arm(struct avr_robot *robot)
{
    uint8_t bytes[LINK_MAX_ENCODED + 1];
    deliver(robot, bytes, bystander_arm(&robot->bystander, robot->now_ms, bytes));
}

static bool is_line_silent(const struct avr_robot *robot)
{
    for (int i = 0; i < AVR_ROBOT_RECENT; i++)
        for (int board = 0; board < 2; board++)
            if (robot->recent[board][i].end > robot->now_ms * MS_CYCLES)
                return false;
    return true;
}

bool avr_robot_stand(struct avr_robot *robot)
{
    const struct bystander *bystander = &robot->bystander;
    bool stands = false;
    for (int32_t i = 0; i < ARMING_PATIENCE_MS && !stands; i++) {
        if (i % WORD_MS == FIRST_WORD_MS && !bystander_sees_balance(bystander))
            ask_to_arm(robot);
        if (!avr_robot_advance(robot, 1))
            return false;
        stands = bystander_sees_balance(bystander) && bystander_is_odometry_next(bystander, robot->now_ms) &&
                 is_line_silent(robot);
    }
    avr_robot_advance(robot, 0);
    robot->start_ms = robot->now_ms;
    return stands;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "modules.h"

#include "../../../firmware/link/crc.h"
#include "../../../firmware/link/streams.h"

#include <string.h>

#define FULL_SUM 5115u /* of an ADC's readings */

struct writer {
    uint8_t *at;
};

void modules_init(struct modules *modules, uint32_t seed)
{
    memset(modules, 0, sizeof *modules);
    modules->random = seed;
    tilt_init(&modules->tilt);
    odometry_init(&modules->odometry, 0, 0);
    balance_init(&modules->balance);
    supervisor_init(&modules->supervisor);
    drive_settings_init(&modules->settings);
    motor_supervisor_init(&modules->motor_supervisor, STOP_BOOT);
    ramp_init(&modules->ramp);
}

/* Marsaglia's xorshift. */
static uint16_t draw(struct modules *modules)
{
    modules->random ^= modules->random << 13;
    modules->random ^= modules->random >> 17;
    modules->random ^= modules->random << 5;
    return (uint16_t)(modules->random >> 8);
}

static uint16_t draw_below(struct modules *modules, uint16_t n)
{
    return (uint16_t)(draw(modules) % n);
}

/* Within +-limit. */
static float draw_float(struct modules *modules, float limit)
{
    return ((float)draw(modules) - 32768.0f) / 32768.0f * limit;
}

static void tell(struct writer *writer, const void *bytes, uint8_t size)
{
    memcpy(writer->at, bytes, size);
    writer->at += size;
}

static void step_tilt(struct modules *modules, struct writer *writer)
{
    struct tilt *tilt = &modules->tilt;
    const bool is_still = draw_below(modules, 400) != 0; /* often for long enough to learn the zeros */
    const struct inertial_sums sums = {
        .gyro = is_still ? (uint16_t)(2560 + draw_below(modules, 8)) : draw_below(modules, FULL_SUM + 1),
        .accelerometer = draw_below(modules, FULL_SUM + 1),
    };
    tilt_step(tilt, &sums);
    const uint8_t told[] = {tilt_rest(tilt, &sums), draw_below(modules, 64) == 0 && tilt_level(tilt)};
    const float floats[] = {
        tilt->angle, tilt->rate, tilt->gyro_zero, tilt->accelerometer_zero, tilt->rest_sum, tilt->level_sum, tilt->level,
        tilt->rest_low, tilt->rest_high, tilt_of_gravity(tilt, &sums),
    };
    tell(writer, floats, sizeof floats);
    tell(writer, told, sizeof told);
}

static void step_odometry(struct modules *modules, struct writer *writer)
{
    struct odometry *odometry = &modules->odometry;
    const uint16_t left = (uint16_t)(odometry->left_ticks + draw_below(modules, 41) - 20);
    const uint16_t right = (uint16_t)(odometry->right_ticks + draw_below(modules, 41) - 20);
    const struct rolled rolled = odometry_step(odometry, left, right, draw_float(modules, 4.0f));
    const float floats[] = {
        rolled.distance, rolled.speed, rolled.angle, rolled.turn_rate, odometry->forward.speed, odometry->forward.lag,
        odometry->turn.speed, odometry->turn.lag,
    };
    tell(writer, floats, sizeof floats);
}

static void step_agreement(struct modules *modules, struct writer *writer)
{
    struct agreement *agreement = &modules->agreement;
    const float speed = draw_float(modules, 0.5f);
    if (draw_below(modules, 64) == 0)
        agreement_rest(agreement, speed);
    agreement_step(agreement, speed, draw_float(modules, 0.4f), draw_float(modules, 1.4f));
    const float floats[] = {agreement->wheels, agreement->body, agreement->speed};
    const uint8_t accord = (uint8_t)agreement_judge(agreement);
    tell(writer, floats, sizeof floats);
    tell(writer, &accord, 1);
}

static void step_balance(struct modules *modules, struct writer *writer)
{
    struct balance *balance = &modules->balance;
    const struct lean lean = {draw_float(modules, 0.2f), draw_float(modules, 1.0f)};
    const struct rolled rolled = {
        .distance = draw_float(modules, 0.01f), .speed = draw_float(modules, 0.5f),
        .angle = draw_float(modules, 0.1f), .turn_rate = draw_float(modules, 3.0f),
    };
    const bool is_standing = modules->random & 0x80u; /* for long enough to learn the trim */
    const float limit = is_standing ? 0.0f : 1.0f;
    const struct drive_wish wish = {draw_float(modules, 0.6f * limit), draw_float(modules, 3.0f * limit)};
    if (draw_below(modules, 256) == 0)
        balance_rest(balance);
    if (is_standing) {
        balance->wanted_speed = balance->wanted_turn = 0.0f;
        balance->standing = 4.0f;
    }
    const struct duties duties = balance_step(balance, &lean, &rolled, &wish, 27.0f + draw_float(modules, 10.0f));
    const float floats[] = {
        duties.left, duties.right, balance->wanted_speed, balance->wanted_turn, balance->ahead, balance->heading_ahead,
        balance->soft_start, balance->standing, balance->trim,
    };
    tell(writer, floats, sizeof floats);
}

/* A drive command as the host would send it, sometimes stale. */
static struct command draw_command(struct modules *modules)
{
    struct frame frame = {.source = SOURCE_HOST, .channel = CHANNEL_DRIVE, .size = sizeof(struct drive_payload)};
    struct drive_payload payload = {
        .speed = (int16_t)(draw_below(modules, 1401) - 700), .turn = (int16_t)(draw_below(modules, 7001) - 3500),
        .echo_ms = draw(modules),
    };
    payload.check = crc32_of((const uint8_t *)&payload, sizeof payload - sizeof payload.check);
    memcpy(frame.payload, &payload, sizeof payload);
    return command_of_frame(&frame, (uint16_t)(payload.echo_ms + draw_below(modules, 1250)));
}

static void step_command(struct modules *modules, struct writer *writer)
{
    const struct command command = draw_command(modules);
    const uint8_t kind = (uint8_t)command.kind;
    supervisor_obey(&modules->supervisor, &command);
    tell(writer, &command.wish, sizeof command.wish);
    tell(writer, &kind, 1);
}

static void step_supervisor(struct modules *modules, struct writer *writer)
{
    struct supervisor *supervisor = &modules->supervisor;
    if (draw_below(modules, 64) == 0) { /* what must last is held */
        modules->battery_mv = (uint16_t)(23000 + draw_below(modules, 10000));
        modules->charger_mv = (uint16_t)(draw_below(modules, 8) == 0 ? 6000 : 0);
        modules->motor_ma = draw_below(modules, 5500);
    }
    const struct drive_health health = {
        .tilt = draw_float(modules, draw_below(modules, 64) == 0 ? 1.0f : 0.3f), .is_rested = true,
        .tilt_rate = draw_float(modules, 3.0f), .rail_steps = draw_below(modules, 5),
        .accord = draw_below(modules, 64) == 0 ? ACCORD_WHEELS_ALONE : ACCORD,
        .duty = {draw_float(modules, 1.0f), draw_float(modules, 1.0f)},
        .wheel_speed = {draw_float(modules, 0.1f), draw_float(modules, 0.1f)},
        .battery_mv = modules->battery_mv, .charger_mv = modules->charger_mv, .motor_ma = modules->motor_ma,
    };
    if (draw_below(modules, 16) == 0)
        supervisor->state = DRIVE_ARMED;
    if (draw_below(modules, 32) == 0)
        supervisor->silent_ms = SUPERVISOR_LINK_MS;
    const uint8_t told[] = {supervisor_step(supervisor, &health), supervisor->state, supervisor->reason};
    const struct drive_wish wish = supervisor_wish(supervisor);
    tell(writer, &wish, sizeof wish);
    tell(writer, &supervisor->wish, sizeof supervisor->wish);
    tell(writer, &supervisor->ceiling, sizeof supervisor->ceiling);
    tell(writer, told, sizeof told);
}

/* In and out of its bounds; most whole numbers are no period. */
static void step_settings(struct modules *modules, struct writer *writer)
{
    static const float PERIODS[] = {5.0f, 20.0f, 40.0f, 80.0f, 200.0f, 400.0f, 500.0f, 2000.0f, 30.0f, 0.0f};
    struct settings *settings = &modules->settings;
    const uint8_t setting = (uint8_t)draw_below(modules, DRIVE_SETTINGS);
    const struct bounds *bounds = &settings->bounds[setting];
    const float middle = 0.5f * (bounds->low + bounds->high);
    const float value = setting < STREAM_COUNT ? PERIODS[draw_below(modules, sizeof PERIODS / sizeof PERIODS[0])]
                                               : middle + draw_float(modules, 1.2f * (bounds->high - middle));
    const uint8_t outcome = (uint8_t)settings_set(settings, setting, value);
    const uint16_t load = streams_load(settings->values);
    tell(writer, &outcome, 1);
    tell(writer, &load, sizeof load);
    tell(writer, &settings->values[setting], sizeof(float));
}

static void step_power(struct modules *modules, struct writer *writer)
{
    const struct supply_sums sums = {
        .battery = draw_below(modules, FULL_SUM + 1), .current = draw_below(modules, FULL_SUM + 1),
        .charger = draw_below(modules, FULL_SUM + 1),
        .motors = {draw_below(modules, FULL_SUM + 1), draw_below(modules, FULL_SUM + 1)},
    };
    const bool is_reverse[2] = {draw_below(modules, 2) == 1, draw_below(modules, 2) == 1};
    const struct supplies supplies = power_supplies(&sums, is_reverse);
    tell(writer, &supplies, sizeof supplies);
}

/* Powers as the host would send them, sometimes stale or beyond full, or a stop. */
static struct motor_command draw_powers(struct modules *modules)
{
    struct frame frame = {.source = SOURCE_HOST, .channel = CHANNEL_POWERS, .size = sizeof(struct powers_payload)};
    struct powers_payload payload = {
        .left = (int16_t)(draw_below(modules, 21001) - 10500), .right = (int16_t)(draw_below(modules, 21001) - 10500),
        .deadline_ms = draw_below(modules, draw_below(modules, 2) == 0 ? 100 : 1500), .echo_ms = draw(modules),
    };
    payload.check = crc32_of((const uint8_t *)&payload, sizeof payload - sizeof payload.check);
    memcpy(frame.payload, &payload, sizeof payload);
    const uint16_t now_ms = (uint16_t)(payload.echo_ms + draw_below(modules, 1100));
    struct motor_command command = motor_command_of_frame(&frame, now_ms);
    if (draw_below(modules, 16) == 0)
        command.kind = MOTOR_STOP;
    return command;
}

/* Several ms, for a deadline and a battery's second to pass now and then. */
static void step_motor(struct modules *modules, struct writer *writer)
{
    struct motor_supervisor *supervisor = &modules->motor_supervisor;
    const struct motor_command command = draw_powers(modules);
    motor_supervisor_obey(supervisor, &command);
    if (draw_below(modules, 32) == 0)
        modules->motor_sum = (uint16_t)(2300 + draw_below(modules, 800));
    const uint16_t mv = battery_mv(modules->motor_sum);
    for (uint16_t ms = draw_below(modules, 120); ms > 0; ms--) {
        motor_supervisor_step(supervisor, mv);
        ramp_step(&modules->ramp, supervisor->wanted[0]);
    }
    const uint16_t told[] = {
        mv, (uint16_t)modules->ramp.power, modules->ramp.rested_ms, modules->ramp.is_reverse, supervisor->state,
        supervisor->reason, supervisor->left_ms, supervisor->battery_ms, (uint16_t)supervisor->wanted[1],
        supervisor->refused, (uint16_t)command.kind, command.deadline_ms,
    };
    tell(writer, told, sizeof told);
}

uint8_t modules_step(struct modules *modules, uint8_t out[MODULES_MAX_STEP])
{
    struct writer writer = {out};
    step_tilt(modules, &writer);
    step_odometry(modules, &writer);
    step_agreement(modules, &writer);
    step_balance(modules, &writer);
    step_command(modules, &writer);
    step_supervisor(modules, &writer);
    step_settings(modules, &writer);
    step_power(modules, &writer);
    step_motor(modules, &writer);
    return (uint8_t)(writer.at - out);
}

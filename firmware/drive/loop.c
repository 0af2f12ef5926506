/* SPDX-License-Identifier: Apache-2.0 */
#include "loop.h"

#include "arithmetic.h"

#include <string.h>

#define MAX_DUTY_BYTE 127.0f
#define WATCHDOG_RESET 0x08 /* MCUCSR: WDRF */

static void apply_settings(struct drive_loop *loop)
{
    const float *values = loop->adjuster.settings.values;
    memcpy(&loop->balance.gains, values + SETTING_TILT, sizeof loop->balance.gains);
    loop->tilt.time_constant = values[SETTING_TIME_CONSTANT];
    if (values[SETTING_LEVEL] != loop->level)
        loop->balance.trim = 0.0f; /* it was learned for another */
    loop->level = values[SETTING_LEVEL];
    loop->tilt.accelerometer_zero = TILT_ZERO_COUNTS + loop->level / TILT_G_PER_COUNT;
    loop->telemetry.odometry_ms = (uint16_t)values[SETTING_ODOMETRY_MS];
    loop->telemetry.balance_ms = (uint16_t)values[SETTING_BALANCE_MS];
}

void drive_loop_init(struct drive_loop *loop, const struct boot *boot, struct outbox *outbox)
{
    memset(loop, 0, sizeof *loop);
    teller_init(&loop->teller, SOURCE_DRIVE, boot, outbox);
    tilt_init(&loop->tilt);
    odometry_init(&loop->odometry, 0, 0);
    balance_init(&loop->balance);
    supervisor_init(&loop->supervisor);
    if (boot->reset_cause & WATCHDOG_RESET)
        loop->supervisor.reason = STOP_WATCHDOG;
    telemetry_init(&loop->telemetry);
    frame_decoder_init(&loop->decoder);
    drive_settings_init(&loop->adjuster.settings);
    apply_settings(loop);
}

void drive_loop_load(struct drive_loop *loop, const uint8_t *record)
{
    settings_load(&loop->adjuster.settings, record);
    apply_settings(loop);
}

static void answer_zeroing(struct drive_loop *loop, const struct adjustment *zeroing, enum adjust_outcome outcome)
{
    adjust_answer(&loop->adjuster, &loop->teller, zeroing, outcome, loop->tilt.gyro_zero);
    loop->is_zeroing = false;
}

/* The gyro is zeroed over the second that follows; the answer comes after it. */
static void begin_zeroing(struct drive_loop *loop, const struct adjustment *adjustment)
{
    if (supervisor_is_balancing(&loop->supervisor)) {
        answer_zeroing(loop, adjustment, OUTCOME_MOVING);
        return;
    }
    loop->zeroing = *adjustment;
    if (loop->is_zeroing) /* asked again: it is under way */
        return;
    loop->is_zeroing = true;
    loop->zeroing_steps = 0;
    tilt_zero(&loop->tilt);
}

/* A body that moved, or began to balance, has fewer steps of rest than went by. */
static void judge_zeroing(struct drive_loop *loop)
{
    if (!loop->is_zeroing)
        return;
    loop->zeroing_steps++;
    if (loop->tilt.rest_steps != loop->zeroing_steps % TILT_REST_STEPS)
        answer_zeroing(loop, &loop->zeroing, OUTCOME_MOVING);
    else if (loop->zeroing_steps == TILT_REST_STEPS)
        answer_zeroing(loop, &loop->zeroing, loop->tilt.is_rested ? OUTCOME_DONE : OUTCOME_BOUNDS);
}

/* The robot is held upright: what the accelerometer shows now becomes the setting, to be stored like the others. */
static void learn_level(struct drive_loop *loop, const struct adjustment *adjustment)
{
    struct settings *settings = &loop->adjuster.settings;
    const bool is_learned = !supervisor_is_balancing(&loop->supervisor) && tilt_level(&loop->tilt);
    enum adjust_outcome outcome = OUTCOME_MOVING;
    if (is_learned)
        outcome = settings_set(settings, SETTING_LEVEL,
                               (loop->tilt.accelerometer_zero - TILT_ZERO_COUNTS) * TILT_G_PER_COUNT);
    apply_settings(loop);
    adjust_answer(&loop->adjuster, &loop->teller, adjustment, outcome, settings->values[SETTING_LEVEL]);
}

static void obey_adjustment(struct drive_loop *loop, const struct adjustment *adjustment)
{
    if (adjustment->verb == VERB_ZERO_GYRO) {
        begin_zeroing(loop, adjustment);
        return;
    }
    if (adjustment->verb == VERB_LEVEL) {
        learn_level(loop, adjustment);
        return;
    }
    const bool is_level = adjustment->verb == VERB_BUILT_IN ||
                          (adjustment->verb == VERB_SET && adjustment->setting == SETTING_LEVEL);
    if (is_level && supervisor_is_balancing(&loop->supervisor)) { /* it would lurch */
        adjust_answer(&loop->adjuster, &loop->teller, adjustment, OUTCOME_MOVING, loop->level);
        return;
    }
    adjust_obey(&loop->adjuster, &loop->teller, adjustment);
    apply_settings(loop);
}

static void take_adjustment(struct drive_loop *loop, const struct frame *frame)
{
    struct adjustment adjustment;
    const enum adjust_judgement judged = adjust_of_frame(frame, SOURCE_DRIVE, loop->teller.uptime_ms, &adjustment);
    if (judged == ADJUST_GOOD)
        obey_adjustment(loop, &adjustment);
    else if (judged == ADJUST_REFUSED)
        supervisor_refuse(&loop->supervisor);
}

enum command_kind drive_loop_receive(struct drive_loop *loop, uint8_t byte)
{
    struct frame frame;
    if (!frame_decoder_feed(&loop->decoder, byte, &frame))
        return COMMAND_REFUSED;
    if (frame.channel == CHANNEL_ADJUST) {
        take_adjustment(loop, &frame);
        return COMMAND_REFUSED;
    }
    const struct command command = command_of_frame(&frame, loop->teller.uptime_ms);
    supervisor_obey(&loop->supervisor, &command);
    return command.kind;
}

static int16_t rounded(float value, float limit)
{
    const float whole = limited(value, limit);
    return (int16_t)(whole < 0.0f ? whole - 0.5f : whole + 0.5f);
}

static void tell_odometry(struct drive_loop *loop, const struct drive_samples *samples)
{
    const struct odometry_payload payload = {
        .left_ticks = (int16_t)samples->left_ticks,
        .right_ticks = (int16_t)samples->right_ticks,
        .tilt = rounded(loop->tilt.angle * 10000.0f, 32767.0f),
    };
    teller_tell(&loop->teller, CHANNEL_ODOMETRY, loop->teller.uptime_ms, &payload, sizeof payload);
}

static void tell_balance(struct drive_loop *loop)
{
    const struct balance_payload payload = {
        .tilt_rate = rounded(loop->tilt.rate * 1000.0f, 32767.0f),
        .position_error = rounded(loop->balance.ahead * -1000.0f, 32767.0f),
        .left_duty = (int8_t)rounded(loop->duties.left * MAX_DUTY_BYTE, MAX_DUTY_BYTE),
        .right_duty = (int8_t)rounded(loop->duties.right * MAX_DUTY_BYTE, MAX_DUTY_BYTE),
        .state = loop->supervisor.state,
        .reason = loop->supervisor.reason,
        .acknowledged = loop->supervisor.acknowledged,
    };
    teller_tell(&loop->teller, CHANNEL_BALANCE, loop->teller.uptime_ms, &payload, sizeof payload);
}

static void tell_power(struct drive_loop *loop, const struct supplies *supplies)
{
    const struct power_payload payload = {
        .battery_mv = supplies->battery_mv, .battery_ma = supplies->battery_ma,
        .charger_mv = supplies->charger_mv, .charger_ma = supplies->charger_ma,
        .left_motor_ma = supplies->motor_ma[0], .right_motor_ma = supplies->motor_ma[1],
    };
    teller_tell(&loop->teller, CHANNEL_POWER, loop->teller.uptime_ms, &payload, sizeof payload);
}

static void tell_last_words(struct drive_loop *loop)
{
    const struct ending *ending = &loop->teller.boot.ending;
    const struct last_words_payload payload = {
        .state = ending->state, .reason = ending->reason, .since_ms = ending->since_ms, .uptime_ms = ending->uptime_ms,
    };
    teller_tell(&loop->teller, CHANNEL_LAST_WORDS, loop->teller.uptime_ms, &payload, sizeof payload);
}

uint8_t drive_loop_tell(struct drive_loop *loop, const struct drive_samples *samples)
{
    const struct supervisor *supervisor = &loop->supervisor;
    const uint8_t due = telemetry_step(&loop->telemetry, supervisor->state);
    judge_zeroing(loop);
    if (due & TELEMETRY_ODOMETRY)
        tell_odometry(loop, samples);
    if (due & TELEMETRY_BALANCE)
        tell_balance(loop);
    if (due & TELEMETRY_POWER)
        tell_power(loop, &samples->supplies);
    if (due & TELEMETRY_STATUS)
        teller_tell_status(&loop->teller, supervisor->state, supervisor->reason, loop->decoder.rejected,
                           supervisor->refused);
    if (due & TELEMETRY_LAST_WORDS && loop->teller.boot.ending.uptime_ms > 0)
        tell_last_words(loop);
    return due;
}

static struct drive_health health_of(const struct drive_loop *loop, const struct drive_samples *samples, bool is_rested,
                                     const struct rolled *rolled)
{
    const float turning = rolled->turn_rate * 0.5f * ODOMETRY_TRACK;
    const float forward = loop->odometry.forward.speed;
    const struct supplies *supplies = &samples->supplies;
    const int16_t left = supplies->motor_ma[0], right = supplies->motor_ma[1];
    const struct drive_health health = {
        .tilt = loop->tilt.angle,
        .tilt_rate = loop->tilt.rate,
        .is_rested = is_rested,
        .rail_steps = loop->tilt.rail_steps,
        .accord = agreement_judge(&loop->agreement),
        .duty = {magnitude(loop->wanted.left), magnitude(loop->wanted.right)},
        .wheel_speed = {magnitude(forward - turning), magnitude(forward + turning)},
        .battery_mv = supplies->battery_mv,
        .charger_mv = supplies->charger_mv,
        .motor_ma = (uint16_t)greater(magnitude((float)left), magnitude((float)right)),
    };
    return health;
}

static void compare(struct drive_loop *loop, const struct rolled *rolled)
{
    if (supervisor_is_balancing(&loop->supervisor))
        agreement_step(&loop->agreement, rolled->speed, loop->tilt.angle, loop->tilt.gravity);
    else
        agreement_rest(&loop->agreement, rolled->speed);
}

static void note_ending(struct drive_loop *loop)
{
    const struct supervisor *supervisor = &loop->supervisor;
    struct ending *ending = &loop->ending;
    if (ending->state != supervisor->state || ending->reason != supervisor->reason)
        ending->since_ms = loop->teller.uptime_ms;
    ending->state = supervisor->state;
    ending->reason = supervisor->reason;
    ending->uptime_ms = loop->teller.uptime_ms;
}

static void motors_off(struct drive_loop *loop)
{
    balance_rest(&loop->balance);
    loop->wanted.left = loop->wanted.right = 0.0f;
    loop->duties = loop->wanted;
}

void drive_loop_step(struct drive_loop *loop, const struct drive_samples *samples)
{
    const bool was_balancing = supervisor_is_balancing(&loop->supervisor);
    tilt_step(&loop->tilt, &samples->inertial);
    const bool is_rested = !was_balancing && tilt_rest(&loop->tilt, &samples->inertial);
    if (was_balancing) {
        loop->tilt.is_rested = false;
        tilt_zero(&loop->tilt); /* the second of rest begins anew */
    }
    const struct rolled rolled =
        odometry_step(&loop->odometry, samples->left_ticks, samples->right_ticks, loop->tilt.rate);
    compare(loop, &rolled);
    const struct drive_health health = health_of(loop, samples, is_rested, &rolled);
    if (supervisor_step(&loop->supervisor, &health)) {
        const struct lean lean = {loop->tilt.angle, loop->tilt.rate};
        const struct drive_wish wish = supervisor_wish(&loop->supervisor);
        const float battery = (float)samples->supplies.battery_mv * 0.001f;
        loop->wanted = balance_step(&loop->balance, &lean, &rolled, &wish, battery);
        loop->duties.left = limited(loop->wanted.left, loop->supervisor.ceiling);
        loop->duties.right = limited(loop->wanted.right, loop->supervisor.ceiling);
    } else {
        motors_off(loop);
    }
    note_ending(loop);
}

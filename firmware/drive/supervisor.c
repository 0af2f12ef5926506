/* SPDX-License-Identifier: Apache-2.0 */
#include "supervisor.h"

#include "arithmetic.h"

#define MAX_SPEED 0.6f       /* m/s that may be asked for */
#define MAX_TURN 3.0f        /* rad/s */
#define MAX_WHEEL_SPEED 0.75f /* m/s of the faster wheel: what the motors have left is for balancing */
#define DISCORD_MS 50         /* a shove of 25 N parts the accounts for less */
#define SATURATED_DUTY 0.95f
#define STUCK_DUTY 0.3f
#define STUCK_SPEED 0.02f    /* m/s: one tick of the encoder's now and then */
#define STALL_MS 400
#define TUMBLING_RATE 2.5f   /* rad/s: the gyro's range ends at 2.6, and the tilt that it makes comes late */
#define TUMBLING_MS 50
#define MAX_CURRENT_MA 5000
#define CURRENT_MS 20
#define WARM_CURRENT_MA 3000 /* what a bridge bears for ever */
#define WARM_STEPS 20         /* 100 ms */
#define CEILING_FALL 0.02f   /* of duty in a step */
#define CEILING_RISE 0.005f
#define RAIL_STEPS 4         /* 20 ms; a sound part's own range ends a quarter of a volt before the converter's */
#define EMPTY_BATTERY_MV 24000
#define RESTED_BATTERY_MV 25000 /* what an empty one shows without a load is less */
#define SUPPLY_MS 200
#define CHARGER_MV 5000

void supervisor_init(struct supervisor *supervisor)
{
    const struct supervisor fresh = {.state = DRIVE_DISARMED, .reason = STOP_BOOT, .silent_ms = UINT16_MAX,
                                     .ceiling = 1.0f};
    *supervisor = fresh;
}

bool supervisor_is_balancing(const struct supervisor *supervisor)
{
    return supervisor->state == DRIVE_ARMED || supervisor->state == DRIVE_LINK_LOST;
}

static void halt(struct supervisor *supervisor)
{
    supervisor->wish.speed = 0.0f;
    supervisor->wish.turn = 0.0f;
}

static void switch_off(struct supervisor *supervisor, uint8_t state, uint8_t reason)
{
    supervisor->state = state;
    supervisor->reason = reason;
    supervisor->is_arm_wanted = false;
    supervisor->upright_ms = supervisor->saturated_ms = supervisor->tumbling_ms = 0;
    supervisor->current_ms = supervisor->discord_ms = 0;
    supervisor->stuck_ms[0] = supervisor->stuck_ms[1] = 0;
    halt(supervisor);
}

static void take_wish(struct supervisor *supervisor, const struct drive_wish *wish)
{
    supervisor->wish.speed = limited(wish->speed, MAX_SPEED);
    const float left_for_turning = (MAX_WHEEL_SPEED - magnitude(supervisor->wish.speed)) / (0.5f * ODOMETRY_TRACK);
    supervisor->wish.turn = limited(wish->turn, left_for_turning < MAX_TURN ? left_for_turning : MAX_TURN);
}

static void ask_to_arm(struct supervisor *supervisor)
{
    if (supervisor_is_balancing(supervisor) || supervisor->is_arm_wanted)
        return; /* asked again: the wait goes on */
    supervisor->state = DRIVE_DISARMED;
    supervisor->is_arm_wanted = true;
    supervisor->upright_ms = supervisor->wanted_ms = 0;
}

void supervisor_refuse(struct supervisor *supervisor)
{
    if (supervisor->refused < UINT16_MAX)
        supervisor->refused++;
}

void supervisor_obey(struct supervisor *supervisor, const struct command *command)
{
    if (command->kind == COMMAND_REFUSED) {
        supervisor_refuse(supervisor);
        return;
    }
    supervisor->acknowledged = command->sequence;
    supervisor->silent_ms = 0;
    if (supervisor->state == DRIVE_LINK_LOST)
        supervisor->state = DRIVE_ARMED;
    switch (command->kind) {
    case COMMAND_DRIVE:
        take_wish(supervisor, &command->wish);
        break;
    case COMMAND_STOP:
        halt(supervisor);
        supervisor->is_arm_wanted = false;
        if (supervisor_is_balancing(supervisor)) /* what lies keeps the reason why */
            supervisor->reason = STOP_COMMAND;
        break;
    case COMMAND_ARM:
        ask_to_arm(supervisor);
        break;
    default:
        switch_off(supervisor, DRIVE_DISARMED, STOP_COMMAND);
    }
}

/* Counts how long a condition has lasted. */
static uint16_t lasting(uint16_t ms, bool is_true)
{
    if (!is_true)
        return 0;
    return ms < UINT16_MAX - SUPERVISOR_STEP_MS ? (uint16_t)(ms + SUPERVISOR_STEP_MS) : ms;
}

static bool is_within(float tilt, float limit)
{
    return magnitude(tilt) < limit;
}

static void judge_arming(struct supervisor *supervisor, const struct drive_health *health)
{
    const bool is_free = supervisor->stays == STOP_NONE && supervisor->ceiling == 1.0f;
    const bool is_upright = health->is_rested && is_within(health->tilt, SUPERVISOR_ARM_TILT);
    const bool may_arm = supervisor->is_arm_wanted && is_free && is_upright;
    supervisor->upright_ms = lasting(supervisor->upright_ms, may_arm);
    supervisor->wanted_ms = lasting(supervisor->wanted_ms, supervisor->is_arm_wanted);
    if (supervisor->wanted_ms >= SUPERVISOR_ARM_PATIENCE_MS)
        supervisor->is_arm_wanted = false;
    if (supervisor->upright_ms < SUPERVISOR_ARM_MS)
        return;
    supervisor->state = DRIVE_ARMED;
    supervisor->reason = STOP_NONE;
    supervisor->silent_ms = 0;
    halt(supervisor);
}

/* A robot that balances on one wheel drives the blocked one back and forth: only motion ends the count. */
static uint16_t judge_stuck(uint16_t ms, float duty, float speed)
{
    if (speed > STUCK_SPEED)
        return 0;
    return duty > STUCK_DUTY ? lasting(ms, true) : ms;
}

static void count_hazards(struct supervisor *supervisor, const struct drive_health *health)
{
    const bool is_saturated = health->duty[0] > SATURATED_DUTY || health->duty[1] > SATURATED_DUTY;
    supervisor->saturated_ms = lasting(supervisor->saturated_ms, is_saturated);
    supervisor->tumbling_ms = lasting(supervisor->tumbling_ms, !is_within(health->tilt_rate, TUMBLING_RATE));
    for (uint8_t side = 0; side < 2; side++)
        supervisor->stuck_ms[side] =
            judge_stuck(supervisor->stuck_ms[side], health->duty[side], health->wheel_speed[side]);
    supervisor->discord_ms = lasting(supervisor->discord_ms, health->accord != ACCORD);
    supervisor->current_ms = lasting(supervisor->current_ms, health->motor_ma > MAX_CURRENT_MA);
}

static void judge_hazards(struct supervisor *supervisor, const struct drive_health *health)
{
    count_hazards(supervisor, health);
    /* A fast fall takes gyro and motors to their limits first: it is called by its name. */
    const bool is_helpless = supervisor->saturated_ms >= STALL_MS || supervisor->tumbling_ms >= TUMBLING_MS;
    const bool is_falling = is_helpless && !is_within(health->tilt, SUPERVISOR_LOST_TILT);
    if (is_falling || !is_within(health->tilt, SUPERVISOR_FALL_TILT))
        switch_off(supervisor, DRIVE_FALLEN, STOP_FELL);
    else if (health->rail_steps >= RAIL_STEPS)
        switch_off(supervisor, DRIVE_FAULT, STOP_SENSOR);
    else if (supervisor->current_ms >= CURRENT_MS)
        switch_off(supervisor, DRIVE_FAULT, STOP_CURRENT);
    else if (supervisor->stuck_ms[0] >= STALL_MS || supervisor->stuck_ms[1] >= STALL_MS)
        switch_off(supervisor, DRIVE_FAULT, STOP_BLOCKED);
    else if (supervisor->discord_ms >= DISCORD_MS)
        switch_off(supervisor, DRIVE_FAULT, health->accord == ACCORD_BODY_ALONE ? STOP_DISAGREEMENT : STOP_LIFTED);
    else if (supervisor->saturated_ms >= STALL_MS)
        switch_off(supervisor, DRIVE_FAULT, STOP_STALL);
}

/* A short time of less current takes no longer than that to be made up for. */
static void spare_motors(struct supervisor *supervisor, const struct drive_health *health)
{
    const bool is_much = health->motor_ma > WARM_CURRENT_MA;
    if (is_much && supervisor->warm_steps < WARM_STEPS)
        supervisor->warm_steps++;
    else if (!is_much && supervisor->warm_steps > 0)
        supervisor->warm_steps--;
    const bool is_warm = supervisor->warm_steps == WARM_STEPS;
    const float ceiling = supervisor->ceiling + (is_warm ? -CEILING_FALL : CEILING_RISE);
    supervisor->ceiling = ceiling > 1.0f ? 1.0f : greater(ceiling, 0.0f);
}

static void judge_link(struct supervisor *supervisor)
{
    if (supervisor->silent_ms < UINT16_MAX - SUPERVISOR_STEP_MS)
        supervisor->silent_ms = (uint16_t)(supervisor->silent_ms + SUPERVISOR_STEP_MS);
    if (supervisor->state != DRIVE_ARMED || supervisor->silent_ms < SUPERVISOR_LINK_MS)
        return;
    supervisor->state = DRIVE_LINK_LOST;
    supervisor->reason = STOP_LINK;
    halt(supervisor);
}

static uint8_t reason_to_stay(const struct supervisor *supervisor, const struct drive_health *health)
{
    if (health->charger_mv > CHARGER_MV)
        return STOP_CHARGER;
    const uint16_t least = supervisor->stays == STOP_BATTERY ? RESTED_BATTERY_MV : EMPTY_BATTERY_MV;
    return health->battery_mv < least ? STOP_BATTERY : STOP_NONE;
}

static void judge_supplies(struct supervisor *supervisor, const struct drive_health *health)
{
    const uint8_t reason = reason_to_stay(supervisor, health);
    const uint8_t before = supervisor->stays;
    supervisor->stay_ms = lasting(supervisor->stay_ms, reason != before);
    if (supervisor->stay_ms >= SUPPLY_MS) {
        supervisor->stays = reason;
        supervisor->stay_ms = 0;
    }
    const bool has_ended = before != STOP_NONE && supervisor->reason == before;
    const bool is_asked = supervisor->state == DRIVE_ARMED || supervisor->is_arm_wanted;
    if (is_asked && (supervisor->stays != STOP_NONE || has_ended)) /* a lost link keeps its own reason */
        supervisor->reason = supervisor->stays;
}

bool supervisor_step(struct supervisor *supervisor, const struct drive_health *health)
{
    judge_link(supervisor);
    spare_motors(supervisor, health);
    if (supervisor->state == DRIVE_DISARMED)
        judge_arming(supervisor, health);
    else if (supervisor_is_balancing(supervisor))
        judge_hazards(supervisor, health);
    judge_supplies(supervisor, health);
    return supervisor_is_balancing(supervisor);
}

struct drive_wish supervisor_wish(const struct supervisor *supervisor)
{
    const struct drive_wish still = {0.0f, 0.0f};
    return supervisor->stays == STOP_NONE ? supervisor->wish : still;
}

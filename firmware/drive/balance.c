/* SPDX-License-Identifier: Apache-2.0 */
#include "balance.h"

#include "arithmetic.h"

#include <stdbool.h>

#define NOMINAL_BATTERY 28.8f /* V */
#define LOWEST_BATTERY 20.0f  /* V; below this the reading is not believed */
#define ACCELERATION 0.5f     /* m/s2: how fast the commanded speed may change */
#define TURN_ACCELERATION 6.0f /* rad/s2 */
#define LEASH 0.25f           /* m: against a wall the commanded position waits */
#define CRUISE 0.3f           /* m/s; a faster robot is ahead of it by more, for the duty that its speed takes: */
#define LEAD 0.8f             /* m per m/s beyond, on its way only */
#define HEADING_LEASH 0.5f    /* rad */
#define SOFT_START_TIME 0.7f  /* s from arming to full duty */
#define SOFT_START_DUTY 0.4f
#define MAX_TURN_DUTY 0.35f   /* turning never takes what balancing needs */
#define SETTLED_TIME 4.0f     /* s of standing after which what driving left has died away */
#define BLOCKED_SHARE 0.3f    /* of the wanted speed; slower at its leash's end it has met something */
#define WANDER 0.04f          /* m that noise alone makes it wander */
#define TRIM_RATE 0.048f      /* rad/s per m: time constant of 5 s, the loop's slowest own one is 1.2 s */
#define MAX_TRIM 0.12f        /* rad */

/* Chosen on the linear model of nine bodies, with mass and centre of gravity each as estimated (2.6 kg, 0.135 m above the
 * axle) and 20 % more and less, the gyro's filter, and duties 1 to 3 ms late (tests/firmware/test_gains.py). */
const struct balance_gains BALANCE_GAINS = {
    .tilt = 5.0f, .tilt_rate = 0.55f, .speed = 2.5f, .position = 1.6f,
    .turn_rate = 0.06f, .heading = 0.45f, .feed_turn = 0.10f,
};

static float toward(float value, float wanted, float step)
{
    return value + limited(wanted - value, step);
}

void balance_init(struct balance *balance)
{
    balance->gains = BALANCE_GAINS;
    balance->trim = 0.0f;
    balance_rest(balance);
}

void balance_rest(struct balance *balance)
{
    balance->wanted_speed = balance->wanted_turn = 0.0f;
    balance->ahead = balance->heading_ahead = 0.0f;
    balance->soft_start = 0.0f;
    balance->standing = 0.0f;
    balance->is_blocked = false;
}

/* Ahead on its way it may be farther than behind, where something may be in the way. */
static float leashed(float ahead, float wanted_speed)
{
    const float most = wanted_speed > CRUISE ? LEASH + LEAD * (wanted_speed - CRUISE) : LEASH;
    const float least = wanted_speed < -CRUISE ? LEAD * (wanted_speed + CRUISE) - LEASH : -LEASH;
    return ahead > most ? most : ahead < least ? least : ahead;
}

static void follow_wish(struct balance *balance, const struct rolled *rolled, const struct drive_wish *wish)
{
    balance->wanted_speed = toward(balance->wanted_speed, wish->speed, ACCELERATION * BALANCE_DT);
    balance->wanted_turn = toward(balance->wanted_turn, wish->turn, TURN_ACCELERATION * BALANCE_DT);
    balance->ahead = leashed(balance->ahead + rolled->distance - balance->wanted_speed * BALANCE_DT,
                             balance->wanted_speed);
    balance->heading_ahead =
        limited(balance->heading_ahead + rolled->angle - balance->wanted_turn * BALANCE_DT, HEADING_LEASH);
}

/* Whether it drove against something; what leans there, told to stand, is away from its place for no fault of its own. */
static void notice_block(struct balance *balance, const struct rolled *rolled)
{
    const float ahead = magnitude(balance->ahead);
    if (ahead >= LEASH && magnitude(rolled->speed) < BLOCKED_SHARE * magnitude(balance->wanted_speed))
        balance->is_blocked = true;
    else if (ahead < 0.5f * LEASH)
        balance->is_blocked = false;
}

/* What stands still but away from its place leans on a wrong zero: of its accelerometer, or of its own weight's place.
 * Only then: against a wall, or while it drives, there are other reasons to be away. */
static void trim_lean(struct balance *balance, const struct drive_wish *wish)
{
    const bool is_told_to_stand = wish->speed == 0.0f && wish->turn == 0.0f && balance->wanted_speed == 0.0f;
    balance->standing = is_told_to_stand && !balance->is_blocked ? toward(balance->standing, SETTLED_TIME, BALANCE_DT) : 0.0f;
    if (balance->standing < SETTLED_TIME)
        return;
    const float away = balance->ahead - limited(balance->ahead, WANDER);
    balance->trim = limited(balance->trim + away * (TRIM_RATE * BALANCE_DT), MAX_TRIM);
}

static float duty_limit(struct balance *balance)
{
    const float limit = SOFT_START_DUTY + (1.0f - SOFT_START_DUTY) * balance->soft_start;
    balance->soft_start += BALANCE_DT / SOFT_START_TIME;
    if (balance->soft_start > 1.0f)
        balance->soft_start = 1.0f;
    return limit;
}

struct duties balance_step(struct balance *balance, const struct lean *lean, const struct rolled *rolled,
                           const struct drive_wish *wish, float battery)
{
    const struct balance_gains *gains = &balance->gains;
    follow_wish(balance, rolled, wish);
    notice_block(balance, rolled);
    trim_lean(balance, wish);
    /* Fore and aft the sum is positive: to stop rolling forward the wheels first hurry ahead of the body's lean. */
    const float upright = gains->tilt * (lean->tilt + balance->trim) + gains->tilt_rate * lean->rate +
                          gains->speed * (rolled->speed - balance->wanted_speed) + gains->position * balance->ahead;
    const float turn = gains->feed_turn * balance->wanted_turn -
                       gains->turn_rate * (rolled->turn_rate - balance->wanted_turn) -
                       gains->heading * balance->heading_ahead;
    const float scale = NOMINAL_BATTERY / (battery > LOWEST_BATTERY ? battery : NOMINAL_BATTERY);
    const float limit = duty_limit(balance);
    const float differential = limited(turn * scale, MAX_TURN_DUTY);
    const struct duties duties = {
        .left = limited(upright * scale - differential, limit),
        .right = limited(upright * scale + differential, limit),
    };
    return duties;
}

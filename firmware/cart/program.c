/* SPDX-License-Identifier: Apache-2.0 */
#include "program.h"

#include "../link/channels.h"

#include <stdlib.h>
#include <string.h>

#define DRIVE_POWER (MOTOR_FULL_POWER / 10 * 6)
#define BACK_POWER (MOTOR_FULL_POWER / 10 * 6)
#define TURN_POWER (MOTOR_FULL_POWER / 10 * 5)
#define GAIN 150       /* of power for a tick that one wheel is ahead of the other, */
#define SUM_DIVISOR 8  /* for so many ms of it, */
#define CHANGE_GAIN 80 /* and for a tick that it has got ahead in this ms */
#define SUM_MOST 16000
#define MATCH_MOST (MOTOR_FULL_POWER / 10 * 3)
#define COARSE_MS 200
#define COARSE_POWER (MOTOR_FULL_POWER / 8) /* for a tick, */
#define COARSE_MOST 2                       /* and for two or more */

void cart_program_init(struct cart_program *program)
{
    const struct cart_program fresh = {.state = CART_STAND};
    *program = fresh;
}

static void set_powers(struct cart_program *program, int16_t left, int16_t right)
{
    program->wanted[0] = left;
    program->wanted[1] = right;
}

/* The next of 65,535 numbers in a fixed disorder (xorshift, Marsaglia 2003). */
static uint16_t draw(struct cart_program *program)
{
    uint16_t random = program->random;
    random = (uint16_t)(random ^ (uint16_t)(random << 7));
    random = (uint16_t)(random ^ (random >> 9));
    random = (uint16_t)(random ^ (uint16_t)(random << 8));
    program->random = random;
    return random;
}

static void begin(struct cart_program *program, uint8_t state)
{
    program->state = state;
    program->is_resting = false;
    program->stage_ms = 0;
    program->closed_ms = 0;
    program->bumper = 0;
    memset(program->counted, 0, sizeof program->counted);
    program->difference = 0;
    program->difference_sum = 0;
    if (state == CART_TURN) {
        const int16_t ticks = (int16_t)(CART_LEAST_TURN + draw(program) % (CART_MOST_TURN - CART_LEAST_TURN + 1));
        program->turn_ticks = draw(program) & 0x100 ? ticks : (int16_t)-ticks;
    }
}

void cart_program_start(struct cart_program *program, const struct cart_orders *orders)
{
    program->orders = *orders;
    program->random = orders->seed != 0 ? orders->seed : 1; /* zero would stay zero */
    program->bumps = 0;
    set_powers(program, 0, 0);
    begin(program, CART_DRIVE);
}

void cart_program_stop(struct cart_program *program)
{
    program->state = CART_STAND;
    set_powers(program, 0, 0);
}

static void count(struct cart_program *program, const struct cart_sensed *sensed)
{
    for (uint8_t side = 0; side < 2; side++) {
        program->counted[side] += (int16_t)(uint16_t)(sensed->ticks[side] - program->ticks[side]);
        program->ticks[side] = sensed->ticks[side];
    }
    if (sensed->bumper == 0)
        program->closed_ms = 0;
    else if (program->closed_ms < CART_CLOSED_MS)
        program->closed_ms++;
}

static bool is_closed(const struct cart_program *program)
{
    return program->closed_ms == CART_CLOSED_MS;
}

static int32_t between(int32_t value, int32_t low, int32_t high)
{
    if (value < low)
        return low;
    return value > high ? high : value;
}

static int16_t ahead(const struct cart_program *program)
{
    return (int16_t)between(program->counted[0] - program->counted[1], -1000, 1000);
}

/* Power that is taken from one wheel and given to the other, which is behind: proportional, integral, derivative. */
static int16_t match(struct cart_program *program)
{
    const int16_t difference = ahead(program);
    const int32_t change = difference - program->difference;
    program->difference = difference;
    program->difference_sum = between(program->difference_sum + difference, -SUM_MOST, SUM_MOST);
    const int32_t power = (int32_t)GAIN * difference + program->difference_sum / SUM_DIVISOR + CHANGE_GAIN * change;
    return (int16_t)between(power, -MATCH_MOST, MATCH_MOST);
}

static void drive(struct cart_program *program, int16_t power)
{
    const struct cart_orders *orders = &program->orders;
    int16_t matched = 0;
    if (orders->is_matched && orders->is_coarse) {
        if (program->stage_ms % COARSE_MS != 1)
            return; /* the powers stay as they are */
        matched = (int16_t)(between(ahead(program), -COARSE_MOST, COARSE_MOST) * COARSE_POWER);
    } else if (orders->is_matched) {
        matched = match(program);
    }
    set_powers(program, (int16_t)(power - matched), (int16_t)(power + matched));
}

/* Gives the stage's powers; true when it is over. */
static bool work(struct cart_program *program)
{
    const int32_t *counted = program->counted;
    const bool to_left = program->turn_ticks > 0;
    switch (program->state) {
    case CART_DRIVE:
        drive(program, DRIVE_POWER);
        return is_closed(program) || program->stage_ms >= CART_DRIVE_MS;
    case CART_BACK:
        drive(program, -BACK_POWER);
        return -(counted[0] + counted[1]) >= CART_BACK_TICKS || program->stage_ms >= CART_BACK_MS;
    default:
        set_powers(program, to_left ? -TURN_POWER : TURN_POWER, to_left ? TURN_POWER : -TURN_POWER);
        return labs(counted[1] - counted[0]) >= labs(program->turn_ticks) || program->stage_ms >= CART_TURN_MS;
    }
}

static void rest(struct cart_program *program)
{
    program->is_resting = true;
    program->stage_ms = 0;
    set_powers(program, 0, 0);
}

static uint8_t state_after(const struct cart_program *program)
{
    switch (program->state) {
    case CART_DRIVE:
        return program->orders.bumps > 0 && program->bumps >= program->orders.bumps ? CART_STAND : CART_BACK;
    case CART_BACK:
        return CART_TURN;
    default:
        return CART_DRIVE;
    }
}

static void record(struct cart_program *program, struct cart_stage *ended)
{
    ended->kind = (uint8_t)(program->state - CART_DRIVE);
    ended->bumper = program->bumper;
    ended->left = (int16_t)between(program->counted[0], INT16_MIN, INT16_MAX);
    ended->right = (int16_t)between(program->counted[1], INT16_MIN, INT16_MAX);
    if (program->state == CART_DRIVE && ended->bumper != 0 && program->bumps < UINT16_MAX)
        program->bumps++;
}

bool cart_program_step(struct cart_program *program, const struct cart_sensed *sensed, struct cart_stage *ended)
{
    count(program, sensed);
    if (program->state == CART_STAND)
        return false;
    program->stage_ms++;
    if (!program->is_resting && work(program))
        rest(program);
    if (!program->is_resting)
        return false;
    if (is_closed(program))
        program->bumper |= sensed->bumper;
    if (program->stage_ms < CART_REST_MS)
        return false;
    record(program, ended);
    const uint8_t next = state_after(program);
    if (next == CART_STAND)
        cart_program_stop(program);
    else
        begin(program, next);
    return true;
}

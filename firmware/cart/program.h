/* SPDX-License-Identifier: Apache-2.0
 *
 * The bumper cart's program: drive until a bump, record, back up, turn by a random angle, drive off. Pure, in whole
 * numbers; one step a ms.
 *
 * | state | the motors                              | left when                                | then            |
 * | stand | have no power                           | it is started                            | drive           |
 * | drive | forward                                 | a switch closes, or DRIVE_MS have passed | back up         |
 * | back  | backward                                | BACK_TICKS are counted, or BACK_MS       | turn            |
 * | turn  | against each other, to a random side by | as many ticks are counted, or TURN_MS    | drive           |
 * |       | a random number of ticks                |                                          |                 |
 *
 * Each stage ends with a rest of REST_MS without power, in which the cart comes to stand; then its ticks are recorded.
 * The last bump's drive ends the run: after it, and whenever it is stopped, the cart stands.
 */
#ifndef CRUNCH_CART_PROGRAM_H
#define CRUNCH_CART_PROGRAM_H

#include <stdbool.h>
#include <stdint.h>

#define CART_LEFT 1u /* switches of the bumper, as bits; a cart with a single one has it in the middle */
#define CART_MIDDLE 2u
#define CART_RIGHT 4u

#define CART_DRIVE_MS 20000 /* a stage that takes longer than these has failed, and ends */
#define CART_BACK_MS 3000
#define CART_TURN_MS 4000
#define CART_REST_MS 250
#define CART_CLOSED_MS 15   /* a switch bounces for less */
#define CART_BACK_TICKS 94 /* of both wheels together: 8 cm */
#define CART_LEAST_TURN 30 /* ticks of both wheels together */
#define CART_MOST_TURN 117

enum cart_state { CART_STAND = 0, CART_DRIVE, CART_BACK, CART_TURN };
enum cart_stage_kind { STAGE_DRIVE = 0, STAGE_BACK, STAGE_TURN };

struct cart_stage {
    uint8_t kind;   /* enum cart_stage_kind */
    uint8_t bumper; /* switches that were closed in its rest; of a drive, 0: none, it took too long */
    int16_t left;   /* ticks of the wheels, negative backward; they stay at their limits */
    int16_t right;
};

struct cart_sensed {
    uint16_t ticks[2]; /* counters, which wrap */
    uint8_t bumper;    /* switches closed right now */
};

struct cart_orders {
    uint16_t bumps;  /* after which it stands; 0: until it is stopped */
    uint16_t seed;   /* of the random turns */
    bool is_matched; /* both wheels are kept at the same count, instead of each having the same power: */
    bool is_coarse;  /* by no more than a Lego brick has, eight powers five times a second */
};

struct cart_program {
    uint8_t state; /* enum cart_state */
    bool is_resting;
    uint16_t stage_ms; /* in the stage, or in its rest */
    uint8_t closed_ms; /* that some switch has been closed; stays at CART_CLOSED_MS */
    uint8_t bumper;    /* switches closed since the stage's rest began */
    uint16_t ticks[2]; /* as read at the last step */
    int32_t counted[2]; /* since the stage began */
    int16_t turn_ticks; /* of this turn; negative: to the right */
    int32_t difference_sum;
    int16_t difference;
    uint16_t bumps; /* of this run */
    uint16_t random;
    struct cart_orders orders;
    int16_t wanted[2]; /* powers, of MOTOR_FULL_POWER */
};

/* Stands. */
void cart_program_init(struct cart_program *program);

/* Begins a run, from wherever it is in another one. */
void cart_program_start(struct cart_program *program, const struct cart_orders *orders);

/* Stands at once; the stage under way is not recorded. */
void cart_program_stop(struct cart_program *program);

/* One ms. True when a stage was completed, which is in `*ended` then. */
bool cart_program_step(struct cart_program *program, const struct cart_sensed *sensed, struct cart_stage *ended);

#endif

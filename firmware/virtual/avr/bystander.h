/* SPDX-License-Identifier: Apache-2.0
 *
 * Who listens beside the modem: what the drive board has told of itself, where the robot truly was when it sampled that,
 * and which of the host's commands the board obeys. It reads the line by the firmware's own C and has no other way
 * into the board; what it says to the board goes over the line, too.
 */
#ifndef CRUNCH_VIRTUAL_AVR_BYSTANDER_H
#define CRUNCH_VIRTUAL_AVR_BYSTANDER_H

#include "../robot.h"

#define BYSTANDER_REMEMBERS_MS 256 /* longer than any odometry waits for the line */

struct bystander {
    uint64_t boot_ms;           /* when the drive board last started */
    struct frame_decoder told, asked;
    uint8_t state;              /* enum drive_state, as last told */
    uint8_t acknowledged;       /* as last told */
    uint16_t odometry_ms;       /* the board's time of its newest odometry, */
    bool has_odometry;          /* if there was one since its start */
    uint32_t drives_accepted, stops_accepted, arms_accepted;
    struct place places[BYSTANDER_REMEMBERS_MS]; /* where the robot was, by the ms */
    struct truth truth[ROBOT_TRUTH_ROWS];        /* one for each odometry frame told; times as in `places` */
    int32_t truth_rows;
};

void bystander_init(struct bystander *bystander);

/* Once per ms, before anything moves. */
void bystander_note(struct bystander *bystander, uint64_t now_ms, const struct place *place);

/* The drive board has started anew. */
void bystander_boot(struct bystander *bystander, uint64_t now_ms);

/* A byte that the drive board sent. */
void bystander_hear(struct bystander *bystander, uint64_t now_ms, uint8_t byte);

/* A byte from the host. */
void bystander_ask(struct bystander *bystander, uint64_t now_ms, uint8_t byte);

/* Commands as a host would send them now, each after a delimiter that ends what was cut; they return their length, at
 * most LINK_MAX_ENCODED + 1. m/s and rad/s. */
uint8_t bystander_drive(const struct bystander *bystander, double speed, double turn, uint64_t now_ms, uint8_t *out);
uint8_t bystander_arm(const struct bystander *bystander, uint64_t now_ms, uint8_t *out);

/* Whether the board balances, as far as it has told. */
bool bystander_sees_balance(const struct bystander *bystander);

/* Whether the board samples its odometry in this ms. */
bool bystander_is_odometry_next(const struct bystander *bystander, uint64_t now_ms);

#endif

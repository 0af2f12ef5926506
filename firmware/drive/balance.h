/* SPDX-License-Identifier: Apache-2.0
 *
 * The balance law (thesis 1.1, after nBot): each wheel is driven by a linear sum of tilt, tilt rate, wheel velocity and
 * error from the commanded position. A forward command is subtracted from the velocity and moves the commanded position
 * at the same speed; a turn command is added to one wheel and subtracted from the other, which does not alter the
 * fore/aft balance. A slow trim, learned while it stands, takes out what the lean's zero is wrong by. Pure: no
 * registers, no globals; the host's build gives the same bits.
 */
#ifndef CRUNCH_DRIVE_BALANCE_H
#define CRUNCH_DRIVE_BALANCE_H

#include <stdbool.h>

#include "odometry.h"

#define BALANCE_DT 0.005f

struct balance_gains { /* duty at nominal battery voltage per unit */
    float tilt;        /* 1/rad */
    float tilt_rate;   /* s/rad */
    float speed;       /* s/m */
    float position;    /* 1/m */
    float turn_rate;   /* s/rad, of each wheel, against the error */
    float heading;     /* 1/rad */
    float feed_turn;   /* s/rad: what a steady turn needs */
};

extern const struct balance_gains BALANCE_GAINS;

struct balance {
    struct balance_gains gains; /* survive balance_rest */
    float wanted_speed; /* commands after their ramps: m/s, */
    float wanted_turn;  /* rad/s */
    float ahead;        /* actual minus commanded position, m */
    float heading_ahead; /* actual minus commanded heading, rad */
    float soft_start;   /* 0 to 1: share of the full duty allowed */
    float standing;     /* s since it was told to stand still, up to a few */
    bool is_blocked;    /* it drove against something, and has not come away */
    float trim;         /* rad added to the lean, learned while standing; survives balance_rest */
};

struct lean {
    float tilt; /* rad, forward positive */
    float rate; /* rad/s */
};

struct drive_wish {
    float speed; /* m/s */
    float turn;  /* rad/s, counter-clockwise positive */
};

struct duties { /* -1 to 1 of the battery's voltage */
    float left;
    float right;
};

/* Stands at the present place with the motors off, with BALANCE_GAINS. */
void balance_init(struct balance *balance);

/* The same, with the gains and the trim it has. */
void balance_rest(struct balance *balance);

/* One step of 5 ms. `battery` is volts; the gains grow as it sags. */
struct duties balance_step(struct balance *balance, const struct lean *lean, const struct rolled *rolled,
                           const struct drive_wish *wish, float battery);

#endif

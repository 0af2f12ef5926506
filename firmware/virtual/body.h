/* SPDX-License-Identifier: Apache-2.0
 *
 * Crunch's body: a rolling inverted pendulum on two driven wheels, its motors, its battery, and the walls it may touch.
 *
 * The numbers are estimates for the real robot (round decks of 6 inches, wheels of 4 inches, 24 NiMH cells under the
 * top deck). Tilt forward positive, heading counter-clockwise; SI units. Slip: the wheels' rotation and the true motion
 * differ by factors that wander along the path, which is what makes odometry drift.
 */
#ifndef CRUNCH_VIRTUAL_BODY_H
#define CRUNCH_VIRTUAL_BODY_H

#include "caster.h"
#include "noise.h"

#include <stdbool.h>

#define BODY_RADIUS 0.076       /* m, of the decks */
#define BODY_WHEEL_RADIUS 0.0508
#define BODY_TRACK 0.19
#define BODY_TICKS_PER_TURN 1000.0
#define BODY_DT 0.001           /* s per step */
#define BODY_NOMINAL_VOLTS 28.8

/* Slip: standard deviations per square root of a metre driven, and biases of this run. */
struct slip {
    double distance;        /* 1/sqrt(m) */
    double turn;            /* rad/sqrt(m) */
    double distance_bias;   /* share */
    double turn_bias;       /* rad/m */
    double rotation_bias;   /* share of the true rotation */
    double travelled;       /* m since the last knot of the wander */
    double stretch[2];      /* extra share of distance at the last knot and at the next */
    double curl[2];         /* extra rad/m there */
    struct noise noise;
};

struct battery {
    double charge;   /* C left */
    double volts;    /* at the terminals, under load */
    double amperes;  /* drawn */
};

struct physique { /* of all above the axle; may be varied before the first step */
    double mass;    /* kg */
    double centre;  /* m from the axle to the centre of mass */
    double inertia; /* kg m2 about the centre of mass */
};

struct body {
    struct physique physique;
    double x, y, heading;
    double speed, turn_rate;      /* true, over the floor */
    double tilt, tilt_rate;
    double acceleration;          /* of the axle, forward */
    double wheels[2];             /* rad against the body, left and right */
    double wheel_rates[2];        /* rad/s */
    double motor_amperes[2];
    double contact;               /* share of the battery's voltage that reaches the motors; 1 unless something is bad */
    double shorted;               /* times the current that a sound motor takes; 1 unless turns are shorted */
    double push;                  /* N forward; a test's or a person's hand, */
    double push_height;           /* m above the axle; the decks' unless changed */
    double clearance;             /* m that it may still move before walls must be looked for */
    bool is_held;                 /* a hand keeps it upright and in its place, */
    double held;                  /* for so long, s */
    bool is_lifted;               /* a hand keeps it in the air, as it leaned */
    bool is_blocked[2];           /* something holds a wheel to the body, */
    double jam[2];                /* rad at which it does */
    bool is_touching;
    struct battery battery;
    struct slip slip;
    const struct caster *walls;
};

void body_init(struct body *body, const struct caster *walls, uint64_t seed);

/* Sets the slip's deviations; the run's biases are drawn from the body's seed. */
void body_set_slip(struct body *body, double distance, double turn, double distance_bias, double turn_bias,
                   double rotation_bias);

/* Blocks the left (0) or the right (1) wheel where it stands. */
void body_block(struct body *body, int side);

/* One step of BODY_DT with the motors' duties (-1 to 1). */
void body_step(struct body *body, const double duties[2]);

/* Electronics alone for `seconds`: for a robot whose motion is given. */
void battery_drain(struct battery *battery, double amperes, double seconds);

#endif

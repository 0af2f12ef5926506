/* SPDX-License-Identifier: Apache-2.0
 *
 * The bumper cart's body: two geared motors that are not alike, a rotation counter on each, a bumper on a hinge, and the
 * walls that any part of it may touch.
 *
 * A rigid body on two wheels whose tyres hold the floor up to a limit (Coulomb's, softened below GRIP_SPEED), pushed by
 * its motors and by the walls. So bumps slip, wheels turn on against a wall, a bumper that meets it almost square is
 * flattened against it, and one that meets it at a small angle slides along. The bumper's bar moves back on its hinge:
 * its front is `bumper_ahead` of the axle where the switches close, CART_CLOSING farther when nothing touches it.
 *
 * Lengths in m, the pose is the middle of the axle, headings counter-clockwise; index 0 is left, 1 is right. The real
 * cart's masses and forces are not known: these are estimates for Lego of its size.
 */
#ifndef CRUNCH_VIRTUAL_CART_BODY_H
#define CRUNCH_VIRTUAL_CART_BODY_H

#include "body.h"
#include "caster.h"
#include "noise.h"

#include <stdbool.h>

#define CART_CLOSING 0.002     /* m that the bar gives way until its switches close, */
#define CART_TRAVEL 0.003      /* and until it is stopped */
#define CART_BEHIND 0.045      /* m from the axle to the cart's rear */
#define CART_NOMINAL_VOLTS 7.2 /* six cells */

/* How one cart was built, and how unlike its parts are: lasting ones are drawn at its start. */
struct cart_build {
    double wheelbase;    /* m between the wheels, as they truly roll */
    double bumper_width; /* which is the whole cart's */
    double bumper_ahead;
    double tick;         /* m of a wheel's way */
    double motor_spread; /* standard deviations: lasting difference of the motors' speed, share, */
    double motor_wander; /* and of what comes and goes; */
    double wheel_spread; /* wheels' radii, share; */
    double slip;         /* share by which a tyre gives way, of what comes and goes, */
    double turn_slip;    /* and more of it in turns on the spot */
    double play;         /* ticks, of the counters' gears */
    double stick_share;  /* of the bumps in which the bar gives way badly when pressed at an end */
    int32_t switches;    /* 1: any contact closes the middle one; 3: each is closed by contacts in its third */
};

struct cart_wheel {
    double gain;    /* of its motor, lasting, */
    double wander;  /* and passing, */
    double scale;   /* way on the floor for a way of the rim as the counter knows it, lasting, */
    double slip;    /* and passing */
    double speed;   /* m/s of the rim */
    double way;     /* m that the rim has turned, */
    double counted; /* and as far as the counter's side of the gears has followed */
    double phase;   /* of its counter, ticks */
};

struct cart_body {
    const struct caster *walls; /* borrowed */
    struct cart_build build;
    struct noise noise;
    double x, y, heading;       /* of the axle's middle */
    double vx, vy, turn_rate;   /* of the centre of mass */
    struct cart_wheel wheels[2];
    double hinge;               /* m that the bumper's bar has given way */
    double binding;             /* share of a force at the bar's end that does not move it, of this touch */
    double thirds[3];           /* force (N) on the bar's left, middle and right third */
    double charge;              /* C, of the battery, */
    double volts;               /* and what it has under its load */
    double clearance;           /* m: no wall is nearer to any part of the cart than this */
    double deepest;             /* m that a wall has been inside of the cart at most: what is not resolved */
    double drawn;               /* s since passing errors were drawn last */
};

void cart_body_init(struct cart_body *body, const struct caster *walls, const struct cart_build *build, uint64_t seed,
                    double x, double y, double heading);

/* One ms with powers from -1 to 1; a motor without power is shorted, and brakes. */
void cart_body_step(struct cart_body *body, const double powers[2]);

/* What the counters show; wraps. */
uint16_t cart_body_ticks(const struct cart_body *body, int side);

/* Switches that are closed, as in cart/program.h. */
uint8_t cart_body_bumper(const struct cart_body *body);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#include "body.h"

#include <math.h>

#define GRAVITY 9.81
#define WHEELS_MASS 0.30     /* kg, both */
#define YAW_INERTIA 0.022    /* kg m2, wheels and rotors included */
#define STALL_TORQUE 1.2     /* N m of one motor at the nominal voltage */
#define FREE_SPEED 22.0      /* rad/s at the nominal voltage */
#define STALL_CURRENT 0.92   /* A: torque and speed constants are one */
#define FRICTION 0.02        /* N m, Coulomb, one wheel */
#define FRICTION_SPEED 0.05  /* rad/s below which it fades */
#define SCRUB 0.02           /* N m s: tyres that turn on the spot */
#define SPIN_INERTIA 0.0008  /* kg m2, one wheel with its rotor: all that a motor turns in the air */
#define JAM_STIFFNESS 300.0  /* N m/rad of what blocks a wheel */
#define JAM_DAMPING 1.0      /* N m s/rad */
#define DECK_HEIGHT 0.10     /* m above the axle where walls and hands touch */
#define TREMBLE 0.0005       /* rad that a hand trembles, at 9 Hz, */
#define TREMBLING 56.5
#define SWAY 0.003           /* and sways, in 3 s */
#define SWAYING 2.1
#define LYING_TILT 1.35      /* rad: the body rests on the floor */
#define WALL_STIFFNESS 3000.0 /* N/m */
#define WALL_DAMPING 40.0    /* N s/m */
#define WALL_LOOK 0.3        /* m around the decks that one look for walls covers */
#define KNOT 0.10            /* m between knots of the slip's wander */
#define MAX_STRETCH 0.6
#define CELLS 24
#define CAPACITY (1.6 * 3600.0) /* C */
#define PACK_RESISTANCE 0.72 /* ohm */
#define ELECTRONICS 0.35     /* A */

static void draw_knot(struct slip *slip)
{
    slip->stretch[0] = slip->stretch[1];
    slip->curl[0] = slip->curl[1];
    const double stretch = slip->distance / sqrt(KNOT) * noise_normal(&slip->noise);
    slip->stretch[1] = fmax(-MAX_STRETCH, fmin(MAX_STRETCH, stretch));
    slip->curl[1] = slip->turn / sqrt(KNOT) * noise_normal(&slip->noise);
}

void body_init(struct body *body, const struct caster *walls, uint64_t seed)
{
    const struct body fresh = {
        .walls = walls,
        .battery = {.charge = 0.95 * CAPACITY},
        .physique = {.mass = 2.6, .centre = 0.135, .inertia = 0.025},
        .push_height = DECK_HEIGHT,
        .contact = 1.0,
        .shorted = 1.0,
    };
    *body = fresh;
    noise_init(&body->slip.noise, seed, 1);
    battery_drain(&body->battery, ELECTRONICS, 0.0);
}

void body_set_slip(struct body *body, double distance, double turn, double distance_bias, double turn_bias,
                   double rotation_bias)
{
    struct slip *slip = &body->slip;
    slip->distance = distance;
    slip->turn = turn;
    slip->distance_bias = distance_bias * noise_normal(&slip->noise);
    slip->turn_bias = turn_bias * noise_normal(&slip->noise);
    slip->rotation_bias = rotation_bias * noise_normal(&slip->noise);
    draw_knot(slip);
    draw_knot(slip);
}

/* Rolling speed and turn rate as the wheels make them, for the body's true ones. Between knots the wander is linear, so
 * that wheel speeds never jump; a sum of hat functions has the variance of the independent errors it stands for. */
static void wheel_motion(const struct body *body, double *rolling, double *turning)
{
    const struct slip *slip = &body->slip;
    const double part = slip->travelled / KNOT;
    const double stretch = slip->distance_bias + slip->stretch[0] + part * (slip->stretch[1] - slip->stretch[0]);
    const double curl = slip->turn_bias + slip->curl[0] + part * (slip->curl[1] - slip->curl[0]);
    *rolling = body->speed * (1.0 + stretch);
    *turning = body->turn_rate * (1.0 + slip->rotation_bias) + body->speed * curl;
}

static void advance_slip(struct body *body)
{
    struct slip *slip = &body->slip;
    slip->travelled += fabs(body->speed) * BODY_DT;
    if (slip->travelled < KNOT)
        return;
    slip->travelled -= KNOT;
    draw_knot(slip);
}

/* A cell's resting voltage: falls fast at both ends, nearly flat between. */
static double cell_volts(double share)
{
    if (share <= 0.0)
        return 0.9;
    return 1.21 + 0.06 * share + 0.08 * exp(-(1.0 - share) * 12.0) - 0.30 * exp(-share * 18.0);
}

void battery_drain(struct battery *battery, double amperes, double seconds)
{
    battery->charge = fmax(0.0, battery->charge - amperes * seconds);
    battery->amperes = amperes;
    battery->volts = CELLS * cell_volts(battery->charge / CAPACITY) - amperes * PACK_RESISTANCE;
}

void body_block(struct body *body, int side)
{
    body->is_blocked[side] = true;
    body->jam[side] = body->wheels[side];
}

/* Torque of one motor on its wheel, and its current: back-EMF, Coulomb friction, and what blocks the wheel. */
static double motor(struct body *body, int side, double duty, double wheel_rate)
{
    const double drive = duty * body->contact * body->battery.volts / BODY_NOMINAL_VOLTS - wheel_rate / FREE_SPEED;
    const double friction = fmax(-1.0, fmin(1.0, wheel_rate / FRICTION_SPEED)) * FRICTION;
    body->motor_amperes[side] = STALL_CURRENT * body->shorted * drive;
    const double torque = STALL_TORQUE * drive - friction;
    if (!body->is_blocked[side])
        return torque;
    return torque - JAM_STIFFNESS * (body->wheels[side] - body->jam[side]) - JAM_DAMPING * wheel_rate;
}

/* Force of the walls on the decks; the part across the heading moves the body at once, as its tyres give way. */
static double touch_walls(struct body *body)
{
    body->clearance -= fabs(body->speed) * BODY_DT;
    if (body->clearance > 0.0)
        return 0.0;
    double px, py;
    const double distance = caster_nearest(body->walls, body->x, body->y, BODY_RADIUS + WALL_LOOK, &px, &py);
    if (!(distance < BODY_RADIUS)) {
        body->clearance = fmin(distance - BODY_RADIUS, WALL_LOOK);
        body->is_touching = false;
        return 0.0;
    }
    const double depth = BODY_RADIUS - distance;
    const double nx = distance > 0.0 ? (body->x - px) / distance : -cos(body->heading);
    const double ny = distance > 0.0 ? (body->y - py) / distance : -sin(body->heading);
    const double forward = nx * cos(body->heading) + ny * sin(body->heading);
    const double force = fmax(0.0, WALL_STIFFNESS * depth - WALL_DAMPING * body->speed * forward);
    const double slide = depth * (depth > 0.005 ? 1.0 : 1.0 - forward * forward);
    body->x += nx * slide;
    body->y += ny * slide;
    body->is_touching = true;
    return force * forward;
}

/* Accelerations of axle and tilt for the wheels' summed torque (Lagrange; coupling through the body's mass). */
static void accelerate(struct body *body, double torque, double wall)
{
    const double mass = body->physique.mass, centre = body->physique.centre;
    const double wheel_inertia = 0.5 * WHEELS_MASS; /* of rolling, divided by the radius squared */
    const double s = sin(body->tilt), c = cos(body->tilt);
    const double a11 = mass + WHEELS_MASS + wheel_inertia, a12 = mass * centre * c;
    const double a22 = body->physique.inertia + mass * centre * centre;
    const double b1 = torque / BODY_WHEEL_RADIUS + mass * centre * s * body->tilt_rate * body->tilt_rate + body->push + wall;
    const double b2 = -torque + mass * GRAVITY * centre * s + (body->push * body->push_height + wall * DECK_HEIGHT) * c +
                      mass * centre * centre * body->turn_rate * body->turn_rate * s * c;
    const double determinant = a11 * a22 - a12 * a12;
    body->acceleration = (a22 * b1 - a12 * b2) / determinant;
    body->tilt_rate += (a11 * b2 - a12 * b1) / determinant * BODY_DT;
    body->speed += body->acceleration * BODY_DT;
}

static void lie_on_floor(struct body *body)
{
    if (fabs(body->tilt) < LYING_TILT)
        return;
    body->tilt = copysign(LYING_TILT, body->tilt);
    body->tilt_rate = 0.0;
    body->speed *= 0.98; /* the decks' edge scrapes */
    body->turn_rate *= 0.98;
}

/* A hand is never quite still: it trembles and it sways. */
static void stand_held(struct body *body)
{
    body->held += BODY_DT;
    body->tilt = TREMBLE * sin(TREMBLING * body->held) + SWAY * sin(SWAYING * body->held);
    body->tilt_rate = TREMBLE * TREMBLING * cos(TREMBLING * body->held) + SWAY * SWAYING * cos(SWAYING * body->held);
    body->speed = body->turn_rate = body->acceleration = 0.0;
    body->wheel_rates[0] = body->wheel_rates[1] = 0.0;
    body->motor_amperes[0] = body->motor_amperes[1] = 0.0;
    battery_drain(&body->battery, ELECTRONICS, BODY_DT);
}

/* Held in the air as it leans: only the wheels move. */
static void spin(struct body *body, const double duties[2])
{
    body->tilt_rate = body->speed = body->turn_rate = body->acceleration = 0.0;
    for (int side = 0; side < 2; side++) {
        body->wheel_rates[side] += motor(body, side, duties[side], body->wheel_rates[side]) / SPIN_INERTIA * BODY_DT;
        body->wheels[side] += body->wheel_rates[side] * BODY_DT;
    }
}

static void move(struct body *body)
{
    const double middle = body->heading + 0.5 * body->turn_rate * BODY_DT;
    body->x += body->speed * cos(middle) * BODY_DT;
    body->y += body->speed * sin(middle) * BODY_DT;
    body->heading += body->turn_rate * BODY_DT;
    body->tilt += body->tilt_rate * BODY_DT;
    body->wheels[0] += body->wheel_rates[0] * BODY_DT;
    body->wheels[1] += body->wheel_rates[1] * BODY_DT;
    advance_slip(body);
    lie_on_floor(body);
}

static void roll(struct body *body)
{
    double *rates = body->wheel_rates;
    double rolling, turning;
    wheel_motion(body, &rolling, &turning);
    rates[0] = (rolling - 0.5 * BODY_TRACK * turning) / BODY_WHEEL_RADIUS - body->tilt_rate;
    rates[1] = (rolling + 0.5 * BODY_TRACK * turning) / BODY_WHEEL_RADIUS - body->tilt_rate;
}

/* On its wheels. */
static void drive(struct body *body, const double duties[2])
{
    roll(body);
    const double left = motor(body, 0, duties[0], body->wheel_rates[0]);
    const double right = motor(body, 1, duties[1], body->wheel_rates[1]);
    const double yaw = (right - left) * 0.5 * BODY_TRACK / BODY_WHEEL_RADIUS - SCRUB * body->turn_rate;
    accelerate(body, left + right, touch_walls(body));
    body->turn_rate += yaw / YAW_INERTIA * BODY_DT;
    roll(body);
    move(body);
}

void body_step(struct body *body, const double duties[2])
{
    if (body->is_held) {
        stand_held(body);
        return;
    }
    if (body->is_lifted)
        spin(body, duties);
    else
        drive(body, duties);
    const double driven = duties[0] * body->motor_amperes[0] + duties[1] * body->motor_amperes[1];
    battery_drain(&body->battery, ELECTRONICS + driven, BODY_DT);
}

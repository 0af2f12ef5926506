/* SPDX-License-Identifier: Apache-2.0 */
#include "cart_body.h"

#include "../cart/program.h"

#include <math.h>
#include <string.h>

#define MASS 0.8              /* kg */
#define INERTIA 0.0019        /* kg m2 about the centre of mass, */
#define CENTRE 0.02           /* m ahead of the axle */
#define ROTOR 0.3             /* kg: a motor's rotor as its rim feels it through the gears */
#define STALL_FORCE 4.0       /* N at a rim, at the nominal voltage */
#define FREE_SPEED 0.28       /* m/s */
#define GEAR_FRICTION 0.5     /* N, */
#define STICTION_SPEED 0.002  /* m/s below which it fades */
#define GRIP 1.88             /* N that a tyre holds: 0.6 of the weight on it */
#define GRIP_SPEED 0.01       /* m/s of slip at which it holds most of it */
#define SCRUB 0.004           /* N m that thick tyres and the castor resist a turn with, */
#define SCRUB_RATE 0.2        /* rad/s below which it fades */
#define HINGE_STIFFNESS 600.0 /* N/m */
#define HINGE_DAMPING 10.0    /* N s/m */
#define BINDING 0.2           /* share of a force at the bar's end that its guides take, */
#define STICKING_LEAST 0.75   /* and now and then, */
#define STICKING_MOST 0.9    /* at most */
#define HINGE_REST 1e-6       /* m at which the bar is back; its spring alone would take for ever */
#define WALL_STIFFNESS 2e4    /* N/m */
#define WALL_DAMPING 60.0     /* N s/m */
#define RUBBER 0.8            /* friction of the bumper's tyres on a wall, */
#define PLASTIC 0.3           /* and of the rest */
#define SLIDE_SPEED 0.01      /* m/s at which friction has come up */
#define TOUCHES 4             /* steps a ms near a wall */
#define LOOK 0.3              /* m that one look for walls covers */
#define NEAR 16               /* walls that are looked at together */
#define DRAW_S 0.01           /* between two draws of the passing errors, */
#define WANDER_S 3.0          /* which last so long, of motors */
#define SLIP_S 0.3            /* and of tyres */
#define SWITCH_SHARE 0.25     /* of the bar's force that a third takes to close its switch */
#define CAPACITY (1.8 * 3600.0) /* C */
#define FULL_VOLTS 8.2        /* six cells at rest, */
#define EMPTY_VOLTS 5.6
#define RESISTANCE 0.5        /* ohm */
#define ELECTRONICS 0.15      /* A, */
#define STALL_CURRENT 0.35    /* and a motor's that stands with full power */

struct near_walls {
    struct segment segments[NEAR];
    int count;
};

void cart_body_init(struct cart_body *body, const struct caster *walls, const struct cart_build *build, uint64_t seed,
                    double x, double y, double heading)
{
    const struct cart_body fresh = {
        .walls = walls, .build = *build, .x = x, .y = y, .heading = heading, .charge = CAPACITY, .volts = FULL_VOLTS,
        .drawn = DRAW_S,
    };
    *body = fresh;
    noise_init(&body->noise, seed, 71);
    for (int side = 0; side < 2; side++) {
        struct cart_wheel *wheel = &body->wheels[side];
        wheel->gain = 1.0 + build->motor_spread * noise_normal(&body->noise);
        wheel->scale = 1.0 + build->wheel_spread * noise_normal(&body->noise);
        wheel->wander = build->motor_wander * noise_normal(&body->noise);
        wheel->slip = noise_normal(&body->noise);
        wheel->phase = noise_uniform(&body->noise);
    }
}

/* Passing errors go on as first-order processes of unit variance; turns need to know the wheels' speeds. */
static void draw_passing(struct cart_body *body, double seconds)
{
    body->drawn += seconds;
    if (body->drawn < DRAW_S)
        return;
    body->drawn -= DRAW_S;
    const double wander = exp(-DRAW_S / WANDER_S), slip = exp(-DRAW_S / SLIP_S);
    for (int side = 0; side < 2; side++) {
        struct cart_wheel *wheel = &body->wheels[side];
        const double fresh = body->build.motor_wander * sqrt(1.0 - wander * wander);
        wheel->wander = wander * wheel->wander + fresh * noise_normal(&body->noise);
        wheel->slip = slip * wheel->slip + sqrt(1.0 - slip * slip) * noise_normal(&body->noise);
    }
}

static double resting_volts(const struct cart_body *body)
{
    return EMPTY_VOLTS + (FULL_VOLTS - EMPTY_VOLTS) * body->charge / CAPACITY;
}

static double amperes(const struct cart_body *body, const double powers[2])
{
    double sum = ELECTRONICS;
    for (int side = 0; side < 2; side++) {
        const double load = fmax(0.0, fabs(powers[side]) - fabs(body->wheels[side].speed) / FREE_SPEED);
        sum += STALL_CURRENT * fabs(powers[side]) * (0.2 + load);
    }
    return sum;
}

/* Speed of a tyre over the floor, along and across it, from the body's motion. */
static void floor_speeds(const struct cart_body *body, double *forward, double *sideways)
{
    const double c = cos(body->heading), s = sin(body->heading);
    *forward = c * body->vx + s * body->vy;
    *sideways = -s * body->vx + c * body->vy - CENTRE * body->turn_rate;
}

struct push {
    double fx, fy, torque; /* on the body, about its centre of mass, in the world's frame */
    double bar;            /* N on the bumper's bar, backward, */
    double moment;         /* N m, of what presses it aside of its middle */
};

/* A force at a point of the body (in its own frame, from the axle), given along and across its heading. */
static void add_push(const struct cart_body *body, struct push *push, double ahead, double aside, double along,
                     double across)
{
    const double c = cos(body->heading), s = sin(body->heading);
    push->fx += c * along - s * across;
    push->fy += s * along + c * across;
    push->torque += (ahead - CENTRE) * across - aside * along;
}

/* Motors turn the wheels, tyres push the body. */
static void roll(struct cart_body *body, const double powers[2], double seconds, struct push *push)
{
    double forward, sideways;
    floor_speeds(body, &forward, &sideways);
    const double half = 0.5 * body->build.wheelbase;
    const double speeds = fabs(body->wheels[0].speed) + fabs(body->wheels[1].speed);
    const double turning = speeds > 0.0 ? fabs(body->wheels[1].speed - body->wheels[0].speed) / speeds : 0.0;
    const double slip = body->build.slip + turning * body->build.turn_slip;
    for (int side = 0; side < 2; side++) {
        struct cart_wheel *wheel = &body->wheels[side];
        const double aside = side == 0 ? half : -half;
        const double rim = wheel->speed * wheel->scale * (1.0 + slip * wheel->slip);
        const double along = rim - (forward - aside * body->turn_rate), across = -sideways;
        const double held = GRIP / sqrt(along * along + across * across + GRIP_SPEED * GRIP_SPEED);
        add_push(body, push, 0.0, aside, held * along, held * across);
        const double drive = powers[side] * body->volts / CART_NOMINAL_VOLTS * (wheel->gain + wheel->wander);
        const double friction = GEAR_FRICTION * fmax(-1.0, fmin(1.0, wheel->speed / STICTION_SPEED));
        const double force = STALL_FORCE * (drive - wheel->speed / FREE_SPEED) - friction - held * along;
        wheel->speed += force / ROTOR * seconds;
        wheel->way += wheel->speed * seconds;
        const double play = 0.5 * body->build.play * body->build.tick;
        wheel->counted = fmax(wheel->way - play, fmin(wheel->way + play, wheel->counted));
    }
    push->torque -= SCRUB * body->turn_rate / hypot(body->turn_rate, SCRUB_RATE);
}

/* A wall presses at a point of the body by `depth`, along a unit vector (nx, ny) of the body's frame; both in its frame. */
static void press(struct cart_body *body, struct push *push, double ahead, double aside, double nx, double ny,
                  double depth, bool is_bumper)
{
    const double c = cos(body->heading), s = sin(body->heading);
    const double along = c * body->vx + s * body->vy - aside * body->turn_rate;
    const double across = -s * body->vx + c * body->vy + (ahead - CENTRE) * body->turn_rate;
    const double normal = fmax(0.0, WALL_STIFFNESS * depth - WALL_DAMPING * (nx * along + ny * across));
    const double slide = -ny * along + nx * across;
    const double friction = -(is_bumper ? RUBBER : PLASTIC) * normal * slide / hypot(slide, SLIDE_SPEED);
    const double fx = nx * normal - ny * friction, fy = ny * normal + nx * friction;
    add_push(body, push, ahead, aside, fx, fy);
    body->deepest = fmax(body->deepest, depth);
    if (!is_bumper || fx >= 0.0)
        return;
    push->bar -= fx;
    push->moment -= fx * aside;
    const double third = body->build.bumper_width / 6.0;
    body->thirds[aside > third ? 0 : aside < -third ? 2 : 1] -= fx;
}

/* Where two stretches cross, as a share of the first; negative where they do not. */
static double crossing(double x1, double y1, double x2, double y2, const struct segment *wall)
{
    const double dx = x2 - x1, dy = y2 - y1, wx = wall->x2 - wall->x1, wy = wall->y2 - wall->y1;
    const double across = dx * wy - dy * wx;
    if (across == 0.0)
        return -1.0;
    const double ox = wall->x1 - x1, oy = wall->y1 - y1;
    const double share = (ox * wy - oy * wx) / across, on_wall = (ox * dy - oy * dx) / across;
    return share >= 0.0 && share <= 1.0 && on_wall >= 0.0 && on_wall <= 1.0 ? share : -1.0;
}

/* A corner of the cart that is beyond a wall is pushed back out of it. All in the body's frame. */
static void press_corner(struct cart_body *body, struct push *push, double ahead, double aside, bool is_bumper,
                         const struct segment *wall)
{
    if (crossing(0.4 * ahead, 0.0, ahead, aside, wall) < 0.0)
        return;
    const double wx = wall->x2 - wall->x1, wy = wall->y2 - wall->y1, length = hypot(wx, wy);
    double nx = -wy / length, ny = wx / length;
    double depth = nx * (wall->x1 - ahead) + ny * (wall->y1 - aside);
    if (depth < 0.0) {
        depth = -depth;
        nx = -nx;
        ny = -ny;
    }
    press(body, push, ahead, aside, nx, ny, depth, is_bumper);
}

/* A corner of a wall that is inside of the cart is pushed out of the nearest side. */
static void press_wall_corner(struct cart_body *body, struct push *push, double front, double x, double y)
{
    const double half = 0.5 * body->build.bumper_width;
    const double to_front = front - x, to_rear = x + CART_BEHIND, to_left = half - y, to_right = y + half;
    if (to_front <= 0.0 || to_rear <= 0.0 || to_left <= 0.0 || to_right <= 0.0)
        return;
    const double least = fmin(fmin(to_front, to_rear), fmin(to_left, to_right));
    if (least == to_front)
        press(body, push, x, y, -1.0, 0.0, least, true);
    else if (least == to_rear)
        press(body, push, x, y, 1.0, 0.0, least, false);
    else
        press(body, push, x, y, 0.0, least == to_left ? -1.0 : 1.0, least, false);
}

static double front_of(const struct cart_body *body)
{
    return body->build.bumper_ahead + CART_CLOSING - body->hinge;
}

/* Radius around the axle that holds all of the cart. */
static double reach_of(const struct cart_body *body)
{
    return hypot(body->build.bumper_ahead + CART_CLOSING, 0.5 * body->build.bumper_width);
}

static struct segment seen_from(const struct cart_body *body, const struct segment *wall)
{
    const double c = cos(body->heading), s = sin(body->heading);
    const double x1 = wall->x1 - body->x, y1 = wall->y1 - body->y, x2 = wall->x2 - body->x, y2 = wall->y2 - body->y;
    const struct segment seen = {c * x1 + s * y1, -s * x1 + c * y1, c * x2 + s * y2, -s * x2 + c * y2};
    return seen;
}

static double distance_to(const struct segment *wall, double x, double y)
{
    const double wx = wall->x2 - wall->x1, wy = wall->y2 - wall->y1;
    const double along = ((x - wall->x1) * wx + (y - wall->y1) * wy) / (wx * wx + wy * wy);
    const double share = fmax(0.0, fmin(1.0, along));
    return hypot(wall->x1 + share * wx - x, wall->y1 + share * wy - y);
}

static void find_near(const struct cart_body *body, double reach, struct near_walls *near)
{
    near->count = 0;
    for (int32_t i = 0; i < body->walls->count && near->count < NEAR; i++)
        if (distance_to(&body->walls->segments[i], body->x, body->y) < reach)
            near->segments[near->count++] = body->walls->segments[i];
}

static void touch(struct cart_body *body, const struct near_walls *near, struct push *push)
{
    const double half = 0.5 * body->build.bumper_width, front = front_of(body);
    memset(body->thirds, 0, sizeof body->thirds);
    for (int i = 0; i < near->count; i++) {
        const struct segment wall = seen_from(body, &near->segments[i]);
        press_corner(body, push, front, half, true, &wall);
        press_corner(body, push, front, -half, true, &wall);
        press_corner(body, push, -CART_BEHIND, half, false, &wall);
        press_corner(body, push, -CART_BEHIND, -half, false, &wall);
        press_wall_corner(body, push, front, wall.x1, wall.y1);
    }
}

static void move(struct cart_body *body, const struct push *push, double seconds)
{
    double x = body->x + CENTRE * cos(body->heading), y = body->y + CENTRE * sin(body->heading);
    body->vx += push->fx / MASS * seconds;
    body->vy += push->fy / MASS * seconds;
    body->turn_rate += push->torque / INERTIA * seconds;
    x += body->vx * seconds;
    y += body->vy * seconds;
    body->heading += body->turn_rate * seconds;
    body->x = x - CENTRE * cos(body->heading);
    body->y = y - CENTRE * sin(body->heading);
}

static double draw_binding(struct cart_body *body)
{
    if (noise_uniform(&body->noise) >= body->build.stick_share)
        return BINDING;
    return STICKING_LEAST + (STICKING_MOST - STICKING_LEAST) * noise_uniform(&body->noise);
}

/* The bar follows what presses it, and its spring. Pressed at an end it binds: so much of the force is lost. */
static void give_way(struct cart_body *body, const struct push *push, double seconds)
{
    if (push->bar == 0.0 && body->hinge == 0.0)
        body->binding = draw_binding(body);
    const double lost = body->binding * fabs(push->moment) / (0.5 * body->build.bumper_width);
    const double speed = (push->bar - lost - HINGE_STIFFNESS * body->hinge) / HINGE_DAMPING;
    body->hinge = fmin(CART_TRAVEL, body->hinge + speed * seconds);
    if (body->hinge < HINGE_REST)
        body->hinge = 0.0;
}

static void step(struct cart_body *body, const double powers[2], double seconds, const struct near_walls *near)
{
    struct push push = {0};
    roll(body, powers, seconds, &push);
    if (near != NULL)
        touch(body, near, &push);
    if (near != NULL)
        give_way(body, &push, seconds);
    move(body, &push, seconds);
}

/* Whether a wall is within reach of any part in this ms. */
static bool is_near(struct cart_body *body)
{
    body->clearance -= hypot(body->vx, body->vy) * BODY_DT + fabs(body->turn_rate) * CENTRE * BODY_DT;
    if (body->clearance > 0.0)
        return false;
    double px, py;
    const double reach = reach_of(body) + 0.002;
    const double distance = caster_nearest(body->walls, body->x, body->y, reach + LOOK, &px, &py);
    if (distance <= reach)
        return true;
    body->clearance = fmin(distance - reach, LOOK);
    return false;
}

void cart_body_step(struct cart_body *body, const double powers[2])
{
    const double current = amperes(body, powers);
    body->volts = resting_volts(body) - RESISTANCE * current;
    body->charge = fmax(0.0, body->charge - current * BODY_DT);
    draw_passing(body, BODY_DT);
    if (!is_near(body)) {
        step(body, powers, BODY_DT, NULL);
        return;
    }
    struct near_walls near;
    find_near(body, reach_of(body) + 0.004, &near);
    for (int i = 0; i < TOUCHES; i++)
        step(body, powers, BODY_DT / TOUCHES, &near);
}

uint16_t cart_body_ticks(const struct cart_body *body, int side)
{
    const struct cart_wheel *wheel = &body->wheels[side];
    return (uint16_t)(int64_t)floor(wheel->counted / body->build.tick + wheel->phase);
}

uint8_t cart_body_bumper(const struct cart_body *body)
{
    if (body->hinge < CART_CLOSING)
        return 0;
    if (body->build.switches == 1)
        return CART_MIDDLE;
    const double sum = body->thirds[0] + body->thirds[1] + body->thirds[2];
    uint8_t closed = 0;
    for (int i = 0; i < 3; i++)
        if (sum > 0.0 && body->thirds[i] >= SWITCH_SHARE * sum)
            closed |= (uint8_t)(1u << i);
    return closed;
}

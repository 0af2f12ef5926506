/* SPDX-License-Identifier: Apache-2.0 */
#include "sensors.h"

#include <math.h>

#define GRAVITY 9.81
#define ADC_MAX 1023.0
#define ADC_MIDDLE 512.0
#define GYRO_COUNTS 146.6773      /* per rad/s: 12.5 mV per deg/s at 4.88 mV per count */
#define ACCELEROMETER_COUNTS 204.8 /* per g */
#define GYRO_NOISE 2.86           /* counts before its filter: 0.05 deg/s in each root hertz, up to 500 Hz */
#define CONVERTER_NOISE 0.5       /* counts of supply and converter, behind it */
#define ACCELEROMETER_NOISE 1.5
#define GYRO_SWING 460.0         /* counts from the middle that an ADXRS150 can show: 0.25 V from its supply's ends */
#define GYRO_ZERO_SPREAD 10.0     /* counts from part to part */
#define ACCELEROMETER_ZERO_SPREAD 0.5
#define READINGS_PER_SECOND 1000.0

#define SONAR_FADE 2.0            /* m; weaker echoes from here on */
#define SONAR_NOISE 0.008         /* m */
#define SONAR_SCALE_NOISE 0.008   /* share of the range */
#define MIRROR_ANGLE 0.21         /* rad of incidence up to which a smooth wall answers surely */
#define DULL_ANGLE 0.45           /* and beyond which it does not answer */
#define EDGE_JUMP 0.10            /* m between neighbouring rays: an edge */
#define CORNER_COSINE 0.87        /* of the angle between walls that meet in a corner */
#define EDGE_ECHO 0.6             /* share of echoes that edges give back, */
#define CORNER_ECHO 0.95          /* and corners, which are retro-reflectors */
#define LOST_ECHO 0.02
#define CROSSTALK 0.015
#define GHOST 0.008
#define GHOST_NEAREST 0.15

#define FAR_DISTANCE 1.6          /* m: nothing farther changes a GP2D12's reading */
#define LIGHT_ANGLE 1.22          /* rad of incidence beyond which too little light returns */
#define LIGHT_SCALE_NOISE 0.01
#define LIGHT_NOISE 5.0           /* counts, one reading */
#define SPIKE 0.03                /* share of readings taken during another sensor's light pulse */
#define SPIKE_COUNTS 45.0

#define GYRO_PASSED 0.693         /* share of the news in 1 ms: 1 - exp(-2 pi 188 / 1000), for 4.7 nF at its output */

static uint16_t converted(double counts)
{
    return (uint16_t)fmax(0.0, fmin(ADC_MAX, floor(counts)));
}

void inertial_init(struct gyro_and_accelerometer *parts, uint64_t seed)
{
    noise_init(&parts->noise, seed, 2);
    parts->gyro_zero = ADC_MIDDLE + GYRO_ZERO_SPREAD * noise_normal(&parts->noise);
    parts->gyro_walk = 0.0;
    parts->gyro_shown = 0.0;
    parts->accelerometer_zero = ADC_MIDDLE + ACCELEROMETER_ZERO_SPREAD * noise_normal(&parts->noise);
}

void inertial_read(struct gyro_and_accelerometer *parts, const struct body *body, uint16_t *gyro,
                   uint16_t *accelerometer)
{
    if (parts->gyro_walk > 0.0)
        parts->gyro_zero += parts->gyro_walk / sqrt(READINGS_PER_SECOND) * noise_normal(&parts->noise);
    const double along = sin(body->tilt) - body->acceleration * cos(body->tilt) / GRAVITY;
    const double hissing = GYRO_COUNTS * body->tilt_rate + GYRO_NOISE * noise_normal(&parts->noise);
    parts->gyro_shown += GYRO_PASSED * (hissing - parts->gyro_shown);
    const double shown = parts->gyro_zero + parts->gyro_shown + CONVERTER_NOISE * noise_normal(&parts->noise);
    *gyro = converted(fmax(ADC_MIDDLE - GYRO_SWING, fmin(ADC_MIDDLE + GYRO_SWING, shown)) + 0.5);
    *accelerometer = converted(parts->accelerometer_zero + ACCELEROMETER_COUNTS * along +
                               ACCELEROMETER_NOISE * noise_normal(&parts->noise) + 0.5);
}

void rangefinders_init(struct rangefinders *rangefinders, const struct caster *walls, uint64_t seed)
{
    rangefinders->walls = walls;
    noise_init(&rangefinders->echo, seed, 3);
    noise_init(&rangefinders->light, seed, 4);
}

struct beam beam_of(const struct place *place, int index, double offset, double height)
{
    const double bearing = index * 0.7853981633974483;
    const double cos_b = cos(bearing), sin_b = sin(bearing);
    const double cos_t = cos(place->tilt), sin_t = sin(place->tilt);
    const double cos_h = cos(place->heading), sin_h = sin(place->heading);
    const double above = height - BODY_WHEEL_RADIUS; /* the body leans about the axle */
    const double forward = offset * cos_b * cos_t + above * sin_t, left = offset * sin_b;
    const double ahead = cos_b * cos_t; /* the direction, in the heading's frame */
    const double flat = hypot(ahead, sin_b);
    const struct beam beam = {
        .x = place->x + cos_h * forward - sin_h * left,
        .y = place->y + sin_h * forward + cos_h * left,
        .z = BODY_WHEEL_RADIUS + above * cos_t - offset * cos_b * sin_t,
        .dx = (cos_h * ahead - sin_h * sin_b) / flat,
        .dy = (sin_h * ahead + cos_h * sin_b) / flat,
        .elevation = atan2(-cos_b * sin_t, flat),
    };
    return beam;
}

/* Share of a ping that a wall gives back to where it came from. */
static double mirrored(double cosine)
{
    const double incidence = acos(fmin(1.0, cosine));
    return fmax(0.0, fmin(1.0, (DULL_ANGLE - incidence) / (DULL_ANGLE - MIRROR_ANGLE)));
}

/* Echo from between two neighbouring rays that meet different walls: edges scatter from the nearer one, corners send
 * back, from their depth. Returns its share and sets its range. */
static double scattered(const struct caster *walls, const struct hit *a, const struct hit *b, double *range)
{
    *range = fmin(a->range, b->range);
    if (a->segment == b->segment)
        return 0.0;
    if (a->segment < 0 || b->segment < 0 || fabs(a->range - b->range) > EDGE_JUMP)
        return EDGE_ECHO;
    const struct segment *s = &walls->segments[a->segment], *t = &walls->segments[b->segment];
    const double sx = s->x2 - s->x1, sy = s->y2 - s->y1, tx = t->x2 - t->x1, ty = t->y2 - t->y1;
    const double cosine = fabs(sx * tx + sy * ty) / (hypot(sx, sy) * hypot(tx, ty));
    *range = fmax(a->range, b->range);
    return cosine < CORNER_COSINE ? CORNER_ECHO : 0.0;
}

/* The beam's strength at an angle off its axis. */
static double pattern(double angle)
{
    const double share = 1.4 * angle / SONAR_HALF_ANGLE;
    return exp(-0.5 * share * share);
}

static double floor_range(const struct beam *beam, double elevation)
{
    return elevation < 0.0 ? beam->z / sin(-elevation) : INFINITY;
}

/* Nearest floor echo of a leaning sonar: a smooth floor, too, answers only near its normal. */
static double floor_echo(struct noise *noise, const struct beam *beam)
{
    const double lowest = beam->elevation - SONAR_HALF_ANGLE;
    const double range = floor_range(beam, lowest);
    if (range > SONAR_MAX_RANGE || noise_uniform(noise) >= mirrored(sin(-lowest)))
        return INFINITY;
    return range;
}

struct cone { /* the rays of one ping */
    double angles[SONAR_RAYS];
    struct hit hits[SONAR_RAYS];
};

static void cast_cone(const struct caster *walls, const struct beam *beam, struct cone *cone)
{
    for (int i = 0; i < SONAR_RAYS; i++) {
        cone->angles[i] = SONAR_HALF_ANGLE * (2.0 * i / (SONAR_RAYS - 1) - 1.0);
        const double c = cos(cone->angles[i]), s = sin(cone->angles[i]);
        cone->hits[i] = caster_ray(walls, beam->x, beam->y, c * beam->dx - s * beam->dy, s * beam->dx + c * beam->dy,
                                   SONAR_MAX_RANGE);
    }
}

/* Draws whether an echo of a share is heard from an angle, and takes it if it is the nearest so far. */
static void listen(struct noise *noise, double share, double angle, double range, double *nearest)
{
    if (share <= 0.0 || !(range < *nearest))
        return;
    const double fading = 1.0 - 0.4 * fmax(0.0, range - SONAR_FADE);
    if (noise_uniform(noise) < share * pattern(angle) * fading)
        *nearest = range;
}

/* Nearest echo in the cone. The wall is upright: whatever the lean, the cone's level part meets it first. */
static double first_echo(struct rangefinders *rangefinders, const struct beam *beam)
{
    struct cone cone;
    struct noise *noise = &rangefinders->echo;
    cast_cone(rangefinders->walls, beam, &cone);
    double nearest = floor_echo(noise, beam);
    for (int i = 0; i < SONAR_RAYS; i++) {
        const double angle = hypot(cone.angles[i], beam->elevation);
        if (cone.hits[i].segment >= 0)
            listen(noise, mirrored(cone.hits[i].cosine), angle, cone.hits[i].range, &nearest);
        if (i == 0)
            continue;
        double range;
        const double share = scattered(rangefinders->walls, &cone.hits[i - 1], &cone.hits[i], &range);
        listen(noise, share, angle, range, &nearest);
    }
    return nearest;
}

/* What the receiver makes of the true first echo: lost ones, ghosts of earlier pings, jitter of a few wavefronts. */
static double heard(struct noise *noise, double range)
{
    const double chance = noise_uniform(noise);
    if (chance < GHOST)
        range = GHOST_NEAREST + noise_uniform(noise) * (SONAR_MAX_RANGE - GHOST_NEAREST);
    else if (chance < GHOST + LOST_ECHO)
        range = INFINITY;
    if (range == INFINITY)
        return INFINITY;
    range += noise_normal(noise) * (SONAR_NOISE + SONAR_SCALE_NOISE * range);
    if (range > SONAR_MAX_RANGE)
        return INFINITY;
    return fmax(range, SONAR_MIN_RANGE); /* nearer walls answer while the burst still rings */
}

/* Now and then a sonar hears the ping of one that fired with it, if that comes before its own. */
static void mix_up(struct noise *noise, uint8_t fired, double *ranges)
{
    double own[SENSOR_COUNT];
    for (int i = 0; i < SENSOR_COUNT; i++)
        own[i] = ranges[i];
    for (int i = 0; i < SENSOR_COUNT; i++) {
        if (!(fired >> i & 1) || noise_uniform(noise) >= CROSSTALK)
            continue;
        const int other = (i + (noise_uniform(noise) < 0.5 ? 2 : SENSOR_COUNT - 2)) % SENSOR_COUNT;
        const double detour = 0.02 + 0.15 * noise_uniform(noise);
        if (fired >> other & 1)
            ranges[i] = fmin(ranges[i], own[other] + detour);
    }
}

void sonar_ping(struct rangefinders *rangefinders, const struct place *place, uint8_t fired, double *ranges)
{
    for (int i = 0; i < SENSOR_COUNT; i++) {
        if (!(fired >> i & 1))
            continue;
        const struct beam beam = beam_of(place, i, SONAR_OFFSET, SONAR_HEIGHT);
        ranges[i] = first_echo(rangefinders, &beam);
    }
    mix_up(&rangefinders->echo, fired, ranges);
    for (int i = 0; i < SENSOR_COUNT; i++)
        if (fired >> i & 1)
            ranges[i] = heard(&rangefinders->echo, ranges[i]);
}

void infrared_look(const struct rangefinders *rangefinders, const struct place *place, double *distances)
{
    for (int i = 0; i < SENSOR_COUNT; i++) {
        const struct beam beam = beam_of(place, i, INFRARED_OFFSET, INFRARED_HEIGHT);
        const struct hit hit = caster_ray(rangefinders->walls, beam.x, beam.y, beam.dx, beam.dy, FAR_DISTANCE);
        const double level = cos(beam.elevation);
        const double wall = hit.cosine * level > cos(LIGHT_ANGLE) ? hit.range / level : INFINITY;
        const double ground = -beam.elevation > 0.5 * 3.141592653589793 - LIGHT_ANGLE
                                  ? floor_range(&beam, beam.elevation) : INFINITY;
        distances[i] = fmin(wall, ground);
    }
}

double infrared_counts(double distance)
{
    const double far = fmin(distance, FAR_DISTANCE);
    const double peak = 6787.0 / (100.0 * INFRARED_FOLD + 4.0) + 3.0;
    const double contact = 120.0; /* about 0.6 V with something on the lens */
    if (far < INFRARED_FOLD)
        return contact + (peak - contact) * far / INFRARED_FOLD;
    return 6787.0 / (100.0 * far + 4.0) + 3.0;
}

uint16_t infrared_read(struct rangefinders *rangefinders, double distance)
{
    struct noise *noise = &rangefinders->light;
    double counts = infrared_counts(distance * (1.0 + LIGHT_SCALE_NOISE * noise_normal(noise)));
    counts += LIGHT_NOISE * noise_normal(noise);
    if (noise_uniform(noise) < SPIKE)
        counts += SPIKE_COUNTS * noise_uniform(noise);
    return converted(counts + 0.5);
}

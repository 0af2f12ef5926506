/* SPDX-License-Identifier: Apache-2.0
 *
 * What Crunch's sensors show: gyro and accelerometer, sonar cones and GP2D12 beams, all carried by a body that leans.
 *
 * A lean tilts every beam: a forward one then meets the floor at height / sin(lean). Ranges in m, times in s or us.
 */
#ifndef CRUNCH_VIRTUAL_SENSORS_H
#define CRUNCH_VIRTUAL_SENSORS_H

#include "body.h"

#define SENSOR_COUNT 8            /* of each ring; index 0 forward, counter-clockwise by 45 degrees */
#define SONAR_OFFSET 0.070        /* m from the axis along the bearing */
#define SONAR_HEIGHT 0.152        /* m above the floor */
#define SONAR_HALF_ANGLE 0.39269908169872414
#define SONAR_MIN_RANGE 0.03
#define SONAR_MAX_RANGE 3.0
#define SONAR_RAYS 15             /* across the cone */
#define SOUND_SPEED 343.0
#define INFRARED_OFFSET 0.050
#define INFRARED_HEIGHT 0.203
#define INFRARED_FOLD 0.08        /* m: nearer than this the curve folds back */

struct place { /* of the body on the floor */
    double x, y, heading, tilt;
};

struct beam { /* of a sensor in the world */
    double x, y, z;    /* its face */
    double dx, dy;     /* direction over the floor, a unit vector */
    double elevation;  /* rad above the horizontal */
};

/* 10-bit readings. */
struct gyro_and_accelerometer {
    double gyro_zero;      /* counts, of this part */
    double gyro_shown;     /* counts off its zero, behind the body's rate by its filter */
    double gyro_walk;      /* counts per root of a second by which its zero wanders; 0 unless set */
    double accelerometer_zero;
    struct noise noise;
};

struct rangefinders {
    const struct caster *walls;
    struct noise echo;
    struct noise light;
};

void inertial_init(struct gyro_and_accelerometer *parts, uint64_t seed);
void inertial_read(struct gyro_and_accelerometer *parts, const struct body *body, uint16_t *gyro,
                   uint16_t *accelerometer);

void rangefinders_init(struct rangefinders *rangefinders, const struct caster *walls, uint64_t seed);

/* The beam of sensor `index` that sits `offset` from the axis and `height` above the floor when upright. */
struct beam beam_of(const struct place *place, int index, double offset, double height);

/* Ranges that the sonars of the set `fired` measure when they fire together; INFINITY without echo. Others are left. */
void sonar_ping(struct rangefinders *rangefinders, const struct place *place, uint8_t fired, double *ranges);

/* Distances that the eight GP2D12 see, INFINITY for none, without noise. */
void infrared_look(const struct rangefinders *rangefinders, const struct place *place, double *distances);

/* ADC counts for a distance by the datasheet's curve; below 8 cm it folds back. */
double infrared_counts(double distance);

/* One noisy ADC reading for a distance. */
uint16_t infrared_read(struct rangefinders *rangefinders, double distance);

#endif

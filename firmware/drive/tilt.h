/* SPDX-License-Identifier: Apache-2.0
 *
 * The body's lean from an angular rate sensor and an accelerometer: a complementary filter (thesis, 1.1).
 *
 * The gyro is trusted over short times, the accelerometer over long ones. The time constant is 3 s: at 1 s the
 * horizontal acceleration of driving leaks in and the robot falls. A slow third term trims the gyro's zero, which is
 * first learned while the robot is held still before arming. Angles in rad, rates in rad/s, forward positive.
 */
#ifndef CRUNCH_DRIVE_TILT_H
#define CRUNCH_DRIVE_TILT_H

#include <stdbool.h>
#include <stdint.h>

#define TILT_OVERSAMPLING 5 /* ADC readings summed per step: 1 kHz sweep, 200 Hz loop */
#define TILT_REST_STEPS 200 /* 1 s, over which the gyro's zero is learned */
#define TILT_DT 0.005f      /* s between steps */

#define TILT_TIME_CONSTANT 3.0f /* s, built-in; test before changing: 1 s falls */

/* 10-bit ADC on 5 V: ADXRS150 12.5 mV per deg/s around 2.5 V, ADXL203 1 V per g around 2.5 V. */
#define TILT_ZERO_COUNTS 512.0f
#define TILT_GYRO_RAD_PER_COUNT 0.00681769f
#define TILT_G_PER_COUNT 0.0048828125f

/* Sums of TILT_OVERSAMPLING readings each. */
struct inertial_sums {
    uint16_t gyro;
    uint16_t accelerometer;
};

struct tilt {
    float angle;
    float rate;
    float gravity;       /* the angle that the accelerometer alone shows at this step */
    float gyro_zero;     /* rad/s that the gyro shows at rest */
    float accelerometer_zero; /* counts that the accelerometer shows upright; a setting, TILT_ZERO_COUNTS unless learned */
    float time_constant; /* s, of the filter; a setting */
    float rest_sum;      /* of the raw rate while still, */
    float level_sum;     /* and of the accelerometer's counts, */
    uint16_t rest_steps; /* over so many steps; a motion begins them anew */
    float level;         /* the accelerometer's counts in the last whole second of rest */
    float rest_rate;     /* the raw rate, smoothed, */
    float rest_low;      /* and its extremes in this rest */
    float rest_high;
    uint16_t rest_gyro;  /* the gyro's first sum of this rest; */
    bool is_shivering;   /* it has shown another since, as any that works does */
    bool is_rested;      /* the zero is learned, and the body has been still since */
    uint16_t rail_steps; /* steps in a row with a sensor at an end of its range */
};

void tilt_init(struct tilt *tilt);

/* One step of the filter. */
void tilt_step(struct tilt *tilt, const struct inertial_sums *sums);

/* Called after tilt_step while not balancing: after 1 s without motion the gyro's zero is learned and the angle is the
 * accelerometer's. Returns true from then on, until the body moves. */
bool tilt_rest(struct tilt *tilt, const struct inertial_sums *sums);

/* Takes what the accelerometer showed in the last second of rest as upright: for a builder who holds the robot where it
 * neither falls forward nor backward. Changes nothing and returns false unless it is at rest and within 0.2 g of the
 * middle. */
bool tilt_level(struct tilt *tilt);

/* Begins the second of rest anew: the gyro's zero is learned from what comes from now on. */
void tilt_zero(struct tilt *tilt);

/* Angle that the accelerometer alone shows. */
float tilt_of_gravity(const struct tilt *tilt, const struct inertial_sums *sums);

#endif

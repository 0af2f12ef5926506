/* SPDX-License-Identifier: Apache-2.0 */
#include "tilt.h"

#include "arithmetic.h"

#define TRIM_TIME 30.0f      /* s; how slowly the gyro's zero follows */
#define REST_TIME_CONSTANT 0.25f /* s; while still, the accelerometer is right */
#define STILL_SPREAD 0.05f   /* rad/s between extremes of the smoothed rate: one ADC count is 0.0068 */
#define STILL_TIME 0.1f      /* s of smoothing: a hand trembles, and the gyro hisses, by as much as STILL_SPREAD and more */
#define SETTLING_STEPS 20    /* of a rest, until a third is left of the raw reading that smoothing begins with */
#define MAX_ZERO 0.36f       /* rad/s: the gyro's 0.2 V are 0.28, the MPU-6050's 20 deg/s 0.35 */
#define MAX_LEVEL 41.0f      /* counts from the middle, 0.2 g: a part beyond it is broken, or held askew */
#define ONE_READING (1.0f / (float)TILT_OVERSAMPLING) /* of a sum; divisions take thrice as long */
#define RAIL_LOW (4u * TILT_OVERSAMPLING)
#define RAIL_HIGH (1019u * TILT_OVERSAMPLING)

static float raw_rate(const struct inertial_sums *sums)
{
    return ((float)sums->gyro * ONE_READING - TILT_ZERO_COUNTS) * TILT_GYRO_RAD_PER_COUNT;
}

static bool is_at_rail(uint16_t sum)
{
    return sum <= RAIL_LOW || sum >= RAIL_HIGH;
}

static void start_rest(struct tilt *tilt, uint16_t gyro, float rate)
{
    tilt->rest_sum = tilt->level_sum = 0.0f;
    tilt->rest_steps = 0;
    if (!tilt->is_rested)
        tilt->rest_rate = rate;
    tilt->rest_low = tilt->rest_high = tilt->rest_rate;
    tilt->rest_gyro = gyro;
    tilt->is_shivering = false;
}

void tilt_init(struct tilt *tilt)
{
    tilt->angle = 0.0f;
    tilt->rate = 0.0f;
    tilt->gravity = 0.0f;
    tilt->gyro_zero = 0.0f;
    tilt->accelerometer_zero = tilt->level = TILT_ZERO_COUNTS;
    tilt->time_constant = TILT_TIME_CONSTANT;
    tilt->rail_steps = 0;
    tilt->is_rested = false;
    tilt->rest_steps = 0;
}

static float accelerometer_counts(const struct inertial_sums *sums)
{
    return (float)sums->accelerometer * ONE_READING;
}

float tilt_of_gravity(const struct tilt *tilt, const struct inertial_sums *sums)
{
    const float sine =
        limited((accelerometer_counts(sums) - tilt->accelerometer_zero) * TILT_G_PER_COUNT, 1.0f);
    const float square = sine * sine;
    /* the arc sine, exact near upright and within 0.05 rad up to lying */
    return sine * (1.0f + square * (1.0f / 6.0f + square * (3.0f / 40.0f + square * 0.32f)));
}

void tilt_step(struct tilt *tilt, const struct inertial_sums *sums)
{
    tilt->rate = raw_rate(sums) - tilt->gyro_zero;
    tilt->gravity = tilt_of_gravity(tilt, sums); /* once per step: it takes long */
    const float pull = (tilt->gravity - tilt->angle) / tilt->time_constant; /* rad/s */
    tilt->angle += (tilt->rate + pull) * TILT_DT;
    tilt->gyro_zero -= pull * (TILT_DT / TRIM_TIME);
    if (!is_at_rail(sums->gyro) && !is_at_rail(sums->accelerometer))
        tilt->rail_steps = 0;
    else if (tilt->rail_steps < UINT16_MAX)
        tilt->rail_steps++;
}

bool tilt_rest(struct tilt *tilt, const struct inertial_sums *sums)
{
    const float rate = raw_rate(sums);
    if (tilt->rest_steps == 0)
        start_rest(tilt, sums->gyro, rate);
    if (sums->gyro != tilt->rest_gyro)
        tilt->is_shivering = true;
    tilt->rest_rate += (rate - tilt->rest_rate) * (TILT_DT / STILL_TIME);
    if (!tilt->is_rested && tilt->rest_steps < SETTLING_STEPS)
        tilt->rest_low = tilt->rest_high = tilt->rest_rate;
    if (tilt->rest_rate < tilt->rest_low)
        tilt->rest_low = tilt->rest_rate;
    if (tilt->rest_rate > tilt->rest_high)
        tilt->rest_high = tilt->rest_rate;
    if (tilt->rest_high - tilt->rest_low > STILL_SPREAD) {
        tilt->is_rested = false;
        start_rest(tilt, sums->gyro, rate);
    }
    tilt->rest_sum += rate;
    tilt->level_sum += accelerometer_counts(sums);
    tilt->rest_steps++;
    if (tilt->rest_steps == TILT_REST_STEPS) {
        const float zero = tilt->rest_sum / (float)TILT_REST_STEPS;
        const bool is_stuck = !tilt->is_shivering || magnitude(zero) > MAX_ZERO;
        tilt->rest_steps = 0; /* and learn on, second by second */
        if (tilt->rail_steps > 0 || is_stuck) { /* it would seem still */
            tilt->is_rested = false;
            return false;
        }
        tilt->gyro_zero = zero;
        if (!tilt->is_rested)
            tilt->angle = tilt_of_gravity(tilt, sums);
        tilt->level = tilt->level_sum / (float)TILT_REST_STEPS;
        tilt->is_rested = true;
    }
    if (tilt->is_rested) /* a still body leans as gravity says, however it came there */
        tilt->angle += (tilt_of_gravity(tilt, sums) - tilt->angle) * (TILT_DT / REST_TIME_CONSTANT);
    return tilt->is_rested;
}

bool tilt_level(struct tilt *tilt)
{
    const float away = tilt->level - TILT_ZERO_COUNTS;
    if (!tilt->is_rested || magnitude(away) > MAX_LEVEL)
        return false;
    tilt->accelerometer_zero = tilt->level;
    tilt->angle = 0.0f;
    return true;
}

void tilt_zero(struct tilt *tilt)
{
    tilt->rest_steps = 0;
}

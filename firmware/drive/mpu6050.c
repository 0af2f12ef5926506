/* SPDX-License-Identifier: Apache-2.0 */
#include "mpu6050.h"

#define FIRST_READING 0x3B
#define ALONG 0  /* of the answer: accelerometer X */
#define RATE 10  /* gyro Y */
#define GIVEN_UP 2
#define BRIDGED (GIVEN_UP + N_SETTINGS)
#define MIDDLE ((int16_t)(TILT_OVERSAMPLING * 512))
#define HIGHEST ((int16_t)(TILT_OVERSAMPLING * 1023))

/* 12.5 mV per deg/s at 5000 / 1024 mV a count, five times, are 12.8 a deg/s: 64 / 655 of 131, to 1e-4. A division that
 * is a shift: another would take 700 cycles. */
#define RATE_UP 6404
#define RATE_DOWN 65536L
/* 1 V per g at the same are 1024 a g: a sixteenth of 16,384. */
#define ALONG_DOWN 16

static const struct {
    uint8_t address, value;
} SETTINGS[] = {{0x6B, 1}, {0x1A, 2}, {0x19, 0}, {0x1B, 0}, {0x1C, 0}};

#define N_SETTINGS (sizeof SETTINGS / sizeof SETTINGS[0])

void mpu6050_init(struct mpu6050 *imu)
{
    const struct mpu6050 fresh = {.stale = UINT8_MAX, .sums = {.gyro = MIDDLE, .accelerometer = 0}};
    *imu = fresh;
}

struct mpu6050_request mpu6050_request(const struct mpu6050 *imu)
{
    const struct mpu6050_request reading = {{FIRST_READING}, 1, MPU6050_ANSWER};
    if (imu->settled >= N_SETTINGS)
        return reading;
    const struct mpu6050_request setting = {{SETTINGS[imu->settled].address, SETTINGS[imu->settled].value}, 2, 0};
    return setting;
}

static void go_without(struct mpu6050 *imu)
{
    if (imu->stale < UINT8_MAX)
        imu->stale++;
    if (imu->stale > BRIDGED)
        imu->sums.accelerometer = 0;
}

static void miss(struct mpu6050 *imu)
{
    go_without(imu);
    if (imu->stale >= GIVEN_UP)
        imu->settled = 0;
}

static uint16_t sum_of(int32_t deviation)
{
    const int32_t sum = MIDDLE + deviation;
    if (sum < 0)
        return 0;
    return (uint16_t)(sum > HIGHEST ? HIGHEST : sum);
}

static int16_t value_at(const uint8_t *bytes)
{
    return (int16_t)((uint16_t)bytes[0] << 8 | bytes[1]);
}

void mpu6050_answered(struct mpu6050 *imu, const uint8_t *answer)
{
    if (imu->settled < N_SETTINGS) {
        imu->settled++;
        go_without(imu);
        return;
    }
    const int16_t along = value_at(answer + ALONG), rate = value_at(answer + RATE);
    if (along == imu->along && rate == imu->rate) {
        miss(imu);
        return;
    }
    imu->along = along;
    imu->rate = rate;
    imu->stale = 0;
    imu->sums.gyro = sum_of((int32_t)rate * RATE_UP / RATE_DOWN);
    imu->sums.accelerometer = sum_of(-(int32_t)along / ALONG_DOWN); /* leaning forward, X points down */
}

void mpu6050_failed(struct mpu6050 *imu)
{
    miss(imu);
}

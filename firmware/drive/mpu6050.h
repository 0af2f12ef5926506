/* SPDX-License-Identifier: Apache-2.0
 *
 * An MPU-6050 in place of the analogue gyro and accelerometer: what to ask of it over its bus, and what its answers mean.
 * Pure; avr/imu_mpu6050.c has the bus. The part lies flat, its X axis forward and its Z axis up, so that a forward fall
 * turns it about +Y.
 *
 * | register            | value | meaning                                                                  |
 * | 0x6B power          | 1     | awake (it starts asleep), clock from the X gyro                          |
 * | 0x1A low-pass       | 2     | gyro 98 Hz, 2.8 ms late; accelerometer 94 Hz, 3.0 ms late; new every ms  |
 * | 0x19 divider        | 0     | none                                                                     |
 * | 0x1B, 0x1C ranges   | 0, 0  | 250 deg/s at 131 LSB per deg/s; 2 g at 16,384 LSB per g                  |
 * | 0x3B to 0x46        | read  | accelerometer X Y Z, temperature, gyro X Y; two bytes each, high first   |
 *
 * Its readings are told in the analogue parts' units, sums of TILT_OVERSAMPLING counts around their middle, so that one
 * filter with one scale serves both: 0.078 deg/s and 0.98 mg, finer than the part's own noise of 0.05 deg/s and 4 mg rms
 * asks for.
 *
 * A reading that failed, or that repeats the one before in every bit (a part that has lost its power answers, asleep), is
 * none. After two such steps the part is set up anew. For 35 ms, in which that is done, the last reading stands; from then
 * on the accelerometer is told to be at its rail, which the supervisor takes for a dead sensor, while the gyro keeps its
 * last rate: what stands goes on standing until the motors are off.
 */
#ifndef CRUNCH_DRIVE_MPU6050_H
#define CRUNCH_DRIVE_MPU6050_H

#include "tilt.h"

#define MPU6050_ADDRESS 0x68 /* AD0 low */
#define MPU6050_ANSWER 12    /* bytes of a reading */

struct mpu6050_request { /* one transfer: write so many bytes, then read so many */
    uint8_t bytes[2];
    uint8_t to_write, to_read;
};

struct mpu6050 {
    uint8_t settled;   /* registers that are set up */
    uint8_t stale;     /* steps since the last reading; stays at its maximum */
    int16_t along, rate; /* the last raw readings */
    struct inertial_sums sums;
};

void mpu6050_init(struct mpu6050 *imu);

/* The next transfer, one in each step. */
struct mpu6050_request mpu6050_request(const struct mpu6050 *imu);

/* How that transfer ended: MPU6050_ANSWER bytes of a reading, none of a setting. `sums` are then this step's. */
void mpu6050_answered(struct mpu6050 *imu, const uint8_t *answer);
void mpu6050_failed(struct mpu6050 *imu);

#endif

/* SPDX-License-Identifier: Apache-2.0
 *
 * The angular rate sensor and the accelerometer, whichever they are: `make IMU=...` takes avr/imu_analogue.c, the
 * ADXRS150 and ADXL203 on the converter, or avr/imu_mpu6050.c, an MPU-6050 on the bus.
 */
#ifndef CRUNCH_AVR_IMU_H
#define CRUNCH_AVR_IMU_H

#include "../drive/tilt.h"

#define IMU_GYRO 0          /* the converter's inputs of the analogue ones */
#define IMU_ACCELEROMETER 1

void imu_init(void);

/* Once per ms, called from the clock's interrupt together with the start of the converter's sweep. */
void imu_tick(void);

/* The sums of a step whose sweeps gave these. To be called for every step. */
struct inertial_sums imu_sums(const uint16_t *converted);

#endif

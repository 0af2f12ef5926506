/* SPDX-License-Identifier: Apache-2.0 */
#include "imu.h"

void imu_init(void)
{
}

void imu_tick(void)
{
}

struct inertial_sums imu_sums(const uint16_t *converted)
{
    const struct inertial_sums sums = {.gyro = converted[IMU_GYRO], .accelerometer = converted[IMU_ACCELEROMETER]};
    return sums;
}

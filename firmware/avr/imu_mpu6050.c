/* SPDX-License-Identifier: Apache-2.0
 *
 * One transfer in each step, begun with its last sweep: it is over after 0.5 ms, the sweep after 0.85 ms, so that the
 * reading is the freshest when the step begins, and nothing ever waits.
 */
#include "imu.h"

#include "../drive/mpu6050.h"
#include "twi.h"

static struct mpu6050 imu;
static struct mpu6050_request request; /* written by imu_sums only, 4 ms before the interrupt reads it */
static uint8_t ms;                     /* the interrupt's own: since the last transfer was begun */

void imu_init(void)
{
    mpu6050_init(&imu);
    request = mpu6050_request(&imu);
    twi_init();
}

void imu_tick(void)
{
    if (++ms < TILT_OVERSAMPLING)
        return;
    ms = 0;
    twi_begin(MPU6050_ADDRESS, request.bytes, request.to_write, request.to_read);
}

struct inertial_sums imu_sums(const uint16_t *converted)
{
    (void)converted;
    const uint8_t *answer = twi_end();
    if (answer)
        mpu6050_answered(&imu, answer);
    else
        mpu6050_failed(&imu);
    request = mpu6050_request(&imu);
    return imu.sums;
}

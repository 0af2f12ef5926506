/* SPDX-License-Identifier: Apache-2.0 */
#include "imu_part.h"

#include <math.h>
#include <string.h>

#define ADDRESS 0x68
#define POWER 0x6B
#define ASLEEP 0x40
#define LOW_PASS 0x1A
#define LOW_PASS_94_HZ 2
#define GYRO_RANGE 0x1B
#define ALONG_RANGE 0x1C
#define ALONG 0x3B /* accelerometer X */
#define RATE 0x45  /* gyro Y */
#define WHO_AM_I 0x75

#define GRAVITY 9.81
#define DEGREES 57.29577951308232
#define RATE_LSB 131.0
#define ALONG_LSB 16384.0
#define RATE_NOISE 0.05       /* deg/s rms behind the low-pass of 100 Hz */
#define ALONG_NOISE 0.0049    /* g rms: 0.4 mg per square root of a Hz, 94 Hz of first order */
#define PASSED 0.45           /* share of the news in 1 ms: 1 - exp(-2 pi 94 / 1000) */
#define LOUDER 1.856          /* noise before the low-pass, of noise behind it: the root of (2 - PASSED) / PASSED */
#define RATE_ZERO_SPREAD 7.0  /* deg/s: the datasheet's 20 are the most */
#define ALONG_ZERO_SPREAD 0.0025 /* as the analogue one's, trimmed */

void imu_part_init(struct imu_part *part, uint64_t seed)
{
    memset(part, 0, sizeof *part);
    noise_init(&part->noise, seed, 5);
    part->gyro_zero = fmax(-20.0, fmin(20.0, RATE_ZERO_SPREAD * noise_normal(&part->noise)));
    part->along_zero = ALONG_ZERO_SPREAD * noise_normal(&part->noise);
    imu_part_reset(part);
}

void imu_part_reset(struct imu_part *part)
{
    memset(part->registers, 0, sizeof part->registers);
    part->registers[POWER] = ASLEEP;
    part->registers[WHO_AM_I] = ADDRESS;
}

static void show(struct imu_part *part, int address, double value)
{
    const int16_t raw = (int16_t)lrint(fmax(-32768.0, fmin(32767.0, value)));
    part->registers[address] = (uint8_t)((uint16_t)raw >> 8);
    part->registers[address + 1] = (uint8_t)raw;
}

/* X forward, Z up: a forward fall turns about +Y, and leaning forward X points down. */
void imu_part_measure(struct imu_part *part, const struct body *body)
{
    const double along = -sin(body->tilt) + body->acceleration * cos(body->tilt) / GRAVITY + part->along_zero;
    const double rate = DEGREES * body->tilt_rate + part->gyro_zero;
    part->along += PASSED * (along + LOUDER * ALONG_NOISE * noise_normal(&part->noise) - part->along);
    part->rate += PASSED * (rate + LOUDER * RATE_NOISE * noise_normal(&part->noise) - part->rate);
    if (part->is_stuck || part->registers[POWER] & ASLEEP || part->registers[LOW_PASS] != LOW_PASS_94_HZ ||
        part->registers[GYRO_RANGE] || part->registers[ALONG_RANGE])
        return;
    show(part, ALONG, part->along * ALONG_LSB);
    show(part, RATE, part->rate * RATE_LSB);
}

bool imu_part_start(struct imu_part *part, uint8_t address)
{
    part->is_pointed = false;
    return address == ADDRESS && !part->is_dead;
}

void imu_part_take(struct imu_part *part, uint8_t byte)
{
    if (part->is_pointed)
        part->registers[part->pointer++ % IMU_PART_REGISTERS] = byte;
    else
        part->pointer = byte;
    part->is_pointed = true;
}

uint8_t imu_part_give(struct imu_part *part)
{
    return part->registers[part->pointer++ % IMU_PART_REGISTERS];
}

/* SPDX-License-Identifier: Apache-2.0
 *
 * An MPU-6050 on the two-wire bus, as its datasheet has it (PS-MPU-6000A-00 3.4, RM-MPU-6000A-00 4.2): registers that are
 * written and read with a pointer that moves on, asleep after power-on, readings that are new every ms and stand still
 * while they are read. Low-pass filters are of first order; only those ranges that are set by zeros are known.
 */
#ifndef CRUNCH_VIRTUAL_AVR_IMU_PART_H
#define CRUNCH_VIRTUAL_AVR_IMU_PART_H

#include "../body.h"

#define IMU_PART_REGISTERS 128

struct imu_part {
    uint8_t registers[IMU_PART_REGISTERS];
    uint8_t pointer;
    bool is_pointed;     /* the first byte written was the pointer */
    bool is_dead;        /* a torn wire: nobody answers */
    bool is_stuck;       /* a broken part: it answers, and measures no more */
    double along, rate;  /* behind the low-pass, g and deg/s */
    double gyro_zero;    /* deg/s, of this part */
    double along_zero;   /* g, as it is mounted and trimmed */
    struct noise noise;
};

void imu_part_init(struct imu_part *part, uint64_t seed);

/* Its supply dips: registers as after power-on. */
void imu_part_reset(struct imu_part *part);

/* Once per ms. */
void imu_part_measure(struct imu_part *part, const struct body *body);

/* On the bus: addressed (whether it answers), a byte written, a byte asked for. */
bool imu_part_start(struct imu_part *part, uint8_t address);
void imu_part_take(struct imu_part *part, uint8_t byte);
uint8_t imu_part_give(struct imu_part *part);

#endif

/* SPDX-License-Identifier: Apache-2.0
 *
 * Each of the drive board's and the motor board's pure files by itself, on random input of its own over all of its range, to compare two
 * machines bit by bit: what one file computes does not hide behind the limits of the next.
 */
#ifndef CRUNCH_TESTS_PARITY_MODULES_H
#define CRUNCH_TESTS_PARITY_MODULES_H

#include "../../../firmware/drive/loop.h"
#include "../../../firmware/motor/loop.h"

#define MODULES_MAX_STEP 200

struct modules {
    uint32_t random;
    struct tilt tilt;
    struct odometry odometry;
    struct agreement agreement;
    struct balance balance;
    struct supervisor supervisor;
    struct settings settings;
    uint16_t battery_mv, charger_mv, motor_ma; /* shown to it for a while */
    struct motor_supervisor motor_supervisor;
    struct ramp ramp;
    uint16_t motor_sum; /* of its battery, for a while */
};

void modules_init(struct modules *modules, uint32_t seed);

/* One step of every file; writes what each computed, one after the other, and returns how many bytes. */
uint8_t modules_step(struct modules *modules, uint8_t out[MODULES_MAX_STEP]);

#endif

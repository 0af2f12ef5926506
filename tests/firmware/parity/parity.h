/* SPDX-License-Identifier: Apache-2.0
 *
 * Random steps of the drive board's loop whose every float is told, to compare two machines bit by bit.
 */
#ifndef CRUNCH_TESTS_PARITY_H
#define CRUNCH_TESTS_PARITY_H

#include "../../../firmware/drive/loop.h"

#define PARITY_OUTBOX 128
#define PARITY_MAX_STEP (96 + PARITY_OUTBOX)

struct parity {
    struct drive_loop loop;
    struct drive_samples samples;
    struct outbox outbox;
    uint8_t bytes[PARITY_OUTBOX];
    uint32_t random;
};

void parity_init(struct parity *parity, uint32_t seed);

/* One step with random samples and wishes; writes the loop's floats and the frames it told, returns how many bytes. */
uint8_t parity_step(struct parity *parity, uint8_t out[PARITY_MAX_STEP]);

#endif

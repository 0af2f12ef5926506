/* SPDX-License-Identifier: Apache-2.0
 *
 * Random numbers of the simulator: one small stream per cause (slip, inertial noise, echoes, ...), so that a change to
 * one sensor does not move the others. SplitMix64 (Steele, Lea & Flood 2014).
 */
#ifndef CRUNCH_VIRTUAL_NOISE_H
#define CRUNCH_VIRTUAL_NOISE_H

#include <stdint.h>

struct noise {
    uint64_t state;
    double spare; /* second normal of a pair, */
    int has_spare; /* if there is one */
};

void noise_init(struct noise *noise, uint64_t seed, uint64_t stream);

/* Uniform in [0, 1). */
double noise_uniform(struct noise *noise);

/* Standard normal. */
double noise_normal(struct noise *noise);

#endif

/* SPDX-License-Identifier: Apache-2.0 */
#include "noise.h"

#include <math.h>

#define GOLDEN 0x9E3779B97F4A7C15ull
#define TWO_PI 6.283185307179586

static uint64_t mix(uint64_t bits)
{
    bits = (bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9ull;
    bits = (bits ^ (bits >> 27)) * 0x94D049BB133111EBull;
    return bits ^ (bits >> 31);
}

void noise_init(struct noise *noise, uint64_t seed, uint64_t stream)
{
    noise->state = mix(mix(seed + GOLDEN) + stream * GOLDEN);
    noise->spare = 0.0;
    noise->has_spare = 0;
}

double noise_uniform(struct noise *noise)
{
    noise->state += GOLDEN;
    return (double)(mix(noise->state) >> 11) * 0x1.0p-53;
}

double noise_normal(struct noise *noise)
{
    if (noise->has_spare) {
        noise->has_spare = 0;
        return noise->spare;
    }
    const double length = sqrt(-2.0 * log(1.0 - noise_uniform(noise)));
    const double angle = TWO_PI * noise_uniform(noise);
    noise->spare = length * sin(angle);
    noise->has_spare = 1;
    return length * cos(angle);
}

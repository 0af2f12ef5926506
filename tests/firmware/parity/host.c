/* SPDX-License-Identifier: Apache-2.0
 *
 * The host's side: many steps at once, each as its length and its bytes. */
#include "modules.h"
#include "parity.h"

uint32_t parity_run(uint32_t seed, uint32_t steps, uint8_t *out);
uint32_t modules_run(uint32_t seed, uint32_t steps, uint8_t *out);

uint32_t parity_run(uint32_t seed, uint32_t steps, uint8_t *out)
{
    struct parity parity;
    uint32_t size = 0;
    parity_init(&parity, seed);
    for (uint32_t i = 0; i < steps; i++) {
        out[size] = parity_step(&parity, out + size + 1);
        size += out[size] + 1u;
    }
    return size;
}

uint32_t modules_run(uint32_t seed, uint32_t steps, uint8_t *out)
{
    struct modules modules;
    uint32_t size = 0;
    modules_init(&modules, seed);
    for (uint32_t i = 0; i < steps; i++) {
        out[size] = modules_step(&modules, out + size + 1);
        size += out[size] + 1u;
    }
    return size;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "cobs.h"

uint8_t cobs_encode(uint8_t *out, const uint8_t *packet, uint8_t size)
{
    uint8_t code_at = 0; /* where the distance to the next zero will be written */
    uint8_t at = 1;
    for (uint8_t i = 0; i < size; i++) {
        if (packet[i] == 0) {
            out[code_at] = (uint8_t)(at - code_at);
            code_at = at++;
        } else {
            out[at++] = packet[i];
        }
    }
    out[code_at] = (uint8_t)(at - code_at);
    return at;
}

bool cobs_decode(uint8_t *out, uint8_t *written, const uint8_t *stuffed, uint8_t size)
{
    uint8_t from = 0, to = 0;
    while (from < size) {
        const uint8_t code = stuffed[from++];
        if (code == 0 || code - 1 > size - from)
            return false;
        for (uint8_t i = 1; i < code; i++) {
            if (stuffed[from] == 0)
                return false;
            out[to++] = stuffed[from++];
        }
        if (code < 0xFF && from < size) /* the last group has no zero of its own */
            out[to++] = 0;
    }
    *written = to;
    return true;
}

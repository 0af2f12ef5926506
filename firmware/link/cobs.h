/* SPDX-License-Identifier: Apache-2.0
 *
 * Consistent overhead byte stuffing (Cheshire and Baker, 1999) for packets of at most 253 bytes: removes every zero, so
 * that a zero can end a frame, at the price of exactly one byte. The delimiter itself is the caller's.
 */
#ifndef CRUNCH_LINK_COBS_H
#define CRUNCH_LINK_COBS_H

#include <stdbool.h>
#include <stdint.h>

#define COBS_MAX_PACKET 253

/* Writes size + 1 bytes without zeros to `out` and returns their number. The buffers must not overlap. */
uint8_t cobs_encode(uint8_t *out, const uint8_t *packet, uint8_t size);

/* Undoes cobs_encode; false if `stuffed` cannot have come from it. `out` holds at least size bytes and may be
 * `stuffed` itself; `*written` is set when the answer is true. */
bool cobs_decode(uint8_t *out, uint8_t *written, const uint8_t *stuffed, uint8_t size);

#endif

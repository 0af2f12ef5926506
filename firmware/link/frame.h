/* SPDX-License-Identifier: Apache-2.0
 *
 * Frames on the wire: header, payload and CRC-16 inside COBS, ended by a zero. The layout is told in channels.h.
 *
 * A frame is good or it does not exist. The decoder holds no length it was told by the line, so no corrupted byte can
 * make it wait: whatever happened before a zero is over after it.
 */
#ifndef CRUNCH_LINK_FRAME_H
#define CRUNCH_LINK_FRAME_H

#include "channels.h"

#include <stdbool.h>
#include <stdint.h>

#define FRAME_HEADER 4
#define FRAME_CHECK 2

struct frame {
    uint8_t source, channel, sequence, size; /* size of the payload */
    uint16_t time_ms;
    uint8_t payload[LINK_MAX_PAYLOAD];
};

struct frame_decoder {
    uint8_t pending[LINK_MAX_ENCODED - 1]; /* stuffed bytes since the last delimiter */
    uint8_t size;
    bool overflowed;   /* more came since the last delimiter than any frame has */
    uint16_t rejected; /* pieces between delimiters that were no frame; stays at its maximum */
};

/* Writes one frame with its delimiter to `out` (LINK_MAX_ENCODED bytes are always enough) and returns its length; 0 if
 * the payload is too long, or source or channel do not fit their bits. */
uint8_t frame_encode(uint8_t *out, uint8_t source, uint8_t channel, uint8_t sequence, uint16_t time_ms,
                     const void *payload, uint8_t size);

void frame_decoder_init(struct frame_decoder *decoder);

/* Takes one byte from the line; true when it completed a good frame, which is then in `*out`. Otherwise `*out` is left
 * as it was. Costs a few instructions per byte, except for the delimiter's. */
bool frame_decoder_feed(struct frame_decoder *decoder, uint8_t byte, struct frame *out);

#endif

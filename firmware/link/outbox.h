/* SPDX-License-Identifier: Apache-2.0
 *
 * Frames that wait for the line, whole or not at all: one that finds no room is dropped and counted, never cut or kept
 * for later. The bytes are the caller's; frames lie one after the other, each ended by its delimiter.
 */
#ifndef CRUNCH_LINK_OUTBOX_H
#define CRUNCH_LINK_OUTBOX_H

#include "frame.h"

struct outbox {
    uint8_t *bytes;
    uint16_t size, capacity;
    uint16_t dropped; /* frames that found no room; stays at its maximum */
};

void outbox_init(struct outbox *outbox, uint8_t *bytes, uint16_t capacity);

/* Encodes one frame; false if it was dropped. */
bool outbox_put(struct outbox *outbox, const struct frame *frame);

/* Moves the oldest frame, delimiter included, to `out` (LINK_MAX_ENCODED bytes) and returns its length; 0 if none. */
uint8_t outbox_take(struct outbox *outbox, uint8_t *out);

#endif

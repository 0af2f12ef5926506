/* SPDX-License-Identifier: Apache-2.0
 *
 * What makes a frame from the host a command: beside the frame's CRC-16 a CRC-32 at the payload's end, so that noise
 * cannot forge it, and the board's own last time as an echo, so that one that was long under way is not obeyed.
 */
#ifndef CRUNCH_LINK_SEAL_H
#define CRUNCH_LINK_SEAL_H

#include "frame.h"

#define SEAL_MAX_AGE_MS 1000

uint16_t seal_get16(const uint8_t *bytes);
uint32_t seal_get32(const uint8_t *bytes);

/* Whether the payload has this size and its last four bytes are the CRC-32 of those before. */
bool seal_is_intact(const struct frame *frame, uint8_t size);

/* An echo from the future wraps to a great age; one from before the board's start is older than its uptime. */
bool seal_is_fresh(uint16_t echo_ms, uint32_t uptime_ms);

#endif

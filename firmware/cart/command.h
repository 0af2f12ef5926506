/* SPDX-License-Identifier: Apache-2.0
 *
 * Which frames from the host the cart obeys: runs, stops and questions for its log that carry their seal (link/seal.h).
 */
#ifndef CRUNCH_CART_COMMAND_H
#define CRUNCH_CART_COMMAND_H

#include "../link/frame.h"
#include "program.h"

enum cart_command_kind { CART_REFUSED = 0, CART_RUN, CART_STOP, CART_UPLOAD };

struct cart_command {
    enum cart_command_kind kind;
    struct cart_orders orders; /* of CART_RUN, */
    uint8_t leash_s;
    uint16_t first, count;     /* of CART_UPLOAD */
    uint8_t sequence;
};

/* Judges one good frame at the board's uptime; anything wrong makes it CART_REFUSED. */
struct cart_command cart_command_of_frame(const struct frame *frame, uint32_t uptime_ms);

#endif

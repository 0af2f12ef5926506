/* SPDX-License-Identifier: Apache-2.0
 *
 * Which frames from the host may move the robot: those that carry their seal (link/seal.h).
 */
#ifndef CRUNCH_DRIVE_COMMAND_H
#define CRUNCH_DRIVE_COMMAND_H

#include "../link/frame.h"
#include "balance.h"

enum command_kind { COMMAND_REFUSED = 0, COMMAND_DRIVE, COMMAND_STOP, COMMAND_ARM, COMMAND_DISARM };

struct command {
    enum command_kind kind;
    struct drive_wish wish; /* of COMMAND_DRIVE */
    uint8_t sequence;
};

/* Judges one good frame at the board's uptime; anything wrong makes it COMMAND_REFUSED. */
struct command command_of_frame(const struct frame *frame, uint32_t uptime_ms);

#endif

/* SPDX-License-Identifier: Apache-2.0
 *
 * Which frames from the host may move the robot. Beside the frame's CRC-16 a command carries a CRC-32, so that noise
 * cannot forge it, and the board's own last time as an echo, so that one that was long under way is not obeyed.
 */
#ifndef CRUNCH_DRIVE_COMMAND_H
#define CRUNCH_DRIVE_COMMAND_H

#include "../link/frame.h"
#include "balance.h"

#define COMMAND_MAX_AGE_MS 1000

enum command_kind { COMMAND_REFUSED = 0, COMMAND_DRIVE, COMMAND_STOP, COMMAND_ARM, COMMAND_DISARM };

struct command {
    enum command_kind kind;
    struct drive_wish wish; /* of COMMAND_DRIVE */
    uint8_t sequence;
};

/* Judges one good frame at board time `now_ms`; anything wrong makes it COMMAND_REFUSED. */
struct command command_of_frame(const struct frame *frame, uint16_t now_ms);

#endif

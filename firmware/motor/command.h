/* SPDX-License-Identifier: Apache-2.0
 *
 * Which frames from the host the motor board obeys: powers and stops that carry their seal (link/seal.h).
 */
#ifndef CRUNCH_MOTOR_COMMAND_H
#define CRUNCH_MOTOR_COMMAND_H

#include "../link/frame.h"

#define MOTORS 2 /* left and right */

enum motor_command_kind { MOTOR_REFUSED = 0, MOTOR_POWERS, MOTOR_STOP };

struct motor_command {
    enum motor_command_kind kind;
    int16_t powers[MOTORS]; /* of MOTOR_POWERS, -MOTOR_FULL_POWER to MOTOR_FULL_POWER, */
    uint16_t deadline_ms;   /* 1 to MOTOR_LONGEST_MS */
    uint8_t sequence;
};

/* Judges one good frame at the board's uptime; anything wrong makes it MOTOR_REFUSED. */
struct motor_command motor_command_of_frame(const struct frame *frame, uint32_t uptime_ms);

#endif

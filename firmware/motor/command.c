/* SPDX-License-Identifier: Apache-2.0 */
#include "command.h"

#include "../link/seal.h"

#include <stddef.h>

static bool is_power(int16_t power)
{
    return power >= -MOTOR_FULL_POWER && power <= MOTOR_FULL_POWER;
}

static enum motor_command_kind judge_powers(const struct frame *frame, uint32_t uptime_ms,
                                            struct motor_command *command)
{
    const uint8_t *payload = frame->payload;
    if (!seal_is_intact(frame, sizeof(struct powers_payload)))
        return MOTOR_REFUSED;
    if (!seal_is_fresh(seal_get16(payload + offsetof(struct powers_payload, echo_ms)), uptime_ms))
        return MOTOR_REFUSED;
    const uint16_t deadline_ms = seal_get16(payload + offsetof(struct powers_payload, deadline_ms));
    command->powers[0] = (int16_t)seal_get16(payload + offsetof(struct powers_payload, left));
    command->powers[1] = (int16_t)seal_get16(payload + offsetof(struct powers_payload, right));
    command->deadline_ms = deadline_ms < MOTOR_LONGEST_MS ? deadline_ms : MOTOR_LONGEST_MS;
    if (deadline_ms == 0 || !is_power(command->powers[0]) || !is_power(command->powers[1]))
        return MOTOR_REFUSED;
    return MOTOR_POWERS;
}

struct motor_command motor_command_of_frame(const struct frame *frame, uint32_t uptime_ms)
{
    struct motor_command command = {.kind = MOTOR_REFUSED, .sequence = frame->sequence};
    if (frame->source != SOURCE_HOST)
        return command;
    if (frame->channel == CHANNEL_POWERS)
        command.kind = judge_powers(frame, uptime_ms, &command);
    else if (frame->channel == CHANNEL_STOP && seal_is_intact(frame, sizeof(struct stop_payload)))
        command.kind = MOTOR_STOP; /* never too old */
    return command;
}

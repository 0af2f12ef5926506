/* SPDX-License-Identifier: Apache-2.0 */
#include "command.h"

#include "../link/seal.h"

#include <stddef.h>

static enum command_kind judge_drive(const struct frame *frame, uint32_t uptime_ms, struct drive_wish *wish)
{
    const uint8_t *payload = frame->payload;
    if (!seal_is_intact(frame, sizeof(struct drive_payload)))
        return COMMAND_REFUSED;
    if (!seal_is_fresh(seal_get16(payload + offsetof(struct drive_payload, echo_ms)), uptime_ms))
        return COMMAND_REFUSED;
    wish->speed = (float)(int16_t)seal_get16(payload + offsetof(struct drive_payload, speed)) / 1000.0f;
    wish->turn = (float)(int16_t)seal_get16(payload + offsetof(struct drive_payload, turn)) / 1000.0f;
    return COMMAND_DRIVE;
}

static enum command_kind judge_arm(const struct frame *frame, uint32_t uptime_ms)
{
    const uint8_t *payload = frame->payload;
    if (!seal_is_intact(frame, sizeof(struct arm_payload)))
        return COMMAND_REFUSED;
    const uint16_t arm = seal_get16(payload + offsetof(struct arm_payload, arm));
    if (arm == 0)
        return COMMAND_DISARM; /* like a stop, never too old */
    if (arm != 1 || !seal_is_fresh(seal_get16(payload + offsetof(struct arm_payload, echo_ms)), uptime_ms))
        return COMMAND_REFUSED;
    return COMMAND_ARM;
}

struct command command_of_frame(const struct frame *frame, uint32_t uptime_ms)
{
    struct command command = {.kind = COMMAND_REFUSED, .wish = {0.0f, 0.0f}, .sequence = frame->sequence};
    if (frame->source != SOURCE_HOST)
        return command;
    if (frame->channel == CHANNEL_DRIVE)
        command.kind = judge_drive(frame, uptime_ms, &command.wish);
    else if (frame->channel == CHANNEL_STOP && seal_is_intact(frame, sizeof(struct stop_payload)))
        command.kind = COMMAND_STOP;
    else if (frame->channel == CHANNEL_ARM)
        command.kind = judge_arm(frame, uptime_ms);
    return command;
}

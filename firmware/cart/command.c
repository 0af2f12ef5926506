/* SPDX-License-Identifier: Apache-2.0 */
#include "command.h"

#include "../link/seal.h"

#include <stddef.h>

static enum cart_command_kind judge_run(const struct frame *frame, uint32_t uptime_ms, struct cart_command *command)
{
    const uint8_t *payload = frame->payload;
    if (!seal_is_intact(frame, sizeof(struct run_payload)))
        return CART_REFUSED;
    if (!seal_is_fresh(seal_get16(payload + offsetof(struct run_payload, echo_ms)), uptime_ms))
        return CART_REFUSED;
    const uint8_t manner = payload[offsetof(struct run_payload, manner)];
    if (manner & ~(RUN_MATCHED | RUN_COARSE))
        return CART_REFUSED;
    command->orders.bumps = seal_get16(payload + offsetof(struct run_payload, bumps));
    command->orders.seed = seal_get16(payload + offsetof(struct run_payload, seed));
    command->orders.is_matched = manner & RUN_MATCHED;
    command->orders.is_coarse = manner & RUN_COARSE;
    command->leash_s = payload[offsetof(struct run_payload, leash_s)];
    return CART_RUN;
}

static enum cart_command_kind judge_upload(const struct frame *frame, uint32_t uptime_ms,
                                           struct cart_command *command)
{
    const uint8_t *payload = frame->payload;
    if (!seal_is_intact(frame, sizeof(struct upload_payload)))
        return CART_REFUSED;
    if (!seal_is_fresh(seal_get16(payload + offsetof(struct upload_payload, echo_ms)), uptime_ms))
        return CART_REFUSED;
    command->first = seal_get16(payload + offsetof(struct upload_payload, first));
    command->count = seal_get16(payload + offsetof(struct upload_payload, count));
    return CART_UPLOAD;
}

struct cart_command cart_command_of_frame(const struct frame *frame, uint32_t uptime_ms)
{
    struct cart_command command = {.kind = CART_REFUSED, .sequence = frame->sequence};
    if (frame->source != SOURCE_HOST)
        return command;
    if (frame->channel == CHANNEL_RUN)
        command.kind = judge_run(frame, uptime_ms, &command);
    else if (frame->channel == CHANNEL_UPLOAD)
        command.kind = judge_upload(frame, uptime_ms, &command);
    else if (frame->channel == CHANNEL_STOP && seal_is_intact(frame, sizeof(struct stop_payload)))
        command.kind = CART_STOP; /* never too old */
    return command;
}

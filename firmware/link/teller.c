/* SPDX-License-Identifier: Apache-2.0 */
#include "teller.h"

#include <string.h>

void teller_init(struct teller *teller, uint8_t source, const struct boot *boot, struct outbox *outbox)
{
    const struct teller fresh = {
        .source = source, .boot = *boot, .worst_loop_us = boot->worst_loop_us, .outbox = outbox,
    };
    *teller = fresh;
}

void teller_tell(struct teller *teller, uint8_t channel, uint32_t time_ms, const void *payload, uint8_t size)
{
    struct frame frame = {
        .source = teller->source, .channel = channel, .sequence = teller->sequence, .size = size,
        .time_ms = (uint16_t)time_ms,
    };
    memcpy(frame.payload, payload, size);
    if (outbox_put(teller->outbox, &frame))
        teller->sequence++;
}

void teller_tell_status(struct teller *teller, uint8_t state, uint8_t reason, uint16_t rejected, uint16_t refused)
{
    const struct status_payload payload = {
        .version = LINK_PROTOCOL_VERSION,
        .state = state,
        .reason = reason,
        .reset_cause = teller->boot.reset_cause,
        .uptime_ms = teller->uptime_ms,
        .boot_count = teller->boot.count,
        .worst_loop_us = teller->worst_loop_us,
        .rx_errors = refused > UINT16_MAX - rejected ? UINT16_MAX : (uint16_t)(rejected + refused),
        .build = teller->boot.build,
    };
    teller_tell(teller, CHANNEL_STATUS, teller->uptime_ms, &payload, sizeof payload);
}

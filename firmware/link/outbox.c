/* SPDX-License-Identifier: Apache-2.0 */
#include "outbox.h"

#include <string.h>

void outbox_init(struct outbox *outbox, uint8_t *bytes, uint16_t capacity)
{
    const struct outbox empty = {.bytes = bytes, .capacity = capacity};
    *outbox = empty;
}

bool outbox_put(struct outbox *outbox, const struct frame *frame)
{
    if (outbox->capacity - outbox->size < LINK_MAX_ENCODED) {
        if (outbox->dropped < UINT16_MAX)
            outbox->dropped++;
        return false;
    }
    const uint8_t size = frame_encode(outbox->bytes + outbox->size, frame->source, frame->channel, frame->sequence,
                                      frame->time_ms, frame->payload, frame->size);
    outbox->size = (uint16_t)(outbox->size + size);
    return true;
}

uint8_t outbox_take(struct outbox *outbox, uint8_t *out)
{
    uint8_t size = 0;
    while (size < outbox->size && size < LINK_MAX_ENCODED) {
        out[size] = outbox->bytes[size];
        if (out[size++] == 0) /* the delimiter: no other byte of a frame is zero */
            break;
    }
    outbox->size = (uint16_t)(outbox->size - size);
    memmove(outbox->bytes, outbox->bytes + size, outbox->size);
    return size;
}

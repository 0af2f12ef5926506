/* SPDX-License-Identifier: Apache-2.0 */
#include "frame.h"

#include "cobs.h"
#include "crc.h"

#include <string.h>

#define DELIMITER 0
#define SOURCE_SHIFT 6
#define CHANNEL_MASK 0x3F

_Static_assert(LINK_MAX_FRAME <= COBS_MAX_PACKET, "a frame must cost one byte of stuffing, no more");
_Static_assert(LINK_MAX_FRAME == FRAME_HEADER + LINK_MAX_PAYLOAD + FRAME_CHECK, "channels.h tells the same layout");

static uint16_t crc16_of(const uint8_t *bytes, uint8_t size)
{
    uint16_t crc = CRC16_INITIAL;
    for (uint8_t i = 0; i < size; i++)
        crc = crc16_update(crc, bytes[i]);
    return crc;
}

uint8_t frame_encode(uint8_t *out, uint8_t source, uint8_t channel, uint8_t sequence, uint16_t time_ms,
                     const void *payload, uint8_t size)
{
    if (size > LINK_MAX_PAYLOAD || source > 3 || channel > CHANNEL_MASK)
        return 0;
    uint8_t packet[LINK_MAX_FRAME];
    packet[0] = (uint8_t)((uint8_t)(source << SOURCE_SHIFT) | channel);
    packet[1] = sequence;
    packet[2] = (uint8_t)time_ms;
    packet[3] = (uint8_t)(time_ms >> 8);
    if (size > 0)
        memcpy(packet + FRAME_HEADER, payload, size);
    const uint8_t body = (uint8_t)(FRAME_HEADER + size);
    const uint16_t crc = crc16_of(packet, body);
    packet[body] = (uint8_t)crc;
    packet[body + 1] = (uint8_t)(crc >> 8);
    const uint8_t stuffed = cobs_encode(out, packet, (uint8_t)(body + FRAME_CHECK));
    out[stuffed] = DELIMITER;
    return (uint8_t)(stuffed + 1);
}

void frame_decoder_init(struct frame_decoder *decoder)
{
    memset(decoder, 0, sizeof *decoder);
}

/* Unstuffs, checks and takes apart `size` bytes in place. */
static bool frame_parse(uint8_t *bytes, uint8_t size, struct frame *out)
{
    uint8_t length;
    if (!cobs_decode(bytes, &length, bytes, size) || length < FRAME_HEADER + FRAME_CHECK)
        return false;
    const uint8_t body = (uint8_t)(length - FRAME_CHECK);
    if (crc16_of(bytes, body) != (uint16_t)(bytes[body] | (uint16_t)((uint16_t)bytes[body + 1] << 8)))
        return false;
    out->source = bytes[0] >> SOURCE_SHIFT;
    out->channel = bytes[0] & CHANNEL_MASK;
    out->sequence = bytes[1];
    out->time_ms = (uint16_t)(bytes[2] | (uint16_t)((uint16_t)bytes[3] << 8));
    out->size = (uint8_t)(body - FRAME_HEADER);
    memcpy(out->payload, bytes + FRAME_HEADER, out->size);
    return true;
}

bool frame_decoder_feed(struct frame_decoder *decoder, uint8_t byte, struct frame *out)
{
    if (byte != DELIMITER) {
        if (decoder->size < sizeof decoder->pending)
            decoder->pending[decoder->size++] = byte;
        else
            decoder->overflowed = true;
        return false;
    }
    const uint8_t size = decoder->size;
    const bool is_good = size > 0 && !decoder->overflowed && frame_parse(decoder->pending, size, out);
    if (!is_good && size > 0 && decoder->rejected < UINT16_MAX)
        decoder->rejected++;
    decoder->size = 0;
    decoder->overflowed = false;
    return is_good;
}

/* SPDX-License-Identifier: Apache-2.0
 *
 * How the fuzzer changes an input: as it likes, and then, most times, one frame's checksums are made right: chance would
 * never find them.
 */
#include "../link/cobs.h"
#include "../link/crc.h"
#include "../link/frame.h"

#include <stddef.h>
#include <string.h>

#define LEAST (1 + FRAME_HEADER + FRAME_CHECK)
#define UNMENDED 4      /* one input in so many is left as it is, */
#define CRC16_ALONE 3   /* and in one in so many of the others the CRC-32 is */

size_t LLVMFuzzerMutate(uint8_t *bytes, size_t size, size_t max_size);
size_t LLVMFuzzerCustomMutator(uint8_t *bytes, size_t size, size_t max_size, unsigned seed);

static void put(uint8_t *bytes, uint32_t value, int count)
{
    for (int i = 0; i < count; i++)
        bytes[i] = (uint8_t)(value >> 8 * i);
}

/* A piece keeps its length: stuffing adds one byte to whatever it is. */
static void mend(uint8_t *piece, uint8_t size, bool is_command)
{
    uint8_t packet[COBS_MAX_PACKET], length;
    if (!cobs_decode(packet, &length, piece, size)) {
        length = (uint8_t)(size - 1);
        memcpy(packet, piece + 1, length);
    }
    const uint8_t body = (uint8_t)(length - FRAME_CHECK);
    if (is_command && body >= FRAME_HEADER + 4) /* it ends in the CRC-32 of its payload */
        put(packet + body - 4, crc32_of(packet + FRAME_HEADER, (uint8_t)(body - FRAME_HEADER - 4)), 4);
    uint16_t crc = CRC16_INITIAL;
    for (uint8_t i = 0; i < body; i++)
        crc = crc16_update(crc, packet[i]);
    put(packet + body, crc, 2);
    cobs_encode(piece, packet, length);
}

size_t LLVMFuzzerCustomMutator(uint8_t *bytes, size_t size, size_t max_size, unsigned seed)
{
    size = LLVMFuzzerMutate(bytes, size, max_size);
    if (size == 0 || seed % UNMENDED == 0)
        return size;
    const size_t within = seed / (UNMENDED * CRC16_ALONE) % size;
    size_t first = within, end = within;
    while (first > 0 && bytes[first - 1] != 0)
        first--;
    while (end < size && bytes[end] != 0)
        end++;
    if (end - first >= LEAST && end - first <= COBS_MAX_PACKET)
        mend(bytes + first, (uint8_t)(end - first), seed / UNMENDED % CRC16_ALONE != 0);
    return size;
}

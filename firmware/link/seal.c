/* SPDX-License-Identifier: Apache-2.0 */
#include "seal.h"

#include "crc.h"

uint16_t seal_get16(const uint8_t *bytes)
{
    return (uint16_t)(bytes[0] | (uint16_t)((uint16_t)bytes[1] << 8));
}

uint32_t seal_get32(const uint8_t *bytes)
{
    return (uint32_t)seal_get16(bytes) | (uint32_t)seal_get16(bytes + 2) << 16;
}

bool seal_is_intact(const struct frame *frame, uint8_t size)
{
    const uint8_t covered = (uint8_t)(size - sizeof(uint32_t));
    return frame->size == size && crc32_of(frame->payload, covered) == seal_get32(frame->payload + covered);
}

bool seal_is_fresh(uint16_t echo_ms, uint32_t uptime_ms)
{
    const uint16_t age_ms = (uint16_t)((uint16_t)uptime_ms - echo_ms);
    return age_ms <= SEAL_MAX_AGE_MS && age_ms <= uptime_ms;
}

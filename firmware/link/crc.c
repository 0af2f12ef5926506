/* SPDX-License-Identifier: Apache-2.0 */
#include "crc.h"

#define CRC32_REFLECTED_POLYNOMIAL 0xEDB88320UL

uint16_t crc16_update(uint16_t crc, uint8_t byte)
{
    /* The eight steps of the shift register folded into one: every bit of `mixed` is worth x^16 + x^12 + x^5 + 1. */
    uint8_t mixed = (uint8_t)(byte ^ (uint8_t)crc);
    mixed = (uint8_t)(mixed ^ (uint8_t)(mixed << 4));
    const uint16_t wide = mixed;
    return (uint16_t)(((uint16_t)(wide << 8) | (uint16_t)(crc >> 8)) ^ (uint16_t)(wide >> 4) ^ (uint16_t)(wide << 3));
}

uint32_t crc32_update(uint32_t crc, uint8_t byte)
{
    crc ^= byte;
    for (uint8_t bit = 0; bit < 8; bit++)
        crc = (crc & 1U) ? (crc >> 1) ^ CRC32_REFLECTED_POLYNOMIAL : crc >> 1;
    return crc;
}

uint32_t crc32_of(const uint8_t *bytes, uint8_t size)
{
    uint32_t crc = CRC32_INITIAL;
    for (uint8_t i = 0; i < size; i++)
        crc = crc32_update(crc, bytes[i]);
    return ~crc;
}

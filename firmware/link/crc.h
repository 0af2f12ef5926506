/* SPDX-License-Identifier: Apache-2.0
 *
 * The two checksums of the link. Both are computed bit by bit or by shifts, without tables: flash is scarcer than time.
 */
#ifndef CRUNCH_LINK_CRC_H
#define CRUNCH_LINK_CRC_H

#include <stdint.h>

#define CRC16_INITIAL 0xFFFF
#define CRC32_INITIAL 0xFFFFFFFFUL

/* CRC-16/MCRF4XX over one more byte; start from CRC16_INITIAL. Equal to avr-libc's _crc_ccitt_update. */
uint16_t crc16_update(uint16_t crc, uint8_t byte);

/* CRC-32 over one more byte; start from CRC32_INITIAL and invert the last one. */
uint32_t crc32_update(uint32_t crc, uint8_t byte);

/* CRC-32 as in zlib and Ethernet, over `size` bytes. Guards commands, which are few and short. */
uint32_t crc32_of(const uint8_t *bytes, uint8_t size);

#endif

/* SPDX-License-Identifier: Apache-2.0
 *
 * The line to the modem: USART at 38400 baud, 8N1, RXD on PD0, TXD on PD1. Interrupts move the bytes; one frame at a
 * time is sent, whole. UCSRC stays as reset leaves it, which is 8N1.
 */
#ifndef CRUNCH_AVR_UART_H
#define CRUNCH_AVR_UART_H

#include <stdbool.h>
#include <stdint.h>

void uart_init(void);

/* The next byte received; false if there is none. */
bool uart_receive(uint8_t *byte);

/* True until the last frame's stop bit has left. */
bool uart_is_sending(void);

/* Starts to send a copy of a frame (at most LINK_MAX_ENCODED bytes). Not to be called while one is being sent. */
void uart_send(const uint8_t *frame, uint8_t size);

#endif

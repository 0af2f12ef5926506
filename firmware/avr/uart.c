/* SPDX-License-Identifier: Apache-2.0 */
#include "uart.h"

#include "../link/channels.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#define UBRR_38400 25 /* 16 MHz; 0.16 % fast */
#define RECEIVED 64   /* a power of two; more than three steps' worth */

static volatile uint8_t received[RECEIVED];
static volatile uint8_t received_head; /* written by the interrupt only */
static volatile uint8_t received_tail; /* written by uart_receive only */

static volatile uint8_t sent[LINK_MAX_ENCODED];
static volatile uint8_t sent_size; /* written by uart_send only */
static volatile uint8_t sent_next; /* written by the interrupt while sending, by uart_send before */
static volatile bool is_sending;   /* set by uart_send, cleared by the interrupt */

ISR(USART_RXC_vect)
{
    const uint8_t byte = UDR;
    const uint8_t next = (uint8_t)(received_head + 1) % RECEIVED;
    if (next == received_tail)
        return; /* the frame's checksum will show the gap */
    received[received_head] = byte;
    received_head = next;
}

ISR(USART_UDRE_vect)
{
    UCSRA = _BV(TXC); /* of a byte before: TXC is to tell of this one */
    UDR = sent[sent_next++];
    if (sent_next == sent_size)
        UCSRB &= (uint8_t)~_BV(UDRIE);
}

ISR(USART_TXC_vect)
{
    if (sent_next == sent_size) /* and not a late byte in the middle */
        is_sending = false;
}

void uart_init(void)
{
    UBRRH = 0;
    UBRRL = UBRR_38400;
    UCSRB = _BV(RXEN) | _BV(TXEN) | _BV(RXCIE) | _BV(TXCIE);
}

bool uart_receive(uint8_t *byte)
{
    const uint8_t tail = received_tail;
    if (tail == received_head)
        return false;
    *byte = received[tail];
    received_tail = (uint8_t)(tail + 1) % RECEIVED;
    return true;
}

bool uart_is_sending(void)
{
    return is_sending;
}

void uart_send(const uint8_t *frame, uint8_t size)
{
    if (size == 0 || size > LINK_MAX_ENCODED)
        return;
    for (uint8_t i = 0; i < size; i++) /* no interrupt looks at it now */
        sent[i] = frame[i];
    sent_size = size;
    sent_next = 0;
    is_sending = true;
    UCSRB |= _BV(UDRIE);
}

/* SPDX-License-Identifier: Apache-2.0
 *
 * The cart's program: each ms step, drive, tell, and send what waits; then sleep. The watchdog is petted by each
 * sum of the battery's readings: it takes the clock and the converter to have one.
 */
#include "board.h"

#define OUTBOX_BYTES 128 /* more than is told in 100 ms */

static struct cart_loop loop;
static struct outbox outbox;
static uint8_t outbox_bytes[OUTBOX_BYTES];

static void take_commands(void)
{
    uint8_t byte;
    while (board_receive(&byte))
        cart_loop_receive(&loop, byte);
}

static void take_battery(void)
{
    uint16_t sum;
    if (!board_battery(&sum))
        return;
    cart_loop_battery(&loop, sum);
    board_pet(loop.teller.worst_loop_us);
}

static void work_one_ms(void)
{
    struct cart_sensed sensed;
    loop.teller.uptime_ms++;
    board_sense(&sensed);
    cart_loop_tick(&loop, &sensed);
    board_drive(loop.ramps[0].power, loop.ramps[1].power);
}

static void send_what_waits(void)
{
    uint8_t frame[LINK_MAX_ENCODED];
    if (board_is_sending())
        return;
    const uint8_t size = outbox_take(&outbox, frame);
    if (size > 0)
        board_send(frame, size);
}

static void note_time(uint16_t start_us)
{
    const uint16_t loop_us = (uint16_t)(board_us() - start_us);
    if (loop_us > loop.teller.worst_loop_us)
        loop.teller.worst_loop_us = loop_us;
}

int main(void)
{
    const struct boot boot = board_init();
    outbox_init(&outbox, outbox_bytes, OUTBOX_BYTES);
    cart_loop_init(&loop, &boot, &outbox);
    for (;;) {
        take_commands();
        take_battery();
        while (loop.teller.uptime_ms != board_ms()) { /* each ms counts: none is left out if one comes late */
            const uint16_t start_us = board_us();
            work_one_ms();
            send_what_waits();
            note_time(start_us);
        }
        board_sleep();
    }
}

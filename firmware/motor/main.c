/* SPDX-License-Identifier: Apache-2.0
 *
 * The motor board's program: each ms step, drive, tell, and send what waits; then sleep. The watchdog is petted by each
 * sum of the battery's readings: it takes the clock and the converter to have one.
 */
#include "board.h"

#define OUTBOX_BYTES 128 /* more than is told in 100 ms */

static struct motor_loop loop;
static struct outbox outbox;
static uint8_t outbox_bytes[OUTBOX_BYTES];

static void take_commands(void)
{
    uint8_t byte;
    while (board_receive(&byte))
        motor_loop_receive(&loop, byte);
}

static void take_battery(void)
{
    uint16_t sum;
    if (!board_battery(&sum))
        return;
    motor_loop_battery(&loop, sum);
    board_pet(loop.teller.worst_loop_us);
}

static void work_one_ms(void)
{
    loop.teller.uptime_ms++;
    motor_loop_tick(&loop);
    board_drive(loop.ramps[0].power, loop.ramps[1].power);
}

int main(void)
{
    const struct boot boot = board_init();
    outbox_init(&outbox, outbox_bytes, OUTBOX_BYTES);
    motor_loop_init(&loop, &boot, &outbox);
    for (;;) {
        take_commands();
        take_battery();
        while (loop.teller.uptime_ms != board_ms()) { /* each ms counts: none is left out if one comes late */
            const uint16_t start_us = board_us();
            work_one_ms();
            board_send_next(&outbox);
            board_note_loop(&loop.teller, start_us);
        }
        board_sleep();
    }
}

/* SPDX-License-Identifier: Apache-2.0
 *
 * The drive board's program: wait for samples, step, drive, tell, pet the watchdog, sleep. A step needs five sweeps of
 * the converter and each of these a tick of the clock: if either stands still, so does the watchdog's petting.
 */
#include "board.h"

#include "../link/turns.h"

#define OUTBOX_BYTES 128 /* four of the longest frames */

static struct drive_loop loop;
static struct outbox outbox;
static uint8_t outbox_bytes[OUTBOX_BYTES];
static struct turns turns;

static void take_commands(void)
{
    uint8_t byte;
    while (board_receive(&byte))
        drive_loop_receive(&loop, byte);
}

static void load_settings(void)
{
    uint8_t record[SETTINGS_RECORD_SIZE(DRIVE_SETTINGS)];
    board_load(record, sizeof record);
    drive_loop_load(&loop, record);
}

static void step(void)
{
    struct drive_samples samples;
    if (!board_sample(&samples))
        return;
    const uint16_t start_us = board_us();
    drive_loop_step(&loop, &samples);
    if (supervisor_is_balancing(&loop.supervisor))
        board_drive(&loop.duties);
    else
        board_motors_off();
    drive_loop_tell(&loop, &samples);
    board_keep(&loop.adjuster, &loop.teller);
    board_note_loop(&loop.teller, start_us);
    board_pet(loop.teller.worst_loop_us, &loop.ending);
}

/* Once per ms: whose turn it is, and the next frame if it is ours. */
static void share_line(void)
{
    board_grant(turns_step(&turns, board_is_sending()));
    if (turns_may_send(&turns))
        board_send_next(&outbox);
}

int main(void)
{
    const struct boot boot = board_init();
    outbox_init(&outbox, outbox_bytes, OUTBOX_BYTES);
    drive_loop_init(&loop, &boot, &outbox);
    load_settings();
    turns_init(&turns);
    for (;;) {
        const uint32_t now_ms = board_ms();
        if (now_ms != loop.teller.uptime_ms) {
            loop.teller.uptime_ms = now_ms;
            share_line();
        }
        take_commands();
        step();
        board_sleep();
    }
}

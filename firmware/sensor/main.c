/* SPDX-License-Identifier: Apache-2.0
 *
 * The sensor board's program: each ms fire, read, tell, and speak when the drive board grants it; then sleep. The
 * watchdog is petted by each set of infra-red readings: it takes the clock and the converter to have one.
 */
#include "board.h"

#include "../link/turns.h"

#define OUTBOX_BYTES 128 /* five frames of this board's */

static struct sensor_loop loop;
static struct outbox outbox;
static uint8_t outbox_bytes[OUTBOX_BYTES];
static struct permit permit;
static uint32_t fired_ms;
static bool is_reading; /* the infra-red sensors */

_Static_assert(TURNS_GRANTED_BYTES == FRAME_HEADER + sizeof(struct sonar_payload) + FRAME_CHECK + 2, "longest");
_Static_assert(sizeof(struct sonar_payload) >= sizeof(struct infrared_payload), "longest told here");
_Static_assert(sizeof(struct sonar_payload) >= sizeof(struct status_payload), "longest told here");

static void take_commands(void)
{
    uint8_t byte;
    while (board_receive(&byte))
        sensor_loop_receive(&loop, byte);
}

static void load_settings(void)
{
    uint8_t record[SETTINGS_RECORD_SIZE(SENSOR_SETTINGS)];
    board_load(record, sizeof record);
    sensor_loop_load(&loop, record);
}

static void take_echoes(void)
{
    uint8_t line;
    uint16_t echo_us;
    while (board_echo(&line, &echo_us))
        sensor_loop_echo(&loop, line, echo_us);
    if (loop.teller.uptime_ms - fired_ms == BOARD_LISTEN_MS)
        board_stop_listening();
}

static void work_one_ms(void)
{
    loop.teller.uptime_ms++;
    take_echoes();
    const struct sensor_work work = sensor_loop_tick(&loop);
    if (work.fire) {
        board_fire(work.fire);
        fired_ms = loop.teller.uptime_ms;
    }
    if (work.is_infrared_due && !is_reading) { /* a reading may take until the next ms, and is then due still */
        board_start_infrared();
        is_reading = true;
    }
}

static void take_infrared(void)
{
    uint16_t counts[INFRARED_COUNT];
    if (!board_infrared(counts))
        return;
    is_reading = false;
    sensor_loop_infrared(&loop, counts);
    board_pet(loop.teller.worst_loop_us);
}

static void speak_if_granted(void)
{
    if (!board_is_sending() && permit_may_send(&permit, board_is_granted()) && board_send_next(&outbox))
        permit_use(&permit);
}

int main(void)
{
    const struct boot boot = board_init();
    outbox_init(&outbox, outbox_bytes, OUTBOX_BYTES);
    sensor_loop_init(&loop, &boot, &outbox);
    load_settings();
    permit_init(&permit);
    for (;;) {
        take_commands();
        take_infrared();
        while (loop.teller.uptime_ms != board_ms()) { /* each ms counts: none is left out if one comes late */
            const uint16_t start_us = board_us();
            speak_if_granted();
            work_one_ms();
            board_keep(&loop.adjuster, &loop.teller);
            board_note_loop(&loop.teller, start_us);
        }
        board_sleep();
    }
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "loop.h"

#include "../link/streams.h"

#include <string.h>

#define STATUS_MS 1000
#define STATUS_AT 505 /* when neither sonar nor infra-red has a frame to tell */

static const struct bounds BOUNDS[SENSOR_SETTINGS] = {STREAM_BOUNDS};

static void apply_settings(struct sensor_loop *loop)
{
    const float *values = loop->adjuster.settings.values;
    loop->sonar.period_ms = (uint16_t)values[SETTING_SONAR_MS];
    loop->infrared.told_ms = (uint16_t)values[SETTING_INFRARED_MS];
}

void sensor_loop_init(struct sensor_loop *loop, const struct boot *boot, struct outbox *outbox)
{
    memset(loop, 0, sizeof *loop);
    teller_init(&loop->teller, SOURCE_SENSOR, boot, outbox);
    sonar_schedule_init(&loop->sonar);
    infrared_init(&loop->infrared);
    frame_decoder_init(&loop->decoder);
    settings_init(&loop->adjuster.settings, SENSOR_SETTINGS, BOUNDS, streams_built_in);
    apply_settings(loop);
}

void sensor_loop_load(struct sensor_loop *loop, const uint8_t *record)
{
    settings_load(&loop->adjuster.settings, record);
    apply_settings(loop);
}

void sensor_loop_receive(struct sensor_loop *loop, uint8_t byte)
{
    struct frame frame;
    struct adjustment adjustment;
    if (!frame_decoder_feed(&loop->decoder, byte, &frame))
        return;
    const enum adjust_judgement judged =
        adjust_of_frame(&frame, SOURCE_SENSOR, loop->teller.uptime_ms, &adjustment);
    if (judged == ADJUST_GOOD) {
        adjust_obey(&loop->adjuster, &loop->teller, &adjustment);
        apply_settings(loop);
    } else if (judged == ADJUST_REFUSED && loop->refused < UINT16_MAX) {
        loop->refused++;
    }
}

struct sensor_work sensor_loop_tick(struct sensor_loop *loop)
{
    struct sonar_payload sweep;
    uint32_t sweep_ms;
    bool is_done;
    const uint32_t now_ms = loop->teller.uptime_ms;
    struct sensor_work work;
    work.fire = sonar_schedule_tick(&loop->sonar, now_ms, &sweep, &sweep_ms, &is_done);
    work.is_infrared_due = infrared_tick(&loop->infrared, now_ms);
    if (is_done)
        teller_tell(&loop->teller, CHANNEL_SONAR, sweep_ms, &sweep, sizeof sweep);
    if (now_ms % STATUS_MS == STATUS_AT)
        teller_tell_status(&loop->teller, 0, STOP_BOOT, loop->decoder.rejected, loop->refused);
    return work;
}

void sensor_loop_echo(struct sensor_loop *loop, uint8_t line, uint16_t echo_us)
{
    if (line < SENSOR_ECHO_LINES)
        sonar_schedule_echo(&loop->sonar, (uint8_t)(2 * line + loop->sonar.slot), echo_us);
}

void sensor_loop_infrared(struct sensor_loop *loop, const uint16_t counts[INFRARED_COUNT])
{
    struct infrared_payload frame;
    uint32_t frame_ms;
    if (infrared_add(&loop->infrared, counts, &frame, &frame_ms))
        teller_tell(&loop->teller, CHANNEL_INFRARED, frame_ms, &frame, sizeof frame);
}

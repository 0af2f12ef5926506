/* SPDX-License-Identifier: Apache-2.0 */
#include "sonar_schedule.h"

#include "../link/streams.h"

static void forget(struct sonar_schedule *schedule)
{
    for (uint8_t i = 0; i < SONAR_COUNT; i++)
        schedule->sweep.echo_us[i] = SONAR_NO_RETURN;
}

void sonar_schedule_init(struct sonar_schedule *schedule)
{
    schedule->period_ms = STREAM_SONAR_MS;
    schedule->sweep_ms = 0;
    schedule->listening = 0;
    schedule->slot = 1;
    schedule->is_sweeping = schedule->has_swept = false;
    forget(schedule);
}

static uint8_t start_sweep(struct sonar_schedule *schedule, uint32_t now_ms)
{
    forget(schedule);
    schedule->is_sweeping = true;
    schedule->sweep_ms = now_ms;
    schedule->slot = 0;
    schedule->listening = SONAR_EVEN;
    return SONAR_EVEN;
}

uint8_t sonar_schedule_tick(struct sonar_schedule *schedule, uint32_t now_ms, struct sonar_payload *done,
                            uint32_t *done_ms, bool *is_done)
{
    *is_done = false;
    const uint32_t elapsed = now_ms - schedule->sweep_ms;
    if (schedule->is_sweeping && schedule->slot == 0 && elapsed >= SONAR_SLOT_MS) {
        schedule->slot = 1;
        schedule->listening = SONAR_ODD;
        return SONAR_ODD;
    }
    if (schedule->is_sweeping && elapsed < 2u * SONAR_SLOT_MS)
        return 0;
    if (schedule->is_sweeping) {
        *done = schedule->sweep;
        *done_ms = schedule->sweep_ms;
        *is_done = schedule->has_swept = true;
        schedule->is_sweeping = false;
        schedule->listening = 0;
    }
    if (schedule->has_swept && elapsed < schedule->period_ms)
        return 0;
    return start_sweep(schedule, now_ms);
}

void sonar_schedule_echo(struct sonar_schedule *schedule, uint8_t sonar, uint16_t echo_us)
{
    const uint8_t bit = (uint8_t)(1u << sonar);
    if (sonar >= SONAR_COUNT || !(schedule->listening & bit) || echo_us < SONAR_BLANK_US || echo_us > SONAR_TIMEOUT_US)
        return;
    schedule->listening = (uint8_t)(schedule->listening & ~bit);
    schedule->sweep.echo_us[sonar] = echo_us;
}

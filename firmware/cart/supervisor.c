/* SPDX-License-Identifier: Apache-2.0 */
#include "supervisor.h"

void cart_supervisor_init(struct cart_supervisor *supervisor, uint8_t reason)
{
    const struct cart_supervisor fresh = {.state = DRIVE_DISARMED, .reason = reason};
    *supervisor = fresh;
}

static void stand(struct cart_supervisor *supervisor, uint8_t state, uint8_t reason)
{
    supervisor->state = state;
    supervisor->reason = reason;
}

static void begin(struct cart_supervisor *supervisor, const struct cart_command *command)
{
    if (supervisor->is_empty)
        return;
    stand(supervisor, DRIVE_ARMED, STOP_NONE);
    supervisor->leash_ms = command->leash_s * 1000UL;
    supervisor->failed = 0;
}

void cart_supervisor_obey(struct cart_supervisor *supervisor, const struct cart_command *command)
{
    if (command->kind == CART_REFUSED) {
        if (supervisor->refused < UINT16_MAX)
            supervisor->refused++;
        return;
    }
    supervisor->acknowledged = command->sequence;
    supervisor->silent_ms = 0;
    if (command->kind == CART_RUN)
        begin(supervisor, command);
    else if (command->kind == CART_STOP && supervisor->state == DRIVE_ARMED) /* what stands keeps the reason why */
        stand(supervisor, DRIVE_DISARMED, STOP_COMMAND);
}

void cart_supervisor_note(struct cart_supervisor *supervisor, const struct cart_stage *ended, bool is_last)
{
    if (ended->kind == STAGE_DRIVE)
        supervisor->failed = ended->bumper == 0 ? (uint8_t)(supervisor->failed + 1) : 0;
    if (is_last)
        stand(supervisor, DRIVE_DISARMED, STOP_NONE);
    else if (supervisor->failed >= CART_FAILED_DRIVES)
        stand(supervisor, DRIVE_DISARMED, STOP_BLOCKED);
}

static void judge_battery(struct cart_supervisor *supervisor, uint16_t battery_mv)
{
    const bool is_low = battery_mv < (supervisor->is_empty ? CART_RESTED_MV : CART_EMPTY_MV);
    supervisor->battery_ms = is_low != supervisor->is_empty ? (uint16_t)(supervisor->battery_ms + 1) : 0;
    if (supervisor->battery_ms < CART_BATTERY_MS)
        return;
    supervisor->battery_ms = 0;
    supervisor->is_empty = is_low;
    stand(supervisor, is_low ? DRIVE_FAULT : DRIVE_DISARMED, STOP_BATTERY);
}

static void judge_leash(struct cart_supervisor *supervisor)
{
    if (supervisor->state != DRIVE_ARMED || supervisor->leash_ms == 0)
        return;
    if (++supervisor->silent_ms >= supervisor->leash_ms)
        stand(supervisor, DRIVE_LINK_LOST, STOP_LINK);
}

void cart_supervisor_step(struct cart_supervisor *supervisor, uint16_t battery_mv)
{
    judge_leash(supervisor);
    judge_battery(supervisor, battery_mv);
}

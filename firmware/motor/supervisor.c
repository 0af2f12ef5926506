/* SPDX-License-Identifier: Apache-2.0 */
#include "supervisor.h"

#include <string.h>

void motor_supervisor_init(struct motor_supervisor *supervisor, uint8_t reason)
{
    const struct motor_supervisor fresh = {.state = DRIVE_DISARMED, .reason = reason};
    *supervisor = fresh;
}

static void switch_off(struct motor_supervisor *supervisor, uint8_t state, uint8_t reason)
{
    supervisor->state = state;
    supervisor->reason = reason;
    memset(supervisor->wanted, 0, sizeof supervisor->wanted);
}

static void take_powers(struct motor_supervisor *supervisor, const struct motor_command *command)
{
    if (supervisor->is_empty)
        return;
    supervisor->state = DRIVE_ARMED;
    supervisor->reason = STOP_NONE;
    supervisor->left_ms = command->deadline_ms;
    memcpy(supervisor->wanted, command->powers, sizeof supervisor->wanted);
}

void motor_supervisor_obey(struct motor_supervisor *supervisor, const struct motor_command *command)
{
    if (command->kind == MOTOR_REFUSED) {
        if (supervisor->refused < UINT16_MAX)
            supervisor->refused++;
        return;
    }
    supervisor->acknowledged = command->sequence;
    if (command->kind == MOTOR_POWERS)
        take_powers(supervisor, command);
    else if (supervisor->state == DRIVE_ARMED) /* what stands keeps the reason why */
        switch_off(supervisor, DRIVE_DISARMED, STOP_COMMAND);
}

static void judge_battery(struct motor_supervisor *supervisor, uint16_t battery_mv)
{
    const bool is_low = battery_mv < (supervisor->is_empty ? MOTOR_RESTED_MV : MOTOR_EMPTY_MV);
    supervisor->battery_ms = is_low != supervisor->is_empty ? (uint16_t)(supervisor->battery_ms + 1) : 0;
    if (supervisor->battery_ms < MOTOR_BATTERY_MS)
        return;
    supervisor->battery_ms = 0;
    supervisor->is_empty = is_low;
    switch_off(supervisor, is_low ? DRIVE_FAULT : DRIVE_DISARMED, STOP_BATTERY);
}

static void judge_deadline(struct motor_supervisor *supervisor)
{
    if (supervisor->state == DRIVE_ARMED && --supervisor->left_ms == 0)
        switch_off(supervisor, DRIVE_LINK_LOST, STOP_LINK);
}

void motor_supervisor_step(struct motor_supervisor *supervisor, uint16_t battery_mv)
{
    judge_deadline(supervisor);
    judge_battery(supervisor, battery_mv);
}

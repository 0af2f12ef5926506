/* SPDX-License-Identifier: Apache-2.0 */
#include "loop.h"

#include <string.h>

#define MOTORS_MS 20
#define STATUS_MS 1000
#define STATUS_AT 505 /* when there are no powers to tell */
#define WATCHDOG_RESET 0x08 /* MCUCSR: WDRF */

void motor_loop_init(struct motor_loop *loop, const struct boot *boot, struct outbox *outbox)
{
    memset(loop, 0, sizeof *loop);
    teller_init(&loop->teller, SOURCE_MOTOR, boot, outbox);
    frame_decoder_init(&loop->decoder);
    motor_supervisor_init(&loop->supervisor, boot->reset_cause & WATCHDOG_RESET ? STOP_WATCHDOG : STOP_BOOT);
    for (uint8_t side = 0; side < MOTORS; side++)
        ramp_init(&loop->ramps[side]);
}

enum motor_command_kind motor_loop_receive(struct motor_loop *loop, uint8_t byte)
{
    struct frame frame;
    if (!frame_decoder_feed(&loop->decoder, byte, &frame))
        return MOTOR_REFUSED;
    const struct motor_command command = motor_command_of_frame(&frame, loop->teller.uptime_ms);
    motor_supervisor_obey(&loop->supervisor, &command);
    return command.kind;
}

void motor_loop_battery(struct motor_loop *loop, uint16_t sum)
{
    loop->battery_mv = battery_mv(sum);
}

static void tell_motors(struct motor_loop *loop)
{
    const struct motors_payload payload = {
        .left_power = loop->ramps[0].power,
        .right_power = loop->ramps[1].power,
        .battery_mv = loop->battery_mv,
        .state = loop->supervisor.state,
        .reason = loop->supervisor.reason,
        .acknowledged = loop->supervisor.acknowledged,
    };
    teller_tell(&loop->teller, CHANNEL_MOTORS, loop->teller.uptime_ms, &payload, sizeof payload);
}

void motor_loop_tick(struct motor_loop *loop)
{
    const struct motor_supervisor *supervisor = &loop->supervisor;
    const uint32_t now_ms = loop->teller.uptime_ms;
    motor_supervisor_step(&loop->supervisor, loop->battery_mv);
    for (uint8_t side = 0; side < MOTORS; side++)
        ramp_step(&loop->ramps[side], supervisor->wanted[side]);
    if (now_ms % MOTORS_MS == 0)
        tell_motors(loop);
    if (now_ms % STATUS_MS == STATUS_AT)
        teller_tell_status(&loop->teller, supervisor->state, supervisor->reason, loop->decoder.rejected,
                           supervisor->refused);
}

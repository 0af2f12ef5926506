/* SPDX-License-Identifier: Apache-2.0 */
#include "loop.h"

#include <string.h>

#define CART_MS 100
#define UPLOAD_MS 20
#define UPLOAD_AT 13 /* when nothing else is told */
#define STATUS_MS 1000
#define STATUS_AT 505
#define WATCHDOG_RESET 0x08 /* MCUCSR: WDRF */

void cart_loop_init(struct cart_loop *loop, const struct boot *boot, struct outbox *outbox)
{
    memset(loop, 0, sizeof *loop);
    teller_init(&loop->teller, SOURCE_CART, boot, outbox);
    frame_decoder_init(&loop->decoder);
    cart_supervisor_init(&loop->supervisor, boot->reset_cause & WATCHDOG_RESET ? STOP_WATCHDOG : STOP_BOOT);
    cart_program_init(&loop->program);
    for (uint8_t side = 0; side < 2; side++)
        ramp_init(&loop->ramps[side]);
}

static void begin_run(struct cart_loop *loop, const struct cart_orders *orders)
{
    cart_log_clear(&loop->log);
    loop->upload_next = loop->upload_end = 0;
    loop->run++;
    cart_program_start(&loop->program, orders);
}

static void begin_upload(struct cart_loop *loop, uint16_t first, uint16_t count)
{
    const uint16_t kept = cart_log_first(&loop->log), end = loop->log.count;
    loop->upload_next = first < kept ? kept : first;
    loop->upload_end = count < end && first < end - count ? (uint16_t)(first + count) : end;
}

enum cart_command_kind cart_loop_receive(struct cart_loop *loop, uint8_t byte)
{
    struct frame frame;
    if (!frame_decoder_feed(&loop->decoder, byte, &frame))
        return CART_REFUSED;
    const struct cart_command command = cart_command_of_frame(&frame, loop->teller.uptime_ms);
    cart_supervisor_obey(&loop->supervisor, &command);
    if (command.kind == CART_RUN && loop->supervisor.state == DRIVE_ARMED)
        begin_run(loop, &command.orders);
    else if (command.kind == CART_UPLOAD)
        begin_upload(loop, command.first, command.count);
    return command.kind;
}

void cart_loop_battery(struct cart_loop *loop, uint16_t sum)
{
    loop->battery_mv = battery_mv(sum);
}

static void tell_cart(struct cart_loop *loop, const struct cart_sensed *sensed)
{
    const struct cart_payload payload = {
        .left_ticks = (int16_t)sensed->ticks[0],
        .right_ticks = (int16_t)sensed->ticks[1],
        .battery_mv = loop->battery_mv,
        .logged = loop->log.count,
        .bumps = loop->program.bumps,
        .doing = loop->program.state,
        .bumper = sensed->bumper,
        .run = loop->run,
        .state = loop->supervisor.state,
        .reason = loop->supervisor.reason,
        .acknowledged = loop->supervisor.acknowledged,
    };
    teller_tell(&loop->teller, CHANNEL_CART, loop->teller.uptime_ms, &payload, sizeof payload);
}

static void tell_stage(struct cart_loop *loop, uint16_t number, const struct cart_stage *stage, bool is_kept)
{
    const struct stage_payload payload = {
        .number = number,
        .run = loop->run,
        .kind = stage->kind,
        .bumper = stage->bumper,
        .is_kept = is_kept,
        .left = stage->left,
        .right = stage->right,
    };
    teller_tell(&loop->teller, CHANNEL_STAGE, loop->teller.uptime_ms, &payload, sizeof payload);
}

/* Stages that are overwritten meanwhile are left out. */
static void upload(struct cart_loop *loop)
{
    struct cart_stage stage;
    const uint16_t kept = cart_log_first(&loop->log);
    if (loop->upload_next < kept)
        loop->upload_next = kept;
    if (loop->upload_next >= loop->upload_end || !cart_log_get(&loop->log, loop->upload_next, &stage))
        return;
    tell_stage(loop, loop->upload_next, &stage, true);
    loop->upload_next++;
}

/* The program's next ms; whether a stage ended. */
static bool step_program(struct cart_loop *loop, const struct cart_sensed *sensed)
{
    struct cart_stage ended;
    if (loop->supervisor.state != DRIVE_ARMED)
        cart_program_stop(&loop->program);
    if (!cart_program_step(&loop->program, sensed, &ended))
        return false;
    cart_log_add(&loop->log, &ended);
    tell_stage(loop, (uint16_t)(loop->log.count - 1), &ended, false);
    cart_supervisor_note(&loop->supervisor, &ended, loop->program.state == CART_STAND);
    return true;
}

bool cart_loop_tick(struct cart_loop *loop, const struct cart_sensed *sensed)
{
    const struct cart_supervisor *supervisor = &loop->supervisor;
    const uint32_t now_ms = loop->teller.uptime_ms;
    cart_supervisor_step(&loop->supervisor, loop->battery_mv);
    const bool has_ended = step_program(loop, sensed);
    if (supervisor->state != DRIVE_ARMED)
        cart_program_stop(&loop->program);
    for (uint8_t side = 0; side < 2; side++)
        ramp_step(&loop->ramps[side], loop->program.wanted[side]);
    if (now_ms % CART_MS == 0)
        tell_cart(loop, sensed);
    if (now_ms % UPLOAD_MS == UPLOAD_AT)
        upload(loop);
    if (now_ms % STATUS_MS == STATUS_AT)
        teller_tell_status(&loop->teller, supervisor->state, supervisor->reason, loop->decoder.rejected,
                           supervisor->refused);
    return has_ended;
}

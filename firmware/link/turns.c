/* SPDX-License-Identifier: Apache-2.0 */
#include "turns.h"

static void enter(struct turns *turns, enum turns_phase phase)
{
    turns->phase = (uint8_t)phase;
    turns->ms = 0;
}

void turns_init(struct turns *turns)
{
    enter(turns, TURNS_LISTENING);
}

bool turns_step(struct turns *turns, bool is_sending)
{
    if (turns->ms < UINT8_MAX)
        turns->ms++;
    if (turns->phase == TURNS_LISTENING && turns->ms >= TURNS_LISTEN_MS)
        enter(turns, TURNS_OWN);
    else if (turns->phase == TURNS_OWN && turns->ms >= TURNS_OWN_MS && !is_sending)
        enter(turns, TURNS_GRANTING);
    else if (turns->phase == TURNS_GRANTING && turns->ms >= TURNS_GRANT_MS)
        enter(turns, TURNS_LISTENING);
    return turns->phase == TURNS_GRANTING;
}

bool turns_may_send(const struct turns *turns)
{
    return turns->phase == TURNS_OWN && turns->ms < TURNS_OWN_MS;
}

void permit_init(struct permit *permit)
{
    permit->is_used = true; /* GRANT may have been high for long */
}

bool permit_may_send(struct permit *permit, bool is_granted)
{
    if (!is_granted)
        permit->is_used = false;
    return is_granted && !permit->is_used;
}

void permit_use(struct permit *permit)
{
    permit->is_used = true;
}

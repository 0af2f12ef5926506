/* SPDX-License-Identifier: Apache-2.0 */
#include "log.h"

#define KIND_BITS 2
#define KIND_MASK 3u

void cart_log_clear(struct cart_log *log)
{
    log->count = 0;
}

void cart_log_add(struct cart_log *log, const struct cart_stage *stage)
{
    if (log->count == UINT16_MAX)
        return;
    struct cart_record *record = &log->records[log->count % CART_KEPT];
    record->left = stage->left;
    record->right = stage->right;
    record->what = (uint8_t)(stage->kind | stage->bumper << KIND_BITS);
    log->count++;
}

uint16_t cart_log_first(const struct cart_log *log)
{
    return log->count > CART_KEPT ? (uint16_t)(log->count - CART_KEPT) : 0;
}

bool cart_log_get(const struct cart_log *log, uint16_t number, struct cart_stage *stage)
{
    if (number < cart_log_first(log) || number >= log->count)
        return false;
    const struct cart_record *record = &log->records[number % CART_KEPT];
    stage->kind = record->what & KIND_MASK;
    stage->bumper = (uint8_t)(record->what >> KIND_BITS);
    stage->left = record->left;
    stage->right = record->right;
    return true;
}

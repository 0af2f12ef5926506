/* SPDX-License-Identifier: Apache-2.0
 *
 * The log of a run's stages in the board's memory: pairs of 16-bit counts, as the Lego brick kept them, with what ended
 * each. A ring: the newest CART_KEPT stages are kept. A reset empties it.
 */
#ifndef CRUNCH_CART_LOG_H
#define CRUNCH_CART_LOG_H

#include "program.h"

#define CART_KEPT 192 /* stages: 64 bumps */

struct cart_record {
    int16_t left, right;
    uint8_t what; /* kind, and the switches above its two bits */
};

struct cart_log {
    struct cart_record records[CART_KEPT];
    uint16_t count; /* stages of this run so far; stays at its maximum, and what comes then is lost */
};

/* Begins anew. */
void cart_log_clear(struct cart_log *log);

/* Keeps a stage; its number is the count before. */
void cart_log_add(struct cart_log *log, const struct cart_stage *stage);

/* The number of the oldest stage that is kept; the count if there is none. */
uint16_t cart_log_first(const struct cart_log *log);

/* A stage by its number; false if it is not, or no longer, kept. */
bool cart_log_get(const struct cart_log *log, uint16_t number, struct cart_stage *stage);

#endif

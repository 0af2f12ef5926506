/* SPDX-License-Identifier: Apache-2.0
 *
 * How any board speaks: it numbers and stamps its frames and puts them into its outbox. Also the status frame, which
 * all boards have.
 */
#ifndef CRUNCH_LINK_TELLER_H
#define CRUNCH_LINK_TELLER_H

#include "outbox.h"

struct ending { /* what a board was at and why; kept over a reset these are its last words */
    uint8_t state, reason; /* enum drive_state, stop_reason */
    uint32_t since_ms;     /* uptime when either last changed */
    uint32_t uptime_ms;    /* 0: nothing is known */
};

struct boot { /* what the status frame says about this start */
    uint8_t reset_cause; /* MCUCSR */
    uint16_t count;
    uint16_t build;
    uint16_t worst_loop_us; /* of the run before, where it is known, */
    struct ending ending;   /* and how that ended */
};

struct teller {
    uint8_t source;
    uint8_t sequence;
    struct boot boot;
    uint16_t worst_loop_us; /* of the loop's body since boot */
    uint32_t uptime_ms;
    struct outbox *outbox;
};

/* The outbox must outlive the teller. */
void teller_init(struct teller *teller, uint8_t source, const struct boot *boot, struct outbox *outbox);

/* One frame, sampled at `time_ms`; a frame that finds no room leaves no gap in the sequence. */
void teller_tell(struct teller *teller, uint8_t channel, uint32_t time_ms, const void *payload, uint8_t size);

/* What was heard and is no frame, and commands that were refused, are told as one number that stays at its maximum. */
void teller_tell_status(struct teller *teller, uint8_t state, uint8_t reason, uint16_t rejected, uint16_t refused);

#endif

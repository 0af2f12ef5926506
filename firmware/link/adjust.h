/* SPDX-License-Identifier: Apache-2.0
 *
 * Adjustments from the host and their answers. Either board hears all of them and obeys its own. A good one is always
 * answered, refused or not; one without its seal (seal.h) never is. Nothing here moves the robot, nor counts as a sign
 * of life of its driver.
 */
#ifndef CRUNCH_LINK_ADJUST_H
#define CRUNCH_LINK_ADJUST_H

#include "settings.h"
#include "teller.h"

struct adjustment {
    uint8_t verb, setting, sequence;
    float value;
};

enum adjust_judgement { ADJUST_ELSEWHERE = 0, ADJUST_REFUSED, ADJUST_GOOD };

struct adjuster {
    struct settings settings;
    struct adjustment storing; /* to be answered when the record is complete */
};

/* Judges one good frame at the board's uptime: is it an adjustment, and for this board? */
enum adjust_judgement adjust_of_frame(const struct frame *frame, uint8_t board, uint32_t uptime_ms,
                                      struct adjustment *adjustment);

/* Does it and answers, at once or, a record, when it is complete. Zeroing is no matter of settings: OUTCOME_UNKNOWN. */
void adjust_obey(struct adjuster *adjuster, struct teller *teller, const struct adjustment *adjustment);

/* settings_did, with the answer. */
void adjust_did(struct adjuster *adjuster, struct teller *teller, uint8_t found);

/* One answer. */
void adjust_answer(const struct adjuster *adjuster, struct teller *teller, const struct adjustment *adjustment,
                   enum adjust_outcome outcome, float value);

#endif

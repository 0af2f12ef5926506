/* SPDX-License-Identifier: Apache-2.0
 *
 * One modem, two transmitters: who may speak when. The drive board holds the line and raises GRANT once a round; the
 * sensor board starts at most one frame while GRANT is high. The drive board is silent from raising GRANT until the
 * longest frame that may have been started on its last moment is over. Pure; both are called once per ms.
 *
 *     line     | drive's own ............... | sensor's ............................ |
 *     GRANT    _____________________________/^^^^^^^^^^^\____________________________
 *                      9 ms, or until idle       3 ms             8 ms
 *
 * GRANT is pulled low: a drive board that is dead or in reset grants nothing. After a reset it listens first.
 */
#ifndef CRUNCH_LINK_TURNS_H
#define CRUNCH_LINK_TURNS_H

#include <stdbool.h>
#include <stdint.h>

#define TURNS_OWN_MS 9
#define TURNS_GRANT_MS 3  /* a step may make its first ms short: one of the sensor board's ticks falls into the rest */
#define TURNS_LISTEN_MS 8 /* a frame of 24 bytes takes 6.25 ms */
#define TURNS_GRANTED_BYTES 24

enum turns_phase { TURNS_LISTENING = 0, TURNS_OWN, TURNS_GRANTING };

struct turns { /* the drive board's side */
    uint8_t phase; /* enum turns_phase */
    uint8_t ms;    /* in it; stays at its maximum */
};

struct permit { /* the sensor board's side */
    bool is_used; /* in this grant */
};

void turns_init(struct turns *turns);

/* One ms, then: is GRANT to be high? */
bool turns_step(struct turns *turns, bool is_sending);

/* May the drive board start a frame? */
bool turns_may_send(const struct turns *turns);

void permit_init(struct permit *permit);

/* May the sensor board start a frame, seeing GRANT so? A frame that is then sent must be told by permit_use. */
bool permit_may_send(struct permit *permit, bool is_granted);

void permit_use(struct permit *permit);

#endif

/* SPDX-License-Identifier: Apache-2.0
 *
 * What can be adjusted on a board, within bounds, and the record of it in the EEPROM. Pure: whoever calls moves the
 * bytes, one at a time, so that writing (8.5 ms for a byte) never holds up a step.
 *
 * The record: the number of settings, their values, and the CRC-32 of these. It is written in order and then read
 * again; a reset in between leaves one whose checksum is wrong, and the built-in settings are in force.
 */
#ifndef CRUNCH_LINK_SETTINGS_H
#define CRUNCH_LINK_SETTINGS_H

#include "channels.h"

#include <stdbool.h>
#include <stdint.h>

#define SETTINGS_MAX 13
#define SETTINGS_RECORD_SIZE(count) (1 + 4 * (count) + 4)

struct bounds {
    float low, high;
};

struct settings { /* numbered from 0 (enum link_setting); these three are of the board's kind */
    uint8_t count;
    const struct bounds *bounds;
    void (*built_in)(float *values); /* writes `count` values, all of them sound */
    float values[SETTINGS_MAX]; /* in force */
    float stored[SETTINGS_MAX]; /* of the record */
    uint8_t record;             /* enum record_state */
    uint8_t at;                 /* the next byte to be written or read again */
    bool is_checking;           /* written: now read again */
    uint32_t crc;               /* of the values' bytes before `at` */
};

struct settings_work { /* one byte of the record, at `at` */
    uint8_t at;
    uint8_t byte;  /* what is to be there */
    bool is_write; /* otherwise it is to be read only */
};

/* The built-in settings, with no record. The bounds must outlive them. */
void settings_init(struct settings *settings, uint8_t count, const struct bounds *bounds,
                   void (*built_in)(float *values));

/* Takes over a record of SETTINGS_RECORD_SIZE(count) bytes if it is sound, and keeps in mind what it was. */
void settings_load(struct settings *settings, const uint8_t *record);

/* Back to the built-in settings; the record stays. */
void settings_reset(struct settings *settings);

/* Sets one; anything but OUTCOME_DONE leaves all as it was. */
enum adjust_outcome settings_set(struct settings *settings, uint8_t setting, float value);

/* Whether a start would bring this setting's present value from the record. */
bool settings_is_stored(const struct settings *settings, uint8_t setting);

/* Begins a record of the values in force, unless it is under way; one of other values is begun anew. */
void settings_store(struct settings *settings);

/* What is to be done to the EEPROM next; false if nothing is. To be asked only while the EEPROM is ready. */
bool settings_work(const struct settings *settings, struct settings_work *work);

/* It is done, and this is what was found (or put) at work.at; true when the record is complete, or has failed. */
bool settings_did(struct settings *settings, uint8_t found);

#endif

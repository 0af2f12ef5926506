/* SPDX-License-Identifier: Apache-2.0 */
#include "settings.h"

#include "crc.h"
#include "streams.h"

#include <string.h>

#define ERASED 0xFF

_Static_assert(SETTINGS_RECORD_SIZE(SETTINGS_MAX) <= UINT8_MAX, "counted in a byte");

static uint8_t values_size(const struct settings *settings)
{
    return (uint8_t)(settings->count * sizeof(float));
}

static uint8_t record_size(const struct settings *settings)
{
    return (uint8_t)SETTINGS_RECORD_SIZE(settings->count);
}

void settings_reset(struct settings *settings)
{
    settings->built_in(settings->values);
}

void settings_init(struct settings *settings, uint8_t count, const struct bounds *bounds,
                   void (*built_in)(float *values))
{
    memset(settings, 0, sizeof *settings);
    settings->count = count;
    settings->bounds = bounds;
    settings->built_in = built_in;
    settings_reset(settings);
}

static bool is_within(const struct bounds *bounds, float value)
{
    return value >= bounds->low && value <= bounds->high; /* what is no number is neither */
}

/* What the streams would be with one of them changed. */
static enum adjust_outcome judge_period(const struct settings *settings, uint8_t setting, float value)
{
    uint16_t periods_ms[STREAM_COUNT];
    for (uint8_t i = 0; i < STREAM_COUNT; i++)
        periods_ms[i] = (uint16_t)(i == setting ? value : settings->values[i]);
    if ((float)periods_ms[setting] != value || !streams_is_period(setting, periods_ms[setting]))
        return OUTCOME_BOUNDS;
    return streams_load(periods_ms) < STREAMS_HALF_LINE ? OUTCOME_DONE : OUTCOME_BUDGET;
}

enum adjust_outcome settings_set(struct settings *settings, uint8_t setting, float value)
{
    if (setting >= settings->count)
        return OUTCOME_UNKNOWN;
    if (!is_within(&settings->bounds[setting], value))
        return OUTCOME_BOUNDS;
    const enum adjust_outcome outcome =
        setting < STREAM_COUNT ? judge_period(settings, setting, value) : OUTCOME_DONE;
    if (outcome == OUTCOME_DONE)
        settings->values[setting] = value;
    return outcome;
}

bool settings_is_stored(const struct settings *settings, uint8_t setting)
{
    return settings->record == RECORD_SOUND && setting < settings->count &&
           memcmp(&settings->values[setting], &settings->stored[setting], sizeof(float)) == 0;
}

static bool is_erased(const uint8_t *record, uint8_t size)
{
    for (uint8_t i = 0; i < size; i++)
        if (record[i] != ERASED)
            return false;
    return true;
}

/* The byte at `settings->at`, to be asked for in order: the checksum grows with them. */
static uint8_t record_byte(const struct settings *settings)
{
    if (settings->at == 0)
        return settings->count;
    const uint8_t at = (uint8_t)(settings->at - 1);
    const uint8_t size = values_size(settings);
    return at < size ? ((const uint8_t *)settings->stored)[at] : (uint8_t)(~settings->crc >> 8 * (at - size));
}

static bool is_record(const struct settings *settings, const uint8_t *record)
{
    const uint8_t size = values_size(settings);
    const uint32_t check = crc32_of(record + 1, size);
    return record[0] == settings->count && memcmp(record + 1 + size, &check, sizeof check) == 0;
}

/* A sound record of another build may have values that this one would not take. */
static bool are_stored_sound(const struct settings *settings)
{
    struct settings trial = *settings;
    memcpy(trial.values, trial.stored, sizeof trial.values);
    for (uint8_t i = 0; i < trial.count; i++)
        if (settings_set(&trial, i, trial.stored[i]) != OUTCOME_DONE)
            return false;
    return true;
}

void settings_load(struct settings *settings, const uint8_t *record)
{
    if (is_erased(record, record_size(settings))) {
        settings->record = RECORD_NONE;
        return;
    }
    memcpy(settings->stored, record + 1, values_size(settings));
    const bool is_sound = is_record(settings, record) && are_stored_sound(settings);
    settings->record = is_sound ? RECORD_SOUND : RECORD_SPOILED;
    if (is_sound)
        memcpy(settings->values, settings->stored, values_size(settings));
}

static void begin_pass(struct settings *settings, bool is_checking)
{
    settings->is_checking = is_checking;
    settings->at = 0;
    settings->crc = CRC32_INITIAL;
}

void settings_store(struct settings *settings)
{
    if (settings->record == RECORD_WRITING && memcmp(settings->stored, settings->values, sizeof settings->stored) == 0)
        return; /* asked again: it is under way */
    memcpy(settings->stored, settings->values, sizeof settings->stored);
    settings->record = RECORD_WRITING;
    begin_pass(settings, false);
}

bool settings_work(const struct settings *settings, struct settings_work *work)
{
    if (settings->record != RECORD_WRITING)
        return false;
    work->at = settings->at;
    work->byte = record_byte(settings);
    work->is_write = !settings->is_checking;
    return true;
}

bool settings_did(struct settings *settings, uint8_t found)
{
    const uint8_t byte = record_byte(settings);
    if (settings->is_checking && found != byte) {
        settings->record = RECORD_SPOILED;
        return true;
    }
    if (settings->at > 0 && settings->at <= values_size(settings))
        settings->crc = crc32_update(settings->crc, byte);
    settings->at++;
    if (settings->at < record_size(settings))
        return false;
    if (settings->is_checking)
        settings->record = RECORD_SOUND;
    else
        begin_pass(settings, true);
    return settings->record == RECORD_SOUND;
}

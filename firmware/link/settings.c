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

static bool is_sound(const struct settings *settings, uint8_t setting, float value)
{
    const struct bounds *bounds = &settings->bounds[setting];
    const bool is_within = value >= bounds->low && value <= bounds->high; /* what is no number is neither */
    return is_within && (setting >= STREAM_COUNT || streams_is_period(setting, value));
}

static bool is_line_half_free(const struct settings *settings)
{
    return streams_load(settings->values) < STREAMS_HALF_LINE;
}

enum adjust_outcome settings_set(struct settings *settings, uint8_t setting, float value)
{
    if (setting >= settings->count)
        return OUTCOME_UNKNOWN;
    if (!is_sound(settings, setting, value))
        return OUTCOME_BOUNDS;
    const float before = settings->values[setting];
    settings->values[setting] = value;
    if (is_line_half_free(settings))
        return OUTCOME_DONE;
    settings->values[setting] = before;
    return OUTCOME_BUDGET;
}

bool settings_is_stored(const struct settings *settings, uint8_t setting)
{
    return settings->record == RECORD_SOUND && setting < settings->count &&
           memcmp(&settings->values[setting], &settings->stored[setting], sizeof(float)) == 0;
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
static bool are_values_sound(const struct settings *settings)
{
    for (uint8_t i = 0; i < settings->count; i++)
        if (!is_sound(settings, i, settings->values[i]))
            return false;
    return is_line_half_free(settings);
}

void settings_load(struct settings *settings, const uint8_t *record)
{
    if (record[0] == ERASED) {
        settings->record = RECORD_NONE;
        return;
    }
    settings->record = RECORD_SPOILED;
    if (!is_record(settings, record))
        return;
    memcpy(settings->stored, record + 1, values_size(settings));
    memcpy(settings->values, settings->stored, sizeof settings->values);
    if (are_values_sound(settings))
        settings->record = RECORD_SOUND;
    else
        settings_reset(settings);
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

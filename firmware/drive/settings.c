/* SPDX-License-Identifier: Apache-2.0 */
#include "settings.h"

#include "../link/streams.h"
#include "balance.h"
#include "tilt.h"

#include <string.h>

#define GAINS (SETTING_FEED_TURN - SETTING_TILT + 1)

_Static_assert(sizeof(struct balance_gains) == GAINS * sizeof(float), "the settings name the gains in their order");
_Static_assert(SETTING_LEVEL + 1 == DRIVE_SETTINGS && DRIVE_SETTINGS <= SETTINGS_MAX, "all settings are this board's");

static const struct bounds BOUNDS[DRIVE_SETTINGS] = {
    STREAM_BOUNDS,
    [SETTING_TILT] = {1.2f, 24.0f},
    [SETTING_TILT_RATE] = {0.18f, 3.6f},
    [SETTING_SPEED] = {0.0f, 12.0f},
    [SETTING_POSITION] = {0.0f, 6.0f},
    [SETTING_TURN_RATE] = {0.0f, 0.24f},
    [SETTING_HEADING] = {0.0f, 1.8f},
    [SETTING_FEED_TURN] = {0.0f, 0.4f},
    [SETTING_TIME_CONSTANT] = {2.0f, 10.0f},
    [SETTING_LEVEL] = {-0.21f, 0.21f},
};

static void built_in(float *values)
{
    streams_built_in(values);
    memcpy(values + SETTING_TILT, &BALANCE_GAINS, sizeof BALANCE_GAINS);
    values[SETTING_TIME_CONSTANT] = TILT_TIME_CONSTANT;
    values[SETTING_LEVEL] = 0.0f;
}

void drive_settings_init(struct settings *settings)
{
    settings_init(settings, DRIVE_SETTINGS, BOUNDS, built_in);
}

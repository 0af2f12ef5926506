/* SPDX-License-Identifier: Apache-2.0
 *
 * How often the boards tell what, and what that takes of the line. Both boards know the periods of all streams, their
 * own and the other's, so that either can refuse a profile which would take half of the line or more.
 *
 * A period is a multiple of the drive board's 5 ms, or for the infra-red sensors of their 40 ms, of which 2 s are a
 * multiple: loads are then whole bytes per 2 s.
 */
#ifndef CRUNCH_LINK_STREAMS_H
#define CRUNCH_LINK_STREAMS_H

#include "channels.h"

#include <stdbool.h>
#include <stdint.h>

#define STREAM_COUNT 4 /* odometry, balance, sonar, infra-red: their settings are the first ones */
#define STREAMS_CYCLE_MS 2000
#define STREAMS_HALF_LINE 3840u /* bytes in 2 s: half of 38400 baud, for both directions together */

/* Built-in periods, ms. */
#define STREAM_ODOMETRY_MS 20
#define STREAM_BALANCE_MS 500
#define STREAM_SONAR_MS 80
#define STREAM_INFRARED_MS 40

/* Of their periods, ms: a sweep of the sonars takes two slots, a GP2D12 measures every 38 ms. */
#define STREAM_BOUNDS {5.0f, 2000.0f}, {5.0f, 2000.0f}, {2.0f * SONAR_SLOT_MS, 2000.0f}, {40.0f, 2000.0f}

/* The built-in periods, in the settings' order. */
void streams_built_in(float *values);

bool streams_is_period(uint8_t stream, float period_ms);

/* Bytes in 2 s: the streams, both boards' status, power, last words, and a driver's commands. Periods must be sound. */
uint16_t streams_load(const float periods_ms[STREAM_COUNT]);

#endif

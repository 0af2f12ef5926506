/* SPDX-License-Identifier: Apache-2.0
 *
 * Eight GP2D12 infra-red rangefinders: three ADC readings of each per frame, of which the middle one counts, since the
 * sensors' own light pulses make the supply spike upwards. 25 times a second: a GP2D12 measures about as
 * often. They are read so whatever part of it is told, since the watchdog wants to see readings.
 */
#ifndef CRUNCH_SENSOR_INFRARED_H
#define CRUNCH_SENSOR_INFRARED_H

#include "../link/channels.h"

#include <stdbool.h>
#include <stdint.h>

#define INFRARED_PERIOD_MS 40
#define INFRARED_SAMPLES 3
#define INFRARED_SPACING_MS 2 /* between the readings of one frame */

struct infrared {
    uint16_t told_ms;  /* period of the frames that are told, a multiple of INFRARED_PERIOD_MS */
    uint32_t frame_ms; /* when this frame's first reading was due */
    uint8_t samples;   /* taken in this frame so far */
    uint16_t readings[INFRARED_SAMPLES][INFRARED_COUNT];
};

void infrared_init(struct infrared *infrared);

/* Called every ms; true when all eight are to be read now and given to infrared_add. */
bool infrared_tick(struct infrared *infrared, uint32_t now_ms);

/* Takes one set of readings; true when it completed a frame that is to be told, which is then in `*done`,
 * stamped `*done_ms`. */
bool infrared_add(struct infrared *infrared, const uint16_t counts[INFRARED_COUNT], struct infrared_payload *done,
                  uint32_t *done_ms);

#endif

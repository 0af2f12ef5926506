/* SPDX-License-Identifier: Apache-2.0 */
#include "adjust.h"

#include "crc.h"
#include "seal.h"

#include <stddef.h>
#include <string.h>

enum adjust_judgement adjust_of_frame(const struct frame *frame, uint8_t board, uint32_t uptime_ms,
                                      struct adjustment *adjustment)
{
    const uint8_t *payload = frame->payload;
    if (frame->source != SOURCE_HOST || frame->channel != CHANNEL_ADJUST)
        return ADJUST_ELSEWHERE;
    if (!seal_is_intact(frame, sizeof(struct adjust_payload)))
        return ADJUST_REFUSED;
    if (payload[offsetof(struct adjust_payload, board)] != board)
        return ADJUST_ELSEWHERE;
    if (!seal_is_fresh(seal_get16(payload + offsetof(struct adjust_payload, echo_ms)), uptime_ms))
        return ADJUST_REFUSED;
    adjustment->verb = payload[offsetof(struct adjust_payload, verb)];
    adjustment->setting = payload[offsetof(struct adjust_payload, setting)];
    adjustment->sequence = frame->sequence;
    memcpy(&adjustment->value, payload + offsetof(struct adjust_payload, value), sizeof adjustment->value);
    return ADJUST_GOOD;
}

void adjust_answer(const struct adjuster *adjuster, struct teller *teller, const struct adjustment *adjustment,
                   enum adjust_outcome outcome, float value)
{
    struct setting_payload payload = {
        .verb = adjustment->verb,
        .setting = adjustment->setting,
        .sequence = adjustment->sequence,
        .outcome = (uint8_t)outcome,
        .record = adjuster->settings.record,
        .is_stored = settings_is_stored(&adjuster->settings, adjustment->setting),
        .value = value,
    };
    payload.check = crc32_of((const uint8_t *)&payload, offsetof(struct setting_payload, check));
    teller_tell(teller, CHANNEL_SETTING, teller->uptime_ms, &payload, sizeof payload);
}

static void answer_setting(const struct adjuster *adjuster, struct teller *teller,
                           const struct adjustment *adjustment, enum adjust_outcome outcome)
{
    const struct settings *settings = &adjuster->settings;
    const bool is_known = adjustment->setting < settings->count;
    adjust_answer(adjuster, teller, adjustment, is_known ? outcome : OUTCOME_UNKNOWN,
                  is_known ? settings->values[adjustment->setting] : 0.0f);
}

void adjust_obey(struct adjuster *adjuster, struct teller *teller, const struct adjustment *adjustment)
{
    struct settings *settings = &adjuster->settings;
    switch (adjustment->verb) {
    case VERB_ASK:
        answer_setting(adjuster, teller, adjustment, OUTCOME_DONE);
        break;
    case VERB_SET:
        answer_setting(adjuster, teller, adjustment, settings_set(settings, adjustment->setting, adjustment->value));
        break;
    case VERB_STORE:
        adjuster->storing = *adjustment;
        settings_store(settings);
        break;
    case VERB_BUILT_IN:
        settings_reset(settings);
        adjust_answer(adjuster, teller, adjustment, OUTCOME_DONE, 0.0f);
        break;
    default:
        adjust_answer(adjuster, teller, adjustment, OUTCOME_UNKNOWN, 0.0f);
    }
}

void adjust_did(struct adjuster *adjuster, struct teller *teller, uint8_t found)
{
    if (!settings_did(&adjuster->settings, found))
        return;
    const bool is_sound = adjuster->settings.record == RECORD_SOUND;
    adjust_answer(adjuster, teller, &adjuster->storing, is_sound ? OUTCOME_DONE : OUTCOME_MEMORY, 0.0f);
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "power.h"

#define FULL_SCALE (1023L * POWER_READINGS)
#define DIVIDER_FULL_MV 40000L
#define HALL_FULL_MA 50000L /* 5 V at 100 mV per A; its middle is no current */
#define SENSE_FULL_MA 6028L /* 5 V over 2.2 kohm x 377 uA per A */
#define CHARGER_PRESENT_MV 5000u

static uint16_t scaled(uint16_t sum, int32_t full)
{
    return (uint16_t)(((int32_t)sum * full + FULL_SCALE / 2) / FULL_SCALE);
}

static int16_t motor_ma(uint16_t sum, bool is_reverse)
{
    const int16_t magnitude = (int16_t)scaled(sum, SENSE_FULL_MA);
    return is_reverse ? (int16_t)-magnitude : magnitude;
}

struct supplies power_supplies(const struct supply_sums *sums, const bool is_reverse[2])
{
    const int16_t drawn = (int16_t)((int32_t)scaled(sums->current, HALL_FULL_MA) - HALL_FULL_MA / 2);
    struct supplies supplies = {
        .battery_mv = scaled(sums->battery, DIVIDER_FULL_MV),
        .charger_mv = scaled(sums->charger, DIVIDER_FULL_MV),
        .battery_ma = drawn,
    };
    if (supplies.charger_mv > CHARGER_PRESENT_MV && drawn < 0)
        supplies.charger_ma = (int16_t)-drawn;
    for (uint8_t i = 0; i < 2; i++)
        supplies.motor_ma[i] = motor_ma(sums->motors[i], is_reverse[i]);
    return supplies;
}

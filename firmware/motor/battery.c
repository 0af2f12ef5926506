/* SPDX-License-Identifier: Apache-2.0 */
#include "battery.h"

#define BATTERY_FULL_SCALE (1023L * BATTERY_READINGS)
#define BATTERY_FULL_MV 20000L

uint16_t battery_mv(uint16_t sum)
{
    return (uint16_t)(((int32_t)sum * BATTERY_FULL_MV + BATTERY_FULL_SCALE / 2) / BATTERY_FULL_SCALE);
}

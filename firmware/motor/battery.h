/* SPDX-License-Identifier: Apache-2.0
 *
 * The motor board's battery, three cells of lithium polymer over a divider of 1:4: 10 bits cover 20 V. Pure, in whole
 * numbers.
 */
#ifndef CRUNCH_MOTOR_BATTERY_H
#define CRUNCH_MOTOR_BATTERY_H

#include <stdint.h>

#define BATTERY_READINGS 5 /* ADC readings summed, 0 to 1023 each */

uint16_t battery_mv(uint16_t sum);

#endif

/* SPDX-License-Identifier: Apache-2.0
 *
 * Battery, charger and motors in mV and mA, from the drive board's ADC. Pure, in whole numbers.
 *
 * The voltages come over dividers of 1:8, so that 10 bits cover 40 V. The battery's current is a Hall sensor's: 2.5 V
 * at rest, 100 mV per A, positive out of the battery. The bridges' sense outputs (377 uA per A into 2.2 kohm) tell a
 * motor's current without its sign, which is taken to be the duty's.
 */
#ifndef CRUNCH_DRIVE_POWER_H
#define CRUNCH_DRIVE_POWER_H

#include <stdbool.h>
#include <stdint.h>

#define POWER_READINGS 5 /* ADC readings summed */

struct supplies {
    uint16_t battery_mv, charger_mv;
    int16_t battery_ma, charger_ma; /* drawn from the battery; fed into it by the charger */
    int16_t motor_ma[2];            /* left and right */
};

struct supply_sums { /* of POWER_READINGS readings each, 0 to 1023 */
    uint16_t battery, current, charger;
    uint16_t motors[2];
};

/* `is_reverse` is each motor's direction of drive. */
struct supplies power_supplies(const struct supply_sums *sums, const bool is_reverse[2]);

#endif

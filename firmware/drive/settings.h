/* SPDX-License-Identifier: Apache-2.0
 *
 * What can be adjusted on the drive board, and how far. The bounds leave room for another body, not for a slip of the
 * hand: gains up to four times the built-in ones, those of the lean no less than a fifth. The filter's time constant
 * stays where it was seen to stand; the level is as far as an accelerometer may be soldered askew.
 *
 * The gyro's zero is none of them: it moves with temperature, and is learned anew before each arming whatever was stored.
 */
#ifndef CRUNCH_DRIVE_SETTINGS_H
#define CRUNCH_DRIVE_SETTINGS_H

#include "../link/settings.h"

#define DRIVE_SETTINGS 13

/* The built-in ones. */
void drive_settings_init(struct settings *settings);

#endif

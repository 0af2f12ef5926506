/* SPDX-License-Identifier: Apache-2.0
 *
 * Small sums on floats. With them as single bits absolute value and sign take less flash than comparisons.
 */
#ifndef CRUNCH_DRIVE_ARITHMETIC_H
#define CRUNCH_DRIVE_ARITHMETIC_H

float magnitude(float value);

float greater(float a, float b);

/* Between -limit and limit. */
float limited(float value, float limit);

#endif

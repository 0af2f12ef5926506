/* SPDX-License-Identifier: Apache-2.0
 *
 * Small sums on floats. As single bits, by the compiler's own hand, absolute value and sign take less flash than as
 * comparisons.
 */
#ifndef CRUNCH_DRIVE_ARITHMETIC_H
#define CRUNCH_DRIVE_ARITHMETIC_H

float magnitude(float value);

float greater(float a, float b);

/* Between -limit and limit. */
float limited(float value, float limit);

#endif

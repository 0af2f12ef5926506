/* SPDX-License-Identifier: Apache-2.0 */
#include "arithmetic.h"

#include <math.h>

float magnitude(float value)
{
    return fabsf(value);
}

float greater(float a, float b)
{
    return a > b ? a : b;
}

float limited(float value, float limit)
{
    return fabsf(value) > limit ? copysignf(limit, value) : value;
}

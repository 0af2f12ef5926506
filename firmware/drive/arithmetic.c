/* SPDX-License-Identifier: Apache-2.0 */
#include "arithmetic.h"

float magnitude(float value)
{
    return __builtin_fabsf(value);
}

float greater(float a, float b)
{
    return a > b ? a : b;
}

float limited(float value, float limit)
{
    return __builtin_fabsf(value) > limit ? __builtin_copysignf(limit, value) : value;
}

/* SPDX-License-Identifier: Apache-2.0 */
#include "agreement.h"

#include "arithmetic.h"

#define GRAVITY 9.81f /* m/s2 */

void agreement_rest(struct agreement *agreement, float speed)
{
    agreement->wheels = agreement->body = 0.0f;
    agreement->speed = speed;
}

void agreement_step(struct agreement *agreement, float speed, float tilt, float tilt_of_gravity)
{
    agreement->wheels += speed - agreement->speed - agreement->wheels * (AGREEMENT_DT / AGREEMENT_TIME);
    agreement->body += (tilt - tilt_of_gravity) * (GRAVITY * AGREEMENT_DT) -
                       agreement->body * (AGREEMENT_DT / AGREEMENT_TIME);
    agreement->speed = speed;
}

enum accord agreement_judge(const struct agreement *agreement)
{
    if (magnitude(agreement->wheels - agreement->body) < AGREEMENT_LIMIT)
        return ACCORD;
    return magnitude(agreement->wheels) > magnitude(agreement->body) ? ACCORD_WHEELS_ALONE : ACCORD_BODY_ALONE;
}

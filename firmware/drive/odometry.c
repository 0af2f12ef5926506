/* SPDX-License-Identifier: Apache-2.0 */
#include "odometry.h"

/* Gains of the tracking filter, critically damped at about 60 rad/s. */
#define FOLLOW_LAG 0.5f
#define FOLLOW_SPEED 0.09f

static void tracker_step(struct tracker *tracker, float distance)
{
    tracker->lag += distance - tracker->speed * ODOMETRY_DT;
    tracker->speed += tracker->lag * (FOLLOW_SPEED / ODOMETRY_DT);
    tracker->lag -= tracker->lag * FOLLOW_LAG;
}

void odometry_init(struct odometry *odometry, uint16_t left_ticks, uint16_t right_ticks)
{
    odometry->left_ticks = left_ticks;
    odometry->right_ticks = right_ticks;
    odometry->forward.speed = odometry->forward.lag = 0.0f;
    odometry->turn.speed = odometry->turn.lag = 0.0f;
}

struct rolled odometry_step(struct odometry *odometry, uint16_t left_ticks, uint16_t right_ticks, float tilt_rate)
{
    const float left = (float)(int16_t)(uint16_t)(left_ticks - odometry->left_ticks) * ODOMETRY_METRES_PER_TICK;
    const float right = (float)(int16_t)(uint16_t)(right_ticks - odometry->right_ticks) * ODOMETRY_METRES_PER_TICK;
    odometry->left_ticks = left_ticks;
    odometry->right_ticks = right_ticks;
    const float against_body = 0.5f * (left + right);
    const float angle = (right - left) / ODOMETRY_TRACK;
    tracker_step(&odometry->forward, against_body);
    tracker_step(&odometry->turn, angle);
    const float body_speed = ODOMETRY_WHEEL_RADIUS * tilt_rate;
    const struct rolled rolled = {
        .distance = against_body + body_speed * ODOMETRY_DT,
        .speed = odometry->forward.speed + body_speed,
        .angle = angle,
        .turn_rate = odometry->turn.speed,
    };
    return rolled;
}

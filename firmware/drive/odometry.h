/* SPDX-License-Identifier: Apache-2.0
 *
 * Motion over the floor from the wheels' ticks and the lean.
 *
 * The encoders see the wheels against the body, so that a wheel rolls radius x (its turn against the body + tilt). One
 * tick per 5 ms is 64 mm/s: speeds come from a tracking filter, never from a difference. Distances in m, angles in rad.
 */
#ifndef CRUNCH_DRIVE_ODOMETRY_H
#define CRUNCH_DRIVE_ODOMETRY_H

#include <stdint.h>

#define ODOMETRY_DT 0.005f
#define ODOMETRY_WHEEL_RADIUS 0.0508f
#define ODOMETRY_TRACK 0.19f
#define ODOMETRY_TICKS_PER_TURN 1000
#define ODOMETRY_METRES_PER_TICK (6.2831853f * ODOMETRY_WHEEL_RADIUS / (float)ODOMETRY_TICKS_PER_TURN)

/* A distance followed by its speed: `lag` is how far the measured distance is ahead of the tracked one. */
struct tracker {
    float speed;
    float lag;
};

struct odometry {
    uint16_t left_ticks; /* counters as read at the last step; they wrap */
    uint16_t right_ticks;
    struct tracker forward; /* against the body */
    struct tracker turn;
};

/* What one step found: how far it rolled and turned, and how fast it does. */
struct rolled {
    float distance;
    float speed;
    float angle;
    float turn_rate;
};

/* Starts with the counters where they are. */
void odometry_init(struct odometry *odometry, uint16_t left_ticks, uint16_t right_ticks);

/* One step of 5 ms. `tilt_rate` (rad/s) turns wheel-against-body into wheel-on-floor. */
struct rolled odometry_step(struct odometry *odometry, uint16_t left_ticks, uint16_t right_ticks, float tilt_rate);

#endif

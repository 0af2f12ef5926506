/* SPDX-License-Identifier: Apache-2.0
 *
 * Whether the sensors tell one motion. The wheels' change of speed and what accelerometer and gyro together make of the
 * body's acceleration are two accounts of the same over short times; where they part, the floor is gone from under the
 * wheels, or a sensor lies. Pure: no registers, no globals; the host's build gives the same bits.
 */
#ifndef CRUNCH_DRIVE_AGREEMENT_H
#define CRUNCH_DRIVE_AGREEMENT_H

#define AGREEMENT_DT 0.005f  /* s between steps */
#define AGREEMENT_TIME 0.5f  /* s over which a speed is remembered */
#define AGREEMENT_LIMIT 0.6f /* m/s; pushes of up to 2.5 N s stay below 0.45 */

struct agreement { /* speeds gained lately, m/s, forward positive */
    float wheels;  /* over the floor, as the wheels tell */
    float body;    /* as accelerometer and gyro do */
    float speed;   /* the wheels' at the last step */
};

enum accord { ACCORD, ACCORD_WHEELS_ALONE, ACCORD_BODY_ALONE };

/* Begins at a speed of the wheels over the floor (m/s). */
void agreement_rest(struct agreement *agreement, float speed);

/* One step: the wheels' speed over the floor (m/s), the lean as estimated and as gravity alone shows it (rad). */
void agreement_step(struct agreement *agreement, float speed, float tilt, float tilt_of_gravity);

/* Whether the two agree, or which of them alone tells of motion. A gyro that suddenly shows much too much makes the robot
 * run, as if its wheels were alone. */
enum accord agreement_judge(const struct agreement *agreement);

#endif

/* SPDX-License-Identifier: Apache-2.0
 *
 * The virtual Crunch: body, sensors and the two boards, advanced together one millisecond at a time.
 *
 * A scripted robot has no physics: wheel rotations and true poses are given every 20 ms, the rest is the same.
 */
#ifndef CRUNCH_VIRTUAL_ROBOT_H
#define CRUNCH_VIRTUAL_ROBOT_H

#include "boards.h"
#include "sensors.h"

#define ROBOT_WIRE_BYTES 8192
#define ROBOT_MAX_ADVANCE_MS 1000 /* what fits the two buffers surely */
#define ROBOT_TRUTH_ROWS 64
#define ROBOT_SCRIPT_MS 20

struct truth { /* where the robot was when an odometry frame was sampled */
    double time, x, y, heading;
};

struct script {
    const double *rolled; /* (count, 2): m that left and right wheel have rolled */
    const double *poses;  /* (count, 3), headings continuous */
    int32_t count;        /* 0: not scripted */
};

struct robot {
    uint64_t now_ms;   /* since the boards were switched on */
    uint64_t start_ms; /* where simulated time begins */
    struct body body;
    double duties[2]; /* that the motors have; the board's come to them a ms later */
    struct gyro_and_accelerometer inertial;
    struct rangefinders rangefinders;
    struct drive_board drive;
    struct sensor_board sensor;
    struct script script;
    double sonar_ranges[SENSOR_COUNT];
    double infrared_distances[SENSOR_COUNT];
    double charger_volts;
    struct outbox outbox; /* both boards share it */
    uint16_t taken;       /* bytes of it that the last advance gave */
    uint8_t bytes[ROBOT_WIRE_BYTES];
    struct truth truth[ROBOT_TRUTH_ROWS];
    int32_t truth_rows;
};

/* A robot held upright by a hand at a pose. The walls and the script's arrays must outlive it. */
void robot_init(struct robot *robot, const struct caster *walls, const double pose[3], uint64_t seed, uint16_t build);

/* Makes it a scripted one. */
void robot_script(struct robot *robot, const double *rolled, const double *poses, int32_t count);

/* Asks the drive board to arm, as a person's command would; the hand lets go when it has. False if it does not arm. */
bool robot_stand(struct robot *robot);

/* Forgets the bytes and truths taken, then advances by `ms`, at most ROBOT_MAX_ADVANCE_MS. */
void robot_advance(struct robot *robot, int32_t ms);

void robot_receive(struct robot *robot, const uint8_t *bytes, int32_t count);

/* Somebody presses reset on both boards; their EEPROMs stay. */
void robot_reset_boards(struct robot *robot);

/* A wish from the plan's driver, handed to the drive board as if it had come in a valid command. */
void robot_steer(struct robot *robot, double speed, double turn);

struct place robot_place(const struct robot *robot);

/* s since simulated time began. */
double robot_time(const struct robot *robot);

#endif

/* SPDX-License-Identifier: Apache-2.0
 *
 * The virtual Crunch with its real boards: two ATmega32 under simavr, wired to the same body and sensors as the host's
 * build, and to one modem. Advanced one millisecond at a time, the drive board first, so that GRANT, the only wire
 * between the boards, arrives in its very cycle.
 */
#ifndef CRUNCH_VIRTUAL_AVR_ROBOT_H
#define CRUNCH_VIRTUAL_AVR_ROBOT_H

#include "bystander.h"
#include "imu_part.h"
#include "microcontroller.h"

#define AVR_ROBOT_BYTES 8192
#define AVR_ROBOT_EDGES 8  /* of GRANT in one ms */
#define AVR_ROBOT_RECENT 8 /* bytes of each board that the other's are compared with */

struct grant_edge {
    uint64_t cycle;
    bool level;
};

struct avr_robot {
    uint64_t now_ms;   /* since the boards were switched on */
    uint64_t start_ms; /* where simulated time begins */
    struct body body;
    struct gyro_and_accelerometer inertial; /* on the converter, and */
    struct imu_part imu;                    /* on the bus: the program reads the one or the other */
    struct rangefinders rangefinders;
    struct microcontroller *drive, *sensor;
    double infrared_distances[SENSOR_COUNT];
    double charger_volts;
    uint8_t forced;                /* set of the drive board's ADC inputs that show these volts, whatever is */
    double forced_volts[8];
    uint8_t muted;                 /* boards whose transmitter is dead: 1 drive, 2 sensor, 3 both */
    uint16_t accelerometer;        /* reading that belongs to the gyro's last one */
    uint16_t infrared_sweeps;      /* since the distances were looked at */
    struct grant_edge grants[AVR_ROBOT_EDGES];
    int32_t grant_count;
    struct sent_byte recent[2][AVR_ROBOT_RECENT];
    uint32_t sent[2];              /* bytes ever sent, drive and sensor */
    uint32_t collisions;           /* bytes that overlapped one of the other board's */
    struct grant_edge last_rise, last_fall;
    uint32_t drive_starts;         /* of the drive board, as heard of */
    uint32_t trespasses;           /* bytes of the drive board on the line while it granted it */
    struct bystander bystander;
    uint64_t steer_ms;             /* when the plan's driver may command again */
    bool has_crashed;
    int32_t size;                  /* of `bytes`: what the modem took since the last advance */
    uint8_t bytes[AVR_ROBOT_BYTES];
};

/* A robot held upright by a hand at a pose. NULL if a program cannot be read. The walls must outlive it. */
struct avr_robot *avr_robot_new(const char *drive_elf, const char *sensor_elf, const struct caster *walls,
                                const double pose[3], uint64_t seed);
void avr_robot_free(struct avr_robot *robot);

/* Asks the drive board to arm, as a person's command would; the hand lets go when it has. Time begins with an odometry
 * and a silent line. False if it does not arm. */
bool avr_robot_stand(struct avr_robot *robot);

/* A wish from the plan's driver, which reaches the boards' receivers as a valid command ten times a second, whatever the
 * radio does. */
void avr_robot_steer(struct avr_robot *robot, double speed, double turn);

/* Forgets the bytes and truths taken, then advances by `ms`, at most 1000. False once a program has crashed. */
bool avr_robot_advance(struct avr_robot *robot, int32_t ms);

/* Bytes from the host, to both boards. */
void avr_robot_receive(struct avr_robot *robot, const uint8_t *bytes, int32_t count);

/* Duties that the bridges get, -1 to 1, left and right; 0 while BRAKE is high. */
void avr_robot_duties(const struct avr_robot *robot, double duties[2]);

#endif

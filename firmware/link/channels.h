/* SPDX-License-Identifier: Apache-2.0
 *
 * The one source of the wire format: who speaks, what each channel carries, and in which bytes.
 *
 * A frame, before COBS and the zero delimiter:
 *
 *     byte 0        source << 6 | channel
 *     byte 1        sequence, counted per source, wraps at 256
 *     bytes 2-3     board time in ms when the payload was sampled, little-endian, wraps at 65536
 *     bytes 4..n-3  payload: exactly the packed structure of the channel, little-endian
 *     last two      CRC-16/MCRF4XX of all bytes before it, little-endian
 *
 * Numbers are raw: ADC counts, microseconds of echo, encoder ticks. Calibration belongs to the host's configuration.
 * The Python table (server/channels.py) is checked against this header by the compiler.
 */
#ifndef CRUNCH_LINK_CHANNELS_H
#define CRUNCH_LINK_CHANNELS_H

#include <stdint.h>

#define LINK_PROTOCOL_VERSION 1

/* Two bits: the only board of a small robot is 3, Maze Runner's motor board and the bumper cart's board alike. */
enum link_source { SOURCE_HOST = 0, SOURCE_DRIVE = 1, SOURCE_SENSOR = 2, SOURCE_MOTOR = 3, SOURCE_CART = 3 };

enum link_channel {
    CHANNEL_STATUS = 1,   /* any board, 1 Hz */
    CHANNEL_ODOMETRY = 2, /* drive board, 50 Hz */
    CHANNEL_BALANCE = 3,  /* drive board, 2 Hz, and at once when the state changes */
    CHANNEL_POWER = 4,    /* drive board, 1 Hz */
    CHANNEL_SONAR = 5,    /* sensor board, 12.5 Hz */
    CHANNEL_INFRARED = 6, /* sensor board, 25 Hz */
    CHANNEL_SETTING = 7,  /* either board: the answer to an adjustment */
    CHANNEL_LAST_WORDS = 8, /* drive board, 1 Hz after a start that left its memory intact */
    CHANNEL_MOTORS = 9,   /* motor board, 50 Hz */
    CHANNEL_CART = 10,    /* cart's board, 10 Hz */
    CHANNEL_STAGE = 11,   /* cart's board: a stage, as it ends, and again when it is asked for */
    CHANNEL_DRIVE = 16,   /* host: speed and turn rate; refreshed at 10 Hz while a driver holds the stick */
    CHANNEL_STOP = 17,    /* host: speed and turn to zero at once; sent three times */
    CHANNEL_ARM = 18,     /* host: let the drive board arm once it stands upright; 0 disarms */
    CHANNEL_ADJUST = 19,  /* host: a setting of one board asked for or changed, all of them stored, the gyro zeroed */
    CHANNEL_POWERS = 20,  /* host: the powers of the motor board's motors, and for how long */
    CHANNEL_RUN = 21,     /* host: the cart begins a run */
    CHANNEL_UPLOAD = 22   /* host: the cart tells stages of its log */
};

#define SONAR_COUNT 8
#define INFRARED_COUNT 8
#define SONAR_SLOT_MS 40     /* even sonars fire at the frame's time, odd ones one slot later */
#define SONAR_NO_RETURN 0xFFFF
#define MOTOR_FULL_POWER 10000
#define MOTOR_LONGEST_MS 1000 /* deadline */

enum drive_state { DRIVE_DISARMED = 0, DRIVE_ARMED = 1, DRIVE_FALLEN = 2, DRIVE_LINK_LOST = 3, DRIVE_FAULT = 4 };

enum stop_reason {
    STOP_NONE = 0, STOP_COMMAND = 1, STOP_FELL = 2, STOP_LINK = 3, STOP_STALL = 4,
    STOP_CURRENT = 5, STOP_BATTERY = 6, STOP_SENSOR = 7, STOP_CHARGER = 8, STOP_BOOT = 9,
    STOP_BLOCKED = 10, STOP_LIFTED = 11, STOP_DISAGREEMENT = 12,
    STOP_WATCHDOG = 13
};

/* What may be adjusted. Both boards have the streams' periods, whole ms; the drive board has all. */
enum link_setting {
    SETTING_ODOMETRY_MS = 0, SETTING_BALANCE_MS = 1, SETTING_SONAR_MS = 2, SETTING_INFRARED_MS = 3,
    SETTING_TILT = 4,          /* gains of the balance law (drive/balance.h): 1/rad, */
    SETTING_TILT_RATE = 5,     /* s/rad, */
    SETTING_SPEED = 6,         /* s/m, */
    SETTING_POSITION = 7,      /* 1/m, */
    SETTING_TURN_RATE = 8,     /* s/rad, */
    SETTING_HEADING = 9,       /* 1/rad, */
    SETTING_FEED_TURN = 10,    /* s/rad */
    SETTING_TIME_CONSTANT = 11, /* s, of the complementary filter */
    SETTING_LEVEL = 12         /* g that the accelerometer shows while the robot is upright */
};

enum adjust_verb { VERB_ASK = 0, VERB_SET = 1, VERB_STORE = 2, VERB_BUILT_IN = 3, VERB_ZERO_GYRO = 4, VERB_LEVEL = 5 };

enum adjust_outcome {
    OUTCOME_DONE = 0,
    OUTCOME_UNKNOWN = 1, /* this board has no such setting, or does no such thing */
    OUTCOME_BOUNDS = 2,  /* the value is no number, or beyond the setting's bounds */
    OUTCOME_BUDGET = 3,  /* the streams would take half of the line or more */
    OUTCOME_MOVING = 4,  /* gyro and level are learned at rest only, and not while balancing */
    OUTCOME_MEMORY = 5   /* the EEPROM did not keep what was written */
};

enum record_state { /* of the settings in the EEPROM */
    RECORD_NONE = 0,    /* erased: the built-in settings were in force at the start */
    RECORD_SOUND = 1,
    RECORD_SPOILED = 2, /* its checksum is wrong or a value out of bounds: as with none */
    RECORD_WRITING = 3
};

#define PACKED __attribute__((packed))

struct PACKED status_payload {
    uint8_t version;       /* LINK_PROTOCOL_VERSION; the host refuses others */
    uint8_t state;         /* enum drive_state; 0 on the sensor board */
    uint8_t reason;        /* enum stop_reason of the last stop */
    uint8_t reset_cause;   /* MCUCSR at boot */
    uint32_t uptime_ms;    /* unwraps the frames' 16-bit time */
    uint16_t boot_count;
    uint16_t worst_loop_us;
    uint16_t rx_errors;    /* frames from the host refused since boot */
    uint16_t build;        /* low bits of the build's identity */
};

struct PACKED odometry_payload {
    int16_t left_ticks;    /* wheel against body, wraps */
    int16_t right_ticks;
    int16_t tilt;          /* 0.1 mrad, forward positive */
};

struct PACKED balance_payload {
    int16_t tilt_rate;     /* mrad/s */
    int16_t position_error; /* mm, commanded minus actual */
    int8_t left_duty;      /* -127 to 127 is full reverse to full forward */
    int8_t right_duty;
    uint8_t state;
    uint8_t reason;
    uint8_t acknowledged;  /* sequence of the last command accepted */
};

struct PACKED power_payload {
    uint16_t battery_mv;
    int16_t battery_ma;
    uint16_t charger_mv;
    int16_t charger_ma;
    int16_t left_motor_ma;
    int16_t right_motor_ma;
};

struct PACKED last_words_payload { /* of the run that ended in the last reset */
    uint8_t state;         /* at its end */
    uint8_t reason;        /* of its last stop, or why it could not move, */
    uint32_t since_ms;     /* and its uptime when state or reason last changed */
    uint32_t uptime_ms;    /* at its last whole step */
};

struct PACKED sonar_payload {
    uint16_t echo_us[SONAR_COUNT]; /* trigger to echo, there and back; SONAR_NO_RETURN */
};

struct PACKED infrared_payload {
    uint16_t counts[INFRARED_COUNT]; /* 10-bit ADC */
};

struct PACKED motors_payload {
    int16_t left_power;    /* applied now: -MOTOR_FULL_POWER to MOTOR_FULL_POWER is full reverse to full forward */
    int16_t right_power;
    uint16_t battery_mv;
    uint8_t state;
    uint8_t reason;
    uint8_t acknowledged;  /* sequence of the last command accepted */
};

struct PACKED cart_payload {
    int16_t left_ticks;    /* counters; wrap */
    int16_t right_ticks;
    uint16_t battery_mv;
    uint16_t logged;       /* stages of this run so far */
    uint16_t bumps;        /* of this run */
    uint8_t doing;         /* enum cart_state (cart/program.h) */
    uint8_t bumper;        /* switches closed now: 1 left, 2 middle, 4 right */
    uint8_t run;           /* counted since boot; wraps */
    uint8_t state;         /* enum drive_state */
    uint8_t reason;        /* enum stop_reason of the last stop; none also when a run came to its end */
    uint8_t acknowledged;  /* sequence of the last command accepted */
};

struct PACKED stage_payload {
    uint16_t number;       /* in its run's log */
    uint8_t run;
    uint8_t kind;          /* enum cart_stage_kind (cart/program.h) */
    uint8_t bumper;        /* switches closed at its end */
    uint8_t is_kept;       /* 0: it ends now; 1: told again, from the log */
    int16_t left;          /* ticks, negative backward */
    int16_t right;
};

struct PACKED setting_payload {
    uint8_t verb;          /* of the adjustment that is answered, */
    uint8_t setting;
    uint8_t sequence;      /* and the number of its frame */
    uint8_t outcome;       /* enum adjust_outcome */
    uint8_t record;        /* enum record_state */
    uint8_t is_stored;     /* 1: the record holds this setting's value */
    float value;           /* in force; after VERB_ZERO_GYRO the zero, rad/s */
    uint32_t check;        /* CRC-32 as in commands */
};

/* Commands carry a second, stronger checksum and the board's own last time as an echo, so that neither noise nor a
 * command that was long under way can move the robot. The CRC-32 (zlib's) covers the payload before it. */
struct PACKED drive_payload {
    int16_t speed;         /* mm/s */
    int16_t turn;          /* mrad/s, counter-clockwise positive */
    uint16_t echo_ms;      /* the drive board's newest frame time that the host has seen */
    uint32_t check;
};

struct PACKED stop_payload {
    uint16_t echo_ms;      /* not judged: a stop is never too old */
    uint32_t check;
};

struct PACKED arm_payload {
    uint16_t arm;          /* 1 arms, 0 disarms */
    uint16_t echo_ms;
    uint32_t check;
};

struct PACKED powers_payload {
    int16_t left;          /* as in motors_payload; beyond full is refused */
    int16_t right;
    uint16_t deadline_ms;  /* the motors stop after it; 0 is refused, what is longer than the longest becomes that */
    uint16_t echo_ms;      /* the motor board's newest frame time that the host has seen */
    uint32_t check;
};

#define RUN_MATCHED 1u     /* both wheels are kept at the same count; else each motor has the same power; */
#define RUN_COARSE 2u      /* by eight powers, five times a second */

struct PACKED run_payload {
    uint16_t bumps;        /* after which the cart stands; 0: until it is stopped */
    uint16_t seed;         /* of its random turns */
    uint8_t manner;        /* RUN_MATCHED, RUN_COARSE; other bits are refused */
    uint8_t leash_s;       /* it stops when it has not heard a command for so long; 0: it needs no host */
    uint16_t echo_ms;      /* the cart's newest frame time that the host has seen */
    uint32_t check;
};

struct PACKED upload_payload {
    uint16_t first;        /* number of a stage in this run's log; what is kept no longer is left out */
    uint16_t count;
    uint16_t echo_ms;
    uint32_t check;
};

struct PACKED adjust_payload {
    uint8_t board;         /* the one that is meant, by its enum link_source */
    uint8_t verb;          /* enum adjust_verb */
    uint8_t setting;       /* enum link_setting, of VERB_ASK and VERB_SET */
    float value;           /* of VERB_SET */
    uint16_t echo_ms;      /* newest time seen in a frame of the board that is meant */
    uint32_t check;
};

#define LINK_MAX_PAYLOAD 24
#define LINK_MAX_FRAME (4 + LINK_MAX_PAYLOAD + 2)
#define LINK_MAX_ENCODED (LINK_MAX_FRAME + 2) /* COBS adds one byte below 254, and the delimiter */

_Static_assert(sizeof(struct status_payload) == 16, "packed");
_Static_assert(sizeof(struct odometry_payload) == 6, "packed");
_Static_assert(sizeof(struct balance_payload) == 9, "packed");
_Static_assert(sizeof(struct power_payload) == 12, "packed");
_Static_assert(sizeof(struct last_words_payload) == 10, "packed");
_Static_assert(sizeof(struct sonar_payload) == 16, "packed");
_Static_assert(sizeof(struct infrared_payload) == 16, "packed");
_Static_assert(sizeof(struct motors_payload) == 9, "packed");
_Static_assert(sizeof(struct cart_payload) == 16, "packed");
_Static_assert(sizeof(struct stage_payload) == 10, "packed");
_Static_assert(sizeof(struct run_payload) == 12, "packed");
_Static_assert(sizeof(struct upload_payload) == 10, "packed");
_Static_assert(sizeof(struct drive_payload) == 10, "packed");
_Static_assert(sizeof(struct stop_payload) == 6, "packed");
_Static_assert(sizeof(struct arm_payload) == 8, "packed");
_Static_assert(sizeof(struct powers_payload) == 12, "packed");
_Static_assert(sizeof(struct setting_payload) == 14, "packed");
_Static_assert(sizeof(struct adjust_payload) == 13, "packed");
_Static_assert(sizeof(float) == 4, "single, on both machines");

#endif

"""Payloads to messages and commands to payloads: the one place where raw counts become SI units.

One row per channel of firmware/link/channels.h, against which the compiler checks the table. The exact length of a
payload and the limits of what a sensor can say are the second sieve after the CRC-16: about one noise packet in 65,536
passes the first.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Container
from functools import cached_property
from typing import NamedTuple

import numpy as np
from pydantic import Field

from server.commands import (
    AdjustCommand,
    ArmCommand,
    Command,
    DriveCommand,
    PowersCommand,
    RunCommand,
    StopCommand,
    UploadCommand,
)
from server.link import Frame
from server.messages import Balance, Cart, CartStage, LastWords, Message, Motors, Power, Ranges, Setting, Status, Wheels
from slam.cart_odometry import Stage
from slam.params import Params

PROTOCOL_VERSION = 1
VERSION_BYTE = bytes((PROTOCOL_VERSION,))
HOST, DRIVE, SENSOR, MOTOR = 0, 1, 2, 3
CART = MOTOR  # two bits name who speaks: the only board of a small robot is number 3
SOURCES = {HOST: "host", DRIVE: "drive", SENSOR: "sensor", MOTOR: "motor"}
DRIVERS = (DRIVE, MOTOR)  # the boards that move their robots; a robot has one of them
STATES = ("disarmed", "armed", "fallen", "link lost", "fault")
REASONS = (
    "none", "command", "fell", "link", "stall", "current", "battery", "sensor", "charger", "boot",
    "blocked", "lifted", "disagreement", "watchdog",
)  # fmt: skip
SETTINGS = (
    "odometry_ms", "balance_ms", "sonar_ms", "infrared_ms", "tilt", "tilt_rate", "speed", "position", "turn_rate",
    "heading", "feed_turn", "time_constant", "level",
)  # fmt: skip
STREAMS = SETTINGS[:4]  # which both boards have; the others are the drive board's
VERBS = ("ask", "set", "store", "built in", "zero gyro", "level")
OUTCOMES = ("done", "unknown", "bounds", "budget", "moving", "memory")
RECORDS = ("none", "sound", "spoiled", "writing")

SONAR_SLOT_MS = 40
NO_RETURN = 0xFFFF
MAX_ECHO_US = SONAR_SLOT_MS * 1000  # a later echo belongs to another slot
MAX_COUNT = 1023
MAX_TILT = 31416  # 0.1 mrad: half a turn
MAX_DUTY = 127
FULL_POWER = 10_000
MAX_DEADLINE_MS = 1000
MAX_MILLIVOLTS = 60_000
DOINGS = ("stand", "drive", "back", "turn")  # of the bumper cart
STAGE_KINDS = 3
ALL_SWITCHES = 7
MATCHED, COARSE = 1, 2  # bits of a run's manner
MAX_LEASH = 255  # s
MAX_MILLIAMPERES = 30_000


class Calibration(Params):
    """What one robot's counts mean. The infra-red curve is counts = scale / (cm + shift) + floor (10 bits at 5 V)."""

    wheel_radius: float = Field(default=0.0508, gt=0.0)  # m
    ticks_per_turn: int = Field(default=1000, gt=0)  # of a wheel against the body
    speed_of_sound: float = Field(default=343.0, gt=0.0)  # m/s
    infrared_scale: float = Field(default=6787.0, gt=0.0)
    infrared_shift: float = 4.0  # cm
    infrared_floor: float = 3.0  # counts
    infrared_max: float = Field(default=0.80, gt=0.0)  # m; beyond is no return
    sonar_max: float = Field(default=3.0, gt=0.0)  # m; beyond is no return

    @cached_property
    def metres_per_tick(self) -> float:
        """Distance rolled per encoder tick (m)."""
        return 2.0 * math.pi * self.wheel_radius / self.ticks_per_turn

    @cached_property
    def metres_per_microsecond(self) -> float:
        """Range per microsecond of echo (m): the sound goes there and back."""
        return 0.5e-6 * self.speed_of_sound

    @cached_property
    def infrared_ranges(self) -> tuple[float, ...]:
        """Range (m) for each of the 1024 counts; inf beyond the sensor's reach."""
        return tuple(self._infrared_range(counts) for counts in range(MAX_COUNT + 1))

    def _infrared_range(self, counts: int) -> float:
        above = counts - self.infrared_floor
        metres = (self.infrared_scale / above - self.infrared_shift) / 100.0 if above > 0.0 else math.inf
        return math.inf if metres > self.infrared_max else max(metres, 0.0)


class Refused(ValueError):
    """A frame that is none of ours; `reason` is 'unknown', 'source', 'length', 'version' or 'implausible'."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Channel(NamedTuple):
    """One row of the table; `convert` is None where the host speaks and the boards listen."""

    number: int
    name: str
    payload: struct.Struct
    sources: tuple[int, ...]  # who may send it
    is_plausible: Callable[[tuple], bool] | None
    convert: Callable[[tuple, float, Calibration, int], list[Message]] | None


def _is_state(state: int, reason: int) -> bool:
    return state < len(STATES) and reason < len(REASONS)


def _status(values: tuple, t: float, _: Calibration, source: int) -> list[Message]:
    version, state, reason, reset_cause, uptime_ms, boot_count, worst_loop_us, rx_errors, build = values
    times = (uptime_ms * 1e-3, boot_count, worst_loop_us * 1e-6)
    return [Status(t, SOURCES[source], version, STATES[state], REASONS[reason], reset_cause, *times, rx_errors, build)]


def _odometry(values: tuple, t: float, calibration: Calibration, _: int) -> list[Message]:
    left, right, tilt = values
    scale = calibration.metres_per_tick
    return [Wheels(t, left * scale, right * scale, tilt * 1e-4, 65536 * scale)]


def _balance(values: tuple, t: float, _calibration: Calibration, _source: int) -> list[Message]:
    tilt_rate, position_error, left, right, state, reason, acknowledged = values
    duties = (left / MAX_DUTY, right / MAX_DUTY)
    return [Balance(t, tilt_rate * 1e-3, position_error * 1e-3, *duties, STATES[state], REASONS[reason], acknowledged)]


def _last_words(values: tuple, t: float, _calibration: Calibration, _source: int) -> list[Message]:
    state, reason, since_ms, uptime_ms = values
    return [LastWords(t, STATES[state], REASONS[reason], since_ms * 1e-3, uptime_ms * 1e-3)]


def _is_power(values: tuple) -> bool:
    battery_mv, battery_ma, charger_mv, *rest = values
    is_current = max(abs(battery_ma), *map(abs, rest)) <= MAX_MILLIAMPERES
    return is_current and max(battery_mv, charger_mv) <= MAX_MILLIVOLTS


def _power(values: tuple, t: float, _calibration: Calibration, _source: int) -> list[Message]:
    return [Power(t, *(value * 1e-3 for value in values))]


def _is_motors(values: tuple) -> bool:
    left, right, battery_mv, state, reason, _ = values
    is_power = max(abs(left), abs(right)) <= FULL_POWER
    return is_power and battery_mv <= MAX_MILLIVOLTS and _is_state(state, reason)


def _motors(values: tuple, t: float, _calibration: Calibration, _source: int) -> list[Message]:
    left, right, battery_mv, state, reason, acknowledged = values
    powers = (left / FULL_POWER, right / FULL_POWER)
    return [Motors(t, *powers, battery_mv * 1e-3, STATES[state], REASONS[reason], acknowledged)]


def _is_cart(values: tuple) -> bool:
    _, _, battery_mv, _, _, doing, bumper, _, state, reason, _ = values
    return battery_mv <= MAX_MILLIVOLTS and doing < len(DOINGS) and bumper <= ALL_SWITCHES and _is_state(state, reason)


def _cart(values: tuple, t: float, _calibration: Calibration, _source: int) -> list[Message]:
    left, right, battery_mv, logged, bumps, doing, bumper, run, state, reason, acknowledged = values
    ran = (logged, bumps, DOINGS[doing], bumper, run)
    return [Cart(t, left, right, battery_mv * 1e-3, *ran, STATES[state], REASONS[reason], acknowledged)]


def _is_stage(values: tuple) -> bool:
    _, _, kind, bumper, is_kept, _, _ = values
    return kind < STAGE_KINDS and bumper <= ALL_SWITCHES and is_kept <= 1


def _stage(values: tuple, t: float, _calibration: Calibration, _source: int) -> list[Message]:
    number, run, kind, bumper, is_kept, left, right = values
    return [CartStage(t, run, number, Stage(kind, left, right, bumper), bool(is_kept))]


def _is_sonar(values: tuple) -> bool:
    return all(echo_us <= MAX_ECHO_US or echo_us == NO_RETURN for echo_us in values)


def _sonar(values: tuple, t: float, calibration: Calibration, _: int) -> list[Message]:
    """Two messages: the even sensors fired at t, the odd ones a slot later; nan stands for the other half."""
    scale = calibration.metres_per_microsecond
    reach = min(calibration.sonar_max, MAX_ECHO_US * scale)  # NO_RETURN is beyond both
    ranges = [echo_us * scale if echo_us * scale <= reach else math.inf for echo_us in values]
    a, b, c, d, e, f, g, h = ranges
    nan = math.nan
    return [
        Ranges(t, "sonar", np.array((a, nan, c, nan, e, nan, g, nan))),
        Ranges(t + SONAR_SLOT_MS * 1e-3, "sonar", np.array((nan, b, nan, d, nan, f, nan, h))),
    ]


def _infrared(values: tuple, t: float, calibration: Calibration, _: int) -> list[Message]:
    """Counts only become metres: nearer than 10 cm the sensor's curve folds back, and it alone cannot tell."""
    table = calibration.infrared_ranges
    return [Ranges(t, "infrared", np.array([table[counts] for counts in values]))]


ANSWER = struct.Struct("<BBBBBBf")  # before its check


def _is_setting(values: tuple) -> bool:
    *fields, check = values
    verb, setting, _, outcome, record, is_stored, value = fields
    is_known = verb < len(VERBS) and setting < len(SETTINGS) and outcome < len(OUTCOMES) and record < len(RECORDS)
    return is_known and is_stored <= 1 and math.isfinite(value) and zlib.crc32(ANSWER.pack(*fields)) == check


def _setting(values: tuple, t: float, _: Calibration, source: int) -> list[Message]:
    verb, setting, sequence, outcome, record, is_stored, value, _check = values
    asked = (SOURCES[source], VERBS[verb], SETTINGS[setting], sequence)
    return [Setting(t, *asked, OUTCOMES[outcome], RECORDS[record], bool(is_stored), value)]


STATUS, ODOMETRY, BALANCE, POWER, SONAR, INFRARED, SETTING, LAST_WORDS, MOTORS = 1, 2, 3, 4, 5, 6, 7, 8, 9
CART_STATE, STAGE = 10, 11
DRIVE_COMMAND, STOP_COMMAND, ARM_COMMAND, ADJUST_COMMAND, POWERS_COMMAND = 16, 17, 18, 19, 20
RUN_COMMAND, UPLOAD_COMMAND = 21, 22

CHANNELS: dict[int, Channel] = {
    row.number: row
    for row in (
        Channel(
            STATUS,
            "status",
            struct.Struct("<BBBBIHHHH"),
            (DRIVE, SENSOR, MOTOR),
            lambda v: _is_state(v[1], v[2]),
            _status,
        ),
        Channel(ODOMETRY, "odometry", struct.Struct("<hhh"), (DRIVE,), lambda v: abs(v[2]) <= MAX_TILT, _odometry),
        Channel(
            BALANCE,
            "balance",
            struct.Struct("<hhbbBBB"),
            (DRIVE,),
            lambda v: _is_state(v[4], v[5]) and min(v[2:4]) >= -MAX_DUTY,
            _balance,
        ),
        Channel(POWER, "power", struct.Struct("<HhHhhh"), (DRIVE,), _is_power, _power),
        Channel(
            LAST_WORDS, "last_words", struct.Struct("<BBII"), (DRIVE,), lambda v: _is_state(v[0], v[1]), _last_words
        ),
        Channel(MOTORS, "motors", struct.Struct("<hhHBBB"), (MOTOR,), _is_motors, _motors),
        Channel(CART_STATE, "cart", struct.Struct("<hhHHHBBBBBB"), (CART,), _is_cart, _cart),
        Channel(STAGE, "stage", struct.Struct("<HBBBBhh"), (CART,), _is_stage, _stage),
        Channel(SONAR, "sonar", struct.Struct("<8H"), (SENSOR,), _is_sonar, _sonar),
        Channel(INFRARED, "infrared", struct.Struct("<8H"), (SENSOR,), lambda v: max(v) <= MAX_COUNT, _infrared),
        Channel(SETTING, "setting", struct.Struct("<BBBBBBfI"), (DRIVE, SENSOR), _is_setting, _setting),
        Channel(DRIVE_COMMAND, "drive", struct.Struct("<hhHI"), (HOST,), None, None),
        Channel(STOP_COMMAND, "stop", struct.Struct("<HI"), (HOST,), None, None),
        Channel(ARM_COMMAND, "arm", struct.Struct("<HHI"), (HOST,), None, None),
        Channel(ADJUST_COMMAND, "adjust", struct.Struct("<BBBfHI"), (HOST,), None, None),
        Channel(POWERS_COMMAND, "powers", struct.Struct("<hhHHI"), (HOST,), None, None),
        Channel(RUN_COMMAND, "run", struct.Struct("<HHBBHI"), (HOST,), None, None),
        Channel(UPLOAD_COMMAND, "upload", struct.Struct("<HHHI"), (HOST,), None, None),
    )
}


def read(frame: Frame, boards: Container[int] = SOURCES) -> tuple:
    """The raw numbers of a frame's payload; Refused where none of these boards can have sent it."""
    channel = CHANNELS.get(frame.channel)
    if channel is None:
        raise Refused("unknown")
    if channel.is_plausible is None or frame.source not in channel.sources or frame.source not in boards:
        raise Refused("source")
    if frame.channel == STATUS and frame.payload[:1] != VERSION_BYTE:
        raise Refused("version")  # before the length, which another version may have changed
    if len(frame.payload) != channel.payload.size:
        raise Refused("length")
    values = channel.payload.unpack(frame.payload)
    if not channel.is_plausible(values):
        raise Refused("implausible")
    return values


def convert(frame: Frame, values: tuple, t: float, calibration: Calibration) -> list[Message]:
    """The messages of a frame that was read, sampled at host time t."""
    to_messages = CHANNELS[frame.channel].convert
    return to_messages(values, t, calibration, frame.source) if to_messages else []


def decode(frame: Frame, t: float, calibration: Calibration) -> list[Message]:
    """The messages of a frame sampled at host time t; Refused where no board of ours can have sent it."""
    return convert(frame, read(frame), t, calibration)


def uptime_and_boots(values: tuple) -> tuple[int, int]:
    """Milliseconds since boot, and the number of boots, of a status frame that was read."""
    return values[4], values[5]


def encode_command(command: Command, sequence: int, echo_ms: int) -> Frame:
    """A command as the host's frame.

    `echo_ms` is the newest time (16 bits) seen from the board that it is for: it goes into the payload, so that the
    board can refuse what was long under way, and into the header, since the host keeps no board time of its own.
    """
    match command:
        case DriveCommand(speed, turn):
            number, body = DRIVE_COMMAND, struct.pack("<hhH", milli(speed), milli(turn), echo_ms)
        case StopCommand():
            number, body = STOP_COMMAND, struct.pack("<H", echo_ms)
        case ArmCommand(armed):
            number, body = ARM_COMMAND, struct.pack("<HH", int(armed), echo_ms)
        case PowersCommand():
            number, body = POWERS_COMMAND, pack_powers(command, echo_ms)
        case RunCommand():
            number, body = RUN_COMMAND, pack_run(command, echo_ms)
        case UploadCommand(first, count):
            if not (0 <= first <= 0xFFFF and 0 <= count <= 0xFFFF):
                raise ValueError(f"{command} does not fit a command")
            number, body = UPLOAD_COMMAND, struct.pack("<HHH", first, count, echo_ms)
        case AdjustCommand():
            number, body = ADJUST_COMMAND, pack_adjustment(command, echo_ms)
        case _:
            raise TypeError(f"not a command: {command!r}")
    return Frame(HOST, number, sequence, echo_ms, body + struct.pack("<I", zlib.crc32(body)))


def pack_adjustment(command: AdjustCommand, echo_ms: int) -> bytes:
    """An adjustment's payload before its check; ValueError for a value that no board can hold."""
    what = (addressee(command), VERBS.index(command.verb), SETTINGS.index(command.setting))
    try:
        return struct.pack("<BBBfH", *what, command.value, echo_ms)
    except OverflowError:
        raise ValueError(f"{command.value} does not fit an adjustment") from None


def pack_powers(command: PowersCommand, echo_ms: int) -> bytes:
    """The motors' payload before its check; ValueError for powers beyond full, and for a deadline that is none."""
    powers, deadline_ms = (command.left, command.right), command.deadline * 1e3
    if not (all(abs(power) <= 1.0 for power in powers) and 1.0 <= deadline_ms <= MAX_DEADLINE_MS):
        raise ValueError(f"{command} does not fit a command")
    return struct.pack("<hhHH", *(round(power * FULL_POWER) for power in powers), round(deadline_ms), echo_ms)


def pack_run(command: RunCommand, echo_ms: int) -> bytes:
    """A run's payload before its check; ValueError for numbers that the cart cannot hold."""
    fits = 0 <= command.bumps <= 0xFFFF and 0 <= command.seed <= 0xFFFF and 0 <= command.leash <= MAX_LEASH
    if not fits:
        raise ValueError(f"{command} does not fit a command")
    manner = MATCHED * command.is_matched | COARSE * command.is_coarse
    return struct.pack("<HHBBH", command.bumps, command.seed, manner, command.leash, echo_ms)


def addressee(command: Command) -> int:
    """The source number of the board that a command is for; a stop is for either that moves its robot."""
    match command:
        case PowersCommand() | RunCommand() | UploadCommand():
            return MOTOR
        case AdjustCommand(board=board) if board == SOURCES[SENSOR]:
            return SENSOR
    return DRIVE


def milli(value: float) -> int:
    """Thousandths in 16 bits; ValueError for a number that no robot can mean."""
    if not abs(value) <= 32.767:
        raise ValueError(f"{value} does not fit a command")
    return round(value * 1000.0)

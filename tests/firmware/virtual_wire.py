"""Reads and writes the virtual robot's bytes for tests: frames by the host's decoder, payloads by `struct`."""

import struct
import zlib

import numpy as np

from firmware.virtual import World
from server.link import Decoder, Frame, encode

HOST, DRIVE, SENSOR = 0, 1, 2
STATUS, ODOMETRY, BALANCE, POWER, SONAR, INFRARED, SETTING, LAST_WORDS = 1, 2, 3, 4, 5, 6, 7, 8
DRIVE_COMMAND, STOP_COMMAND, ARM_COMMAND, ADJUST_COMMAND = 16, 17, 18, 19
ANSWER = "<BBBBBBfI"
LAYOUTS = {
    STATUS: "<BBBBIHHHH",
    ODOMETRY: "<hhh",
    BALANCE: "<hhbbBBB",
    POWER: "<HhHhhh",
    SONAR: "<8H",
    INFRARED: "<8H",
    LAST_WORDS: "<BBII",
}
METRES_PER_TICK = 2.0 * np.pi * 0.0508 / 1000


def room(width: float, height: float, start=(0.0, 0.0, 0.0)) -> World:
    """Empty room around the origin."""
    x, y = width / 2, height / 2
    walls = [[-x, -y, x, -y], [x, -y, x, y], [x, y, -x, y], [-x, y, -x, -y]]
    return World(np.array(walls), start, "room")


def frames(data: bytes) -> list[Frame]:
    return Decoder().feed(data)


def payloads(data: bytes, channel: int) -> np.ndarray:
    """Payload fields (n, k) of all frames of one channel."""
    rows = [struct.unpack(LAYOUTS[channel], f.payload) for f in frames(data) if f.channel == channel]
    return np.array(rows)


def checked(payload: bytes) -> bytes:
    return payload + struct.pack("<I", zlib.crc32(payload))


def drive_command(speed: float, turn: float, echo_ms: int, sequence: int = 0) -> bytes:
    payload = checked(struct.pack("<hhH", round(speed * 1000), round(turn * 1000), echo_ms & 0xFFFF))
    return encode(Frame(HOST, DRIVE_COMMAND, sequence & 255, 0, payload))


def stop_command(echo_ms: int = 0, sequence: int = 0) -> bytes:
    return encode(Frame(HOST, STOP_COMMAND, sequence & 255, 0, checked(struct.pack("<H", echo_ms & 0xFFFF))))


def arm_command(arm: int, echo_ms: int, sequence: int = 0) -> bytes:
    return encode(Frame(HOST, ARM_COMMAND, sequence & 255, 0, checked(struct.pack("<HH", arm, echo_ms & 0xFFFF))))


def adjust_command(board: int, verb: int, setting: int, value: float, echo_ms: int, sequence: int = 0) -> bytes:
    payload = checked(struct.pack("<BBBfH", board, verb, setting, value, echo_ms & 0xFFFF))
    return encode(Frame(HOST, ADJUST_COMMAND, sequence & 255, 0, payload))


def newest_time(data: bytes, source: int = DRIVE) -> int:
    return [f.time_ms for f in frames(data) if f.source == source][-1]


def drive_for(robot, seconds: float, speed: float, turn: float = 0.0) -> bytes:
    """Lets a host drive with commands at 10 Hz; returns what the robot said."""
    said = robot.advance(0.02)
    echo = newest_time(said)
    for i in range(round(seconds * 10)):
        robot.write(drive_command(speed, turn, echo, i))
        heard = robot.advance(0.1)
        echo = newest_time(heard)
        said += heard
    return said

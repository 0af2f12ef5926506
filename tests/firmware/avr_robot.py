"""A robot with real boards in a room, for tests: commands it, and keeps what it said and how it moved."""

import struct

from firmware.virtual.avr import AvrCrunch
from firmware.virtual.avr.programs import Imu
from tests.firmware.avr_tools import need_simavr
from tests.firmware.virtual_wire import (
    BALANCE,
    LAYOUTS,
    STATUS,
    arm_command,
    drive_command,
    frames,
    newest_time,
    payloads,
    room,
)

RAM = 2048
STEP = 0.02
DISARMED, ARMED, FALLEN, LINK_LOST, FAULT = range(5)


class Driven:
    """A robot in a room, what it said so far, and how it moved."""

    def __init__(self, width=4.0, start=(0.0, 0.0, 0.0), seed=1, radio=None, imu: Imu = "analogue"):
        need_simavr()
        self.robot = AvrCrunch(room(width, 4.0), start, seed, radio=radio, imu=imu)
        self.said = b""
        self.leans, self.poses = [], []
        self.commands = 0

    def wait(self, seconds):
        for _ in range(round(seconds / STEP)):
            self.said += self.robot.advance(STEP)
            self.leans.append(abs(self.robot.tilt))
            self.poses.append(self.robot.pose)

    def stand(self):
        """Held by a hand until the board arms; motion counts from then on."""
        self.wait(0.1)
        self.robot.write(arm_command(1, newest_time(self.said)))
        self.wait(2.0)
        assert payloads(self.said, BALANCE)[-1][4] in (ARMED, LINK_LOST)
        self.leans.clear()
        self.poses.clear()
        return self

    def drive(self, seconds, speed, turn=0.0):
        for _ in range(round(seconds * 10)):
            self.commands += 1
            self.robot.write(drive_command(speed, turn, newest_time(self.said), self.commands))
            self.wait(0.1)

    def status(self, source):
        """Fields of the newest status frame of one board."""
        told = [frame for frame in frames(self.said) if (frame.source, frame.channel) == (source, STATUS)]
        return struct.unpack(LAYOUTS[STATUS], told[-1].payload)

    def ram_used(self, name):
        board = getattr(self.robot.robot, name)
        return RAM - self.robot.lib.microcontroller_untouched(board)

    def balance(self):
        """Fields of the newest balance frame."""
        return payloads(self.said, BALANCE)[-1]

"""The virtual Maze Runner: a body in a world, the motor board's own C that moves it, and lines of a laser and of mice.

Bytes are all that leads in and out: `write` and `advance` are the motor board's line, `write_laser` and `take_laser`
the laser's, `take_mouse` a mouse's. Nothing here knows the host's side.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from firmware.virtual.builds import Build, motor_board_of
from firmware.virtual.maze_body import Drift, MazeBody
from firmware.virtual.mice import Floor, MousePlace, VirtualMouse
from firmware.virtual.on_air import OneBoard
from firmware.virtual.radio import Radio
from firmware.virtual.urg import PERIOD_MS, VirtualUrg
from firmware.virtual.worlds import World

BODY_MS = 5  # between two steps of the body
AHEAD = 0.05  # m from the middle of the axle to the laser


class VirtualMazeRunner(OneBoard):
    """A robot at `start`, or where the world has it; `drift` names how unlike its motors are, and how floors slip.

    It has optical mice at the places `mice`, which look at `floor`: a clean one unless it is given. `build` is its
    board's: the C on this machine, or the real program.
    """

    def __init__(
        self,
        world: World,
        start: np.ndarray | tuple[float, float, float] | None = None,
        seed: int = 0,
        drift: Drift = "medium",
        radio: Radio | None = None,
        mice: Sequence[MousePlace] = (),
        floor: Floor | None = None,
        build: Build = "host",
    ):
        super().__init__(radio, seed)
        x, y, heading = (float(part) for part in (world.start if start is None else start))
        self.world = world
        self.body = MazeBody(world, x, y, heading, seed, drift)
        self.board = motor_board_of(build)
        self.laser = VirtualUrg(world, self.laser_at, seed)
        self.said = b""  # by the laser
        floor = floor or Floor()
        self.mice = [VirtualMouse(place, floor, 8 * seed + number) for number, place in enumerate(mice)]
        self.counted = [b"" for _ in mice]  # by each of them
        self.history = deque([self.body.pose], maxlen=2 * PERIOD_MS // BODY_MS)  # the newest last

    @property
    def pose(self) -> np.ndarray:
        """True pose (3,)."""
        return self.body.pose

    def laser_at(self, t: float) -> np.ndarray:
        """The laser's true pose (3,) at a time (s), of the last moments."""
        late = max(0.0, self.time - t) * 1e3 / BODY_MS
        x, y, heading = self.history[max(0, len(self.history) - 1 - round(late))]
        return np.array([x + AHEAD * np.cos(heading), y + AHEAD * np.sin(heading), heading])

    def write_laser(self, data: bytes) -> None:
        """Bytes from the host to the laser."""
        self.laser.write(data)

    def take_laser(self) -> bytes:
        """What the laser has said since this was asked last."""
        said, self.said = self.said, b""
        return said

    def take_mouse(self, number: int) -> bytes:
        """What a mouse has said since this was asked last."""
        counted, self.counted[number] = self.counted[number], b""
        return counted

    def live(self) -> None:
        """Body, laser and mice."""
        if self.now_ms % BODY_MS == 0:
            self.body.step(self.board.powers, BODY_MS * 1e-3)
            self.board.battery = self.body.battery.volts
            self.history.append(self.body.pose)
        self.said += self.laser.advance(1)
        for number, mouse in enumerate(self.mice):
            self.counted[number] += mouse.advance(self.now_ms, self.body.pose)

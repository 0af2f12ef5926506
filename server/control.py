"""Who may move the robot, and for how long: the driver's lease, the stop that holds, and the commands of a page.

Pure rules over time `t` in seconds; knows no socket and no robot. Anyone may stop. Moving needs the lease: one viewer
holds it, every word of the driver renews it for 0.3 s, and silence stops the robot. After a stop nothing moves until
the driver resumes. A word spoken in front of an old picture is refused, so that commands which a slow line kept back
cannot move the robot late.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from server.messages import Arm, Drive, Goal, Message, Stop
from slam.params import Params


class Word(BaseModel):
    """What every message of a page has in common: unknown keys, infinities and text for numbers are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class DriveWord(Word):
    """Speed (m/s) and turn rate (rad/s), repeated while the stick is held; `seen` is the newest frame time shown."""

    type: Literal["drive"]
    speed: float
    turn: float
    seen: float


class GoalWord(Word):
    """Steer to (x, y) in the world with the vector field histogram, as long as `hold` follows."""

    type: Literal["goal"]
    x: float = Field(ge=-1e4, le=1e4)
    y: float = Field(ge=-1e4, le=1e4)
    speed: float = Field(default=0.3, gt=0.0, le=1.0)
    seen: float


class HoldWord(Word):
    """The driver still watches while the robot drives to its goal."""

    type: Literal["hold"]
    seen: float


class ArmWord(Word):
    """Let the drive board arm, or disarm it."""

    type: Literal["arm"]
    armed: bool


class AutopilotWord(Word):
    """Switch the virtual robot's own driver on or off."""

    type: Literal["autopilot"]
    on: bool


class PlainWord(Word):
    """stop: stand still; resume: end a stop; take and release: the lease; cancel: forget the goal."""

    type: Literal["stop", "resume", "take", "release", "cancel"]


class AckWord(Word):
    """The newest frame that was shown."""

    type: Literal["ack"]
    seq: int = Field(ge=0, le=0xFFFFFFFF)


class PingWord(Word):
    """Answered at once with the same `sent`, to measure the way there and back."""

    type: Literal["ping"]
    sent: float


CommandWord = DriveWord | GoalWord | HoldWord | ArmWord | AutopilotWord | PlainWord
AnyWord = Annotated[CommandWord | AckWord | PingWord, Field(discriminator="type")]
WORDS: TypeAdapter[CommandWord | AckWord | PingWord] = TypeAdapter(AnyWord)


class ControlParams(Params):
    """Times and limits of remote driving."""

    lease: float = Field(default=0.3, gt=0.0)  # s of silence after which the robot stops
    idle: float = Field(default=5.0, gt=0.0)  # s of silence after which another viewer may simply drive
    stale: float = Field(default=1.0, gt=0.0)  # s that the picture in front of the driver may be old
    refresh: float = Field(default=0.1, gt=0.0)  # s between two commands to the board
    max_speed: float = Field(default=0.5, gt=0.0)  # m/s
    max_turn: float = Field(default=1.5, gt=0.0)  # rad/s

    def at_speed(self, speed: float) -> ControlParams:
        """The same rules for people when the session's time runs `speed` times as fast as theirs."""
        times = ("lease", "idle", "stale", "refresh")
        return self.model_copy(update={name: speed * getattr(self, name) for name in times})


class Refused(Exception):
    """A word that may not move the robot now; the text is meant for the person who sent it."""


class Control:
    """The state of remote driving. `hear` and `tick` answer with the messages that the robot is to get."""

    def __init__(self, params: ControlParams, autopilot: bool | None = None):
        """`autopilot` is None for a robot that has none, else whether it drives at the start."""
        self.params = params
        self.autopilot = autopilot
        self.driver: str | None = None
        self.heard = -math.inf
        self.wish: Drive | None = None
        self.goal: Goal | None = None
        self.stopped_by: str | None = None
        self.refreshed = -math.inf

    def has_lease(self, t: float) -> bool:
        """Whether the driver spoke within the last `lease` seconds."""
        return self.driver is not None and t - self.heard <= self.params.lease

    def hear(self, viewer: str, word: CommandWord, t: float) -> list[Message]:
        """Messages that follow from a viewer's word at time t; raises Refused."""
        match word:
            case PlainWord(type="stop"):
                return self.stop(viewer, t)
            case DriveWord():
                return self._drive(viewer, word, t)
            case GoalWord():
                return self._steer(viewer, word, t)
            case HoldWord():
                self._check_driver(viewer)
                self._check_fresh(word.seen, t)
                self.heard = t
            case ArmWord():
                self._lead(viewer, t)
                return [*([] if word.armed else self._halt(t)), Arm(t, word.armed)]
            case AutopilotWord():
                return self._switch_autopilot(viewer, word.on, t)
            case PlainWord(type="take"):
                halted = self._halt(t) if self.driver != viewer else []
                self.driver, self.heard = viewer, t
                return halted
            case PlainWord(type="release"):
                return self.leave(viewer, t)
            case PlainWord(type="resume"):
                self._lead(viewer, t)
                self.stopped_by = None
            case PlainWord(type="cancel"):
                self._check_driver(viewer)
                return self._halt(t)
        return []

    def tick(self, t: float) -> list[Message]:
        """To be called often: repeats the driver's wish to the board, and stops the robot when the driver is silent."""
        if not self.has_lease(t):
            return self._halt(t) if self.wish or self.goal else []
        if self.wish is None or t - self.refreshed < self.params.refresh:
            return []
        self.refreshed = t
        return [Drive(t, self.wish.speed, self.wish.turn)]

    def stop(self, viewer: str, t: float) -> list[Message]:
        """Stand still, and stay so until the driver resumes; from anyone, at any time."""
        self.stopped_by = viewer
        if self.autopilot:
            self.autopilot = False
        self._halt(t)
        return [Stop(t)]

    def leave(self, viewer: str, t: float) -> list[Message]:
        """A viewer gives the lease back or has gone; the robot stops if that was its driver."""
        if viewer != self.driver:
            return []
        self.driver = None
        return self._halt(t)

    def _drive(self, viewer: str, word: DriveWord, t: float) -> list[Message]:
        self._check_fresh(word.seen, t)
        is_still = word.speed == 0.0 and word.turn == 0.0
        if self.stopped_by is not None and not is_still:
            raise Refused("stopped: press Resume first")
        self._lead(viewer, t)
        if self.autopilot and not is_still:
            self.autopilot = False
        if is_still and (self.goal or self.autopilot):
            return []
        self.goal = None
        self.wish = Drive(t, _clamp(word.speed, self.params.max_speed), _clamp(word.turn, self.params.max_turn))
        self.refreshed = t
        return [self.wish]

    def _steer(self, viewer: str, word: GoalWord, t: float) -> list[Message]:
        self._check_fresh(word.seen, t)
        if self.stopped_by is not None:
            raise Refused("stopped: press Resume first")
        self._lead(viewer, t)
        if self.autopilot:
            self.autopilot = False
        self.wish = None
        self.goal = Goal(t, (word.x, word.y), min(word.speed, self.params.max_speed))
        return [self.goal]

    def arrive(self) -> None:
        """The robot has reached its goal and forgotten it."""
        self.goal = None

    def _switch_autopilot(self, viewer: str, on: bool, t: float) -> list[Message]:
        if self.autopilot is None:
            raise Refused("this robot has no autopilot")
        if on and self.stopped_by is not None:
            raise Refused("stopped: press Resume first")
        self._lead(viewer, t)
        halted = self._halt(t)
        self.autopilot = on
        return [*halted, Arm(t, True)] if on else [*halted, Stop(t)]

    def _lead(self, viewer: str, t: float) -> None:
        """Make the viewer the driver if nobody else is, or the driver has long been silent."""
        if self.driver not in (None, viewer) and t - self.heard <= self.params.idle:
            raise Refused("somebody else drives: press Take control first")
        self.driver, self.heard = viewer, t

    def _check_driver(self, viewer: str) -> None:
        if viewer != self.driver:
            raise Refused("somebody else drives: press Take control first")

    def _check_fresh(self, seen: float, t: float) -> None:
        if not 0.0 <= t - seen + 0.001 <= self.params.stale:
            raise Refused("the picture is too old to drive by")

    def _halt(self, t: float) -> list[Message]:
        """End whatever moves the robot by a person's will; a stop also makes the robot forget its goal."""
        was_moving = bool(self.goal or (self.wish and (self.wish.speed or self.wish.turn)))
        self.wish, self.goal = None, None
        return [Stop(t)] if was_moving else []


def _clamp(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))

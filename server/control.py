"""Who may move the robot, and for how long: the driver's lease, its hand-over, and the stop that holds.

Pure rules over time `t` in seconds; knows no socket and no robot. Anyone may stop. Moving needs the lease: one viewer
holds it, every word of the driver renews it for 0.3 s, and silence stops the robot. Others ask for it; the driver gives
it or keeps it, and who does not answer loses it. After a stop nothing moves until the driver resumes. A word spoken in
front of an old picture is refused, so that commands which a slow line kept back cannot move the robot late, and so is
every word while the robot itself is silent. However often the driver speaks, the radio hears the newest wish ten times
a second, and a press or a halt at once. Uses its siblings `words` (what may be said) and `stops` (the log).
"""

from __future__ import annotations

import math
from dataclasses import replace

from pydantic import Field

from server.messages import Arm, Drive, Goal, Message, Stop
from server.stops import StopLog
from server.words import ArmWord, AutopilotWord, CommandWord, DriveWord, GiveWord, GoalWord, HoldWord, PlainWord
from slam.params import Params


class ControlParams(Params):
    """Times and limits of remote driving."""

    lease: float = Field(default=0.3, gt=0.0)  # s of silence after which the robot stops
    idle: float = Field(default=5.0, gt=0.0)  # s of silence after which another viewer may simply drive
    patience: float = Field(default=10.0, gt=0.0)  # s within which the driver must answer who asks for control
    stale: float = Field(default=1.5, gt=0.0)  # s that the picture in front of the driver may be old
    refresh: float = Field(default=0.1, gt=0.0)  # s between two commands to the board, in the robot's time
    max_speed: float = Field(default=0.5, gt=0.0)  # m/s
    max_turn: float = Field(default=1.5, gt=0.0)  # rad/s

    def at_speed(self, speed: float) -> ControlParams:
        """The same rules for people when the session's time runs `speed` times as fast as theirs."""
        times = ("lease", "idle", "patience", "stale")
        return self.model_copy(update={name: speed * getattr(self, name) for name in times})


class Refused(Exception):
    """A word that may not move the robot now; the text is meant for the person who sent it."""

    kind = "refused"


class Ended(Refused):
    """A word about a goal that is no more, which is nobody's mistake: it was reached, given up or taken back."""

    kind = "ended"


class Control:
    """The state of remote driving. `hear` and `tick` answer with the messages that the robot is to get."""

    def __init__(self, params: ControlParams, autopilot: bool | None = None, runs_itself: bool = False):
        """`autopilot` is None for a robot that has none, else whether it drives at the start.

        Who `runs_itself` is only told when: armed it begins, and nobody's stick or goal moves it.
        """
        self.params = params
        self.runs_itself = runs_itself
        self.autopilot = autopilot
        self.driver: str | None = None
        self.heard = -math.inf
        self.asked_by: str | None = None  # who would like to drive
        self.asked_at = -math.inf
        self.wish: Drive | None = None
        self.goal: Goal | None = None
        self.is_planned = False  # whether the way to the goal is to be planned on the map
        self.stopped_by: str | None = None
        self.refreshed = -math.inf  # when a drive command went out last, a person's or of the robot's own steering
        self.began = -math.inf  # when a person's motion did
        self.told: Drive | Goal | None = None  # what the robot moves by, as it was told last
        self.read: float | None = None  # when the robot's newest reading was taken, as far as one is told
        self.stops = StopLog()

    def has_lease(self, t: float) -> bool:
        """Whether the driver spoke within the last `lease` seconds."""
        return self.driver is not None and t - self.heard <= self.params.lease

    def standing(self) -> tuple[str | None, str | None, str | None, bool | None]:
        """What viewers must hear of at once when it changes."""
        return self.driver, self.asked_by, self.stopped_by, self.autopilot

    def answer_time(self, t: float) -> float | None:
        """Seconds that the driver has left to answer who asks, or None if nobody does."""
        return None if self.asked_by is None else max(0.0, self.params.patience - (t - self.asked_at))

    def hear(self, viewer: str, word: CommandWord, t: float) -> list[Message]:
        """Messages that follow from a viewer's word at time t; raises Refused."""
        if self.runs_itself and isinstance(word, (DriveWord, GoalWord, HoldWord)):
            raise Refused("this robot drives by itself: it can only be told to begin a run, and to end it")
        match word:
            case DriveWord():
                return self._drive(viewer, word, t)
            case GoalWord():
                return self._steer(viewer, word, t)
            case HoldWord():
                return self._hold(viewer, word, t)
            case GiveWord():
                return self._give(viewer, word.to, t)
            case ArmWord():
                if word.armed and self.runs_itself:
                    self._check_stop()
                self._lead(viewer, t)
                if not word.armed:
                    self.stops.note(t, "the run was ended" if self.runs_itself else "disarmed", viewer)
                    self.autopilot = self.autopilot and False
                return [*([] if word.armed else self._halt(t)), Arm(t, word.armed)]
            case AutopilotWord():
                return self._switch_autopilot(viewer, word.on, t)
            case PlainWord():
                return self._obey(viewer, word, t)

    def tick(self, t: float) -> list[Message]:
        """To be called often within `refresh`: says the wish that is due, stops a silent driver, ends a request."""
        if self.asked_by is not None and t - self.asked_at >= self.params.patience:
            return self._hand_over(self.asked_by, t)
        if not self.has_lease(t):
            if not (self.wish or self.told):
                return []
            halted = self._halt(t)
            if halted:
                self.stops.note(t, "the driver fell silent", self.driver or "")
            return halted
        return [] if self.wish is None else self._say(self.wish, t)

    def may_steer(self, t: float, slack: float = 0.0) -> bool:
        """Whether a command of the robot's own steering goes out now, or in `slack` s; the next waits for it.

        While a person wishes something none does: the robot steers anew whenever the wish is said, which is as often.
        """
        if self.wish is not None or t - self.refreshed < self.params.refresh - slack:
            return False
        self.refreshed = t
        return True

    def forget(self) -> None:
        """Nothing moves the robot by a person's will any more."""
        self.wish = self.goal = self.told = None

    def stop(self, viewer: str, t: float) -> list[Message]:
        """Stand still, and stay so until the driver resumes; from anyone, at any time."""
        self.stops.note(t, "pressed Stop", viewer)
        self.stopped_by = viewer
        if self.autopilot:
            self.autopilot = False
        self._halt(t)
        return [Stop(t)]

    def leave(self, viewer: str, t: float) -> list[Message]:
        """A viewer gives the lease back or has gone; the robot stops if that was its driver."""
        if viewer == self.asked_by:
            self.asked_by = None
        if viewer != self.driver:
            return []
        halted = self._halt(t)
        if halted:
            self.stops.note(t, "the driver left", viewer)
        self.driver = None
        if self.asked_by is not None:
            self._install(self.asked_by, t)
        return halted

    def arrive(self) -> None:
        """The robot has reached its goal and forgotten it."""
        self.goal = self.told = None

    def _obey(self, viewer: str, word: PlainWord, t: float) -> list[Message]:
        match word.type:
            case "stop":
                return self.stop(viewer, t)
            case "resume":
                self._lead(viewer, t)
                self.stopped_by = None
            case "ask":
                return self._ask(viewer, t)
            case "keep":
                self._check_driver(viewer)
                self.asked_by, self.heard = None, t
            case "release":
                return self.leave(viewer, t)
            case "cancel":
                self._check_driver(viewer)
                return self._halt(t)
        return []

    def _drive(self, viewer: str, word: DriveWord, t: float) -> list[Message]:
        self._check_fresh(word.seen, t)
        is_still = word.speed == 0.0 and word.turn == 0.0
        if not is_still:
            self._check_stop()
        self._lead(viewer, t)
        if self.autopilot and not is_still:
            self.autopilot = False
        if is_still and (self.goal or self.autopilot):
            return []
        speed, turn = _clamp(word.speed, self.params.max_speed), _clamp(word.turn, self.params.max_turn)
        self.goal = None
        self.wish = Drive(t, speed, turn, word.shared)
        return self._say(self.wish, t)

    def _say(self, wish: Drive, t: float) -> list[Message]:
        """The wish, if the radio is to hear it now; otherwise `tick` comes back to it."""
        moves = is_motion(wish)
        is_halt, is_start = self.told is not None and not moves, moves and not isinstance(self.told, Drive)
        is_press = is_start and t - self.began >= 2.0 * self.params.refresh  # a program may flutter: no finger does
        if not (is_halt or is_press or t - self.refreshed >= self.params.refresh):
            return []
        self.refreshed, self.told = t, wish if moves else None
        if is_start:
            self.began = t
        return [replace(wish, t=t)]

    def _steer(self, viewer: str, word: GoalWord, t: float) -> list[Message]:
        self._check_fresh(word.seen, t)
        self._check_stop()
        self._lead(viewer, t)
        if self.autopilot:
            self.autopilot = False
        self.forget()
        self.goal = self.told = Goal(t, (word.x, word.y), min(word.speed, self.params.max_speed))
        self.is_planned = word.plan
        return [self.goal]

    def _hold(self, viewer: str, word: HoldWord, t: float) -> list[Message]:
        if self.goal is None:
            raise Ended("there is no goal any more")
        self._check_driver(viewer)
        self._check_fresh(word.seen, t)
        self.heard = t
        return []

    def _switch_autopilot(self, viewer: str, on: bool, t: float) -> list[Message]:
        if self.autopilot is None:
            raise Refused("this robot has no autopilot")
        if on:
            self._check_stop()
        self._lead(viewer, t)
        halted = self._halt(t)
        self.autopilot = on
        return [*halted, Arm(t, True)] if on else [*halted, Stop(t)]

    def _ask(self, viewer: str, t: float) -> list[Message]:
        """Drive at once if nobody minds, or have the driver asked."""
        if viewer == self.driver:
            return []
        if self._is_vacant(t):
            return self._hand_over(viewer, t)
        if self.asked_by not in (None, viewer):
            raise Refused(f"{self.asked_by} has asked before you: wait for the answer")
        if self.asked_by is None:
            self.asked_by, self.asked_at = viewer, t
        return []

    def _give(self, viewer: str, to: str, t: float) -> list[Message]:
        self._check_driver(viewer)
        if to != self.asked_by:
            raise Refused(f"{to} does not ask for control any more")
        return self._hand_over(to, t)

    def _hand_over(self, viewer: str, t: float) -> list[Message]:
        """The robot stands still, and then has another driver."""
        halted = self._halt(t)
        if halted:
            self.stops.note(t, f"handed over to {viewer}", self.driver or viewer)
        self._install(viewer, t)
        return halted

    def _install(self, viewer: str, t: float) -> None:
        if self.asked_by == viewer:
            self.asked_by = None
        elif self.driver != viewer:
            self.asked_at = t  # the new driver has the whole time to answer
        self.driver, self.heard = viewer, t

    def _is_vacant(self, t: float) -> bool:
        return self.driver is None or t - self.heard > self.params.idle

    def _lead(self, viewer: str, t: float) -> None:
        """Make the viewer the driver if nobody else is, or the driver has long been silent."""
        if viewer != self.driver and not self._is_vacant(t):
            raise Refused("somebody else drives: ask for control first")
        self._install(viewer, t)

    def _check_driver(self, viewer: str) -> None:
        if viewer != self.driver:
            raise Refused("somebody else drives: ask for control first")

    def _check_stop(self) -> None:
        if self.stopped_by is not None:
            raise Refused("stopped: press Resume first")

    def _check_fresh(self, seen: float, t: float) -> None:
        if self.read is not None and t - self.read > self.params.stale:
            raise Refused("the robot is silent: there is nothing new to drive by")
        if not 0.0 <= t - seen + 0.001 <= self.params.stale:
            raise Refused("the picture is too old to drive by")

    def _halt(self, t: float) -> list[Message]:
        """End whatever moves the robot by a person's will, if it was told; a stop makes it forget its goal, too."""
        was_moving = self.told is not None
        self.forget()
        return [Stop(t)] if was_moving else []


def is_motion(wish: Drive) -> bool:
    """Whether a wish is more than to stand still."""
    return wish.speed != 0.0 or wish.turn != 0.0


def _clamp(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))

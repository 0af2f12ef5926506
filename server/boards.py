"""Two boards on the bench: what they say of themselves, how well they are heard, and what is to be adjusted on them.

Pure: bytes' counts, messages and times come in. Uses its sibling `session`.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from server import channels
from server.commands import AdjustCommand
from server.messages import Balance, Effect, Message, Power, Ranges, Setting, Status, Wheels
from server.session import Session

BOARDS = ("drive", "sensor")
LINE = 3840  # bytes per second of 38,400 baud
WINDOW = 5.0  # s over which rates are told
REPEAT = 0.4  # s after which what was not answered is said again
PATIENCE = 5.0  # s; a record takes up to one

REFUSALS = {
    "unknown": "this board has no such setting",
    "bounds": "the value is out of its bounds (docs/wire.md tells them)",
    "budget": "the streams would take half of the line or more; make another one slower first",
    "moving": "the robot must be at rest for a second, upright for its level, and not balancing",
    "memory": "the EEPROM did not keep what was written",
}
RECORDS = {
    "none": "built-in settings; none are stored",
    "sound": "stored settings",
    "spoiled": "BUILT-IN settings: the stored ones are spoiled (checksum)",
    "writing": "being stored",
}


class Heard:
    """The newest of everything that the boards said: a robot that a session feeds, and that does nothing."""

    def __init__(self) -> None:
        self.wheels: Wheels | None = None
        self.balance: Balance | None = None
        self.power: Power | None = None
        self.statuses: dict[str, Status] = {}
        self.ranges: dict[str, np.ndarray] = {}
        self.settings: dict[str, dict[str, Setting]] = {board: {} for board in BOARDS}
        self.records: dict[str, str] = {}
        self.answers: list[Setting] = []

    def step(self, message: Message) -> list[Effect]:
        """Keeps a message."""
        match message:
            case Wheels():
                self.wheels = message
            case Balance():
                self.balance = message
            case Power():
                self.power = message
            case Status():
                self.statuses[message.board] = message
            case Ranges():
                self.keep_ranges(message)
            case Setting():
                self.keep_answer(message)
        return []

    def keep_ranges(self, sweep: Ranges) -> None:
        """A sweep of half the sensors leaves the other half as it was."""
        old = self.ranges.get(sweep.sensor, np.full(len(sweep.ranges), math.nan))
        self.ranges[sweep.sensor] = np.where(np.isnan(sweep.ranges), old, sweep.ranges)

    def keep_answer(self, answer: Setting) -> None:
        """The value in force; after all have changed at once only what is asked for again is known."""
        self.answers.append(answer)
        self.records[answer.board] = answer.record
        if answer.verb in ("ask", "set") and answer.outcome != "unknown":
            self.settings[answer.board][answer.setting] = answer
        elif answer.verb in ("built in", "store"):
            self.settings[answer.board].clear()


@dataclass
class Asked:
    """An adjustment under way."""

    command: AdjustCommand
    since: float
    sent: float = -math.inf
    sequences: frozenset[int] = frozenset()

    def is_answered_by(self, answer: Setting) -> bool:
        """Whether the answer is to one of its sendings."""
        is_same = (answer.board, answer.verb) == (self.command.board, self.command.verb)
        return is_same and answer.setting == self.command.setting and answer.sequence in self.sequences


class Errands:
    """Adjustments, done one after the other: each is repeated until it is answered; the first refusal ends all."""

    def __init__(self, commands: list[AdjustCommand]) -> None:
        self.waiting = deque(commands)
        self.asked: Asked | None = None
        self.done: list[Setting] = []
        self.failure = ""

    @property
    def is_over(self) -> bool:
        """Nothing is left to be done."""
        return bool(self.failure) or (self.asked is None and not self.waiting)

    def add(self, commands: list[AdjustCommand]) -> None:
        """More to do; what failed before is forgotten."""
        self.failure = ""
        self.waiting.extend(commands)

    def due(self, t: float, session: Session, heard: Heard) -> bytes:
        """What to send at time t: a board must have been heard before it can be told anything."""
        if self.is_over:
            return b""
        if self.asked is None:
            self.asked = Asked(self.waiting.popleft(), t)
        asked = self.asked
        answer = next((a for a in heard.answers if asked.is_answered_by(a)), None)
        heard.answers.clear()
        if answer is not None:
            self.take(answer)
            return self.due(t, session, heard)
        if t - asked.since > PATIENCE:
            self.fail(f"the {asked.command.board} board does not answer; is it switched on, and of this version?")
            return b""
        if t - asked.sent < REPEAT or session.clocks[channels.addressee(asked.command)].ticks is None:
            return b""
        asked.sent = t
        asked.sequences |= {session.sequence}
        return session.encode(asked.command)

    def take(self, answer: Setting) -> None:
        """One is done, or refused."""
        self.asked = None
        self.done.append(answer)
        if answer.outcome != "done":
            self.fail(f"the {answer.board} board refused {words(answer)}: {REFUSALS[answer.outcome]}")

    def fail(self, why: str) -> None:
        """Nothing more is done."""
        self.failure = why
        self.asked = None
        self.waiting.clear()


def words(answer: Setting) -> str:
    """What was asked for, as a person would say it."""
    verbs = {"set": f"to set {answer.setting}", "level": "to learn its level"}
    return verbs.get(answer.verb, f"to {answer.verb}")


def addressees(setting: str) -> tuple[str, ...]:
    """The boards that have a setting."""
    return BOARDS if setting in channels.STREAMS else BOARDS[:1]


def asking() -> list[AdjustCommand]:
    """All settings of both boards."""
    return [AdjustCommand(board, "ask", name) for name in channels.SETTINGS for board in addressees(name)]


def setting(name: str, value: float) -> list[AdjustCommand]:
    """One setting, on every board that has it."""
    return [AdjustCommand(board, "set", name, value) for board in addressees(name)]


def both(verb: str) -> list[AdjustCommand]:
    """A verb that concerns all settings."""
    return [AdjustCommand(board, verb, channels.SETTINGS[0]) for board in BOARDS]


class Count(NamedTuple):
    """How much had come and gone by a time."""

    t: float
    received: int
    sent: int
    frames: dict[str, int]


class Meter:
    """Rates over the last seconds."""

    def __init__(self) -> None:
        self.counts: deque[Count] = deque()
        self.received = self.sent = 0

    def note(self, t: float, frames: Counter[str]) -> None:
        """To be called now and then."""
        self.counts.append(Count(t, self.received, self.sent, dict(frames)))
        while len(self.counts) > 2 and self.counts[1].t <= t - WINDOW:
            self.counts.popleft()

    def rates(self) -> dict[str, Any]:
        """Bytes and frames per second; the share of the line is of both directions together."""
        if len(self.counts) < 2 or self.counts[-1].t <= self.counts[0].t:
            return {"received_bytes_per_s": 0.0, "sent_bytes_per_s": 0.0, "share_percent": 0.0, "frames_per_s": {}}
        first, last = self.counts[0], self.counts[-1]
        elapsed = last.t - first.t
        received, sent = (last.received - first.received) / elapsed, (last.sent - first.sent) / elapsed
        frames = {name: round((n - first.frames.get(name, 0)) / elapsed, 1) for name, n in last.frames.items()}
        share = round(100.0 * (received + sent) / LINE, 1)
        return {
            "received_bytes_per_s": round(received, 1),
            "sent_bytes_per_s": round(sent, 1),
            "share_percent": share,
            "frames_per_s": frames,
        }


def link_report(session: Session, meter: Meter, t: float) -> dict[str, Any]:
    """How the boards are heard at time t."""
    health = session.health(t)
    counts = {"frames": health["frames"], "rejected": health["rejected"], "refused": health["refused"]}
    return {**counts, "lost": health["lost"], **meter.rates()}


def board_report(session: Session, heard: Heard, board: str, t: float) -> dict[str, Any]:
    """What a board says of itself, and how it is heard; without its own words before its first status."""
    link = session.health(t)["boards"][board]
    age, loss = link["age"], link["loss"]
    report: dict[str, Any] = {
        "age_s": None if age is None else round(age, 3),
        "lost": link["lost"],
        "lost_percent": None if loss is None else round(100.0 * loss, 2),
        "clock_ppm": round(-1e6 * link["drift"], 1),
        "reboots": link["reboots"],
        "wrong_version": link["wrong_version"],
        "settings": RECORDS[heard.records[board]] if board in heard.records else None,
    }
    status = heard.statuses.get(board)
    if status is not None:
        report |= {
            "state": status.state,
            "reason": status.reason,
            "reset_cause": status.reset_cause,
            "uptime_s": round(status.uptime, 3),
            "boots": status.boot_count,
            "worst_loop_ms": round(1e3 * status.worst_loop, 3),
            "rx_errors": status.rx_errors,
            "build": f"{status.build:04x}",
        }
    return report


def telemetry_report(heard: Heard) -> dict[str, Any]:
    """The newest measurements, in SI units; ranges are None where there was no echo."""
    report: dict[str, Any] = {}
    if heard.wheels is not None:
        report |= {"left_m": heard.wheels.left, "right_m": heard.wheels.right, "tilt_rad": heard.wheels.tilt}
    if heard.balance is not None:
        balance = heard.balance
        report |= {"tilt_rate_rad_s": balance.tilt_rate, "position_error_m": balance.position_error}
        report |= {"left_duty": balance.left_duty, "right_duty": balance.right_duty}
        report |= {"state": balance.state, "reason": balance.reason, "acknowledged": balance.acknowledged}
    if heard.power is not None:
        power = heard.power
        report |= {"battery_v": power.battery_volts, "battery_a": power.battery_amperes}
        report |= {"charger_v": power.charger_volts, "charger_a": power.charger_amperes}
        report |= {"left_motor_a": power.left_motor_amperes, "right_motor_a": power.right_motor_amperes}
    rounded = {name: round(value, 4) if isinstance(value, float) else value for name, value in report.items()}
    ranges = {
        f"{name}_m": [round(float(r), 3) if np.isfinite(r) else None for r in values]
        for name, values in heard.ranges.items()
    }
    return rounded | ranges


def settings_report(heard: Heard) -> dict[str, dict[str, Any]]:
    """Values in force by board and name, as far as they were asked for, and whether each is stored."""
    return {
        board: {name: {"value": float(f"{a.value:.7g}"), "stored": a.is_stored} for name, a in known.items()}
        for board, known in heard.settings.items()
    }

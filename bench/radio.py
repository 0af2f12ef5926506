"""The real boards under simavr over a bad radio, ten simulated minutes each: what stands, is obeyed and is known.

A host of the server's own code drives at random and never stops talking. Once a second one of its old commands to drive
is said again, 2 to 60 s late, as a buffer on the way might. The drive board's own memory tells what it obeys.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.benchmark import Bench, Column, Record, Row, each, middle, plain, values_of
from bench.board_watch import BoardWatch
from bench.boards import hall
from bench.host_view import HostView, Tapped
from firmware.virtual import Radio
from server.channels import DRIVE, SENSOR
from server.commands import ArmCommand, Command, DriveCommand, StopCommand

MINUTES = 10.0
ROOM = 100.0  # m: it drives about and is not to meet a wall
PATIENCE = 60.0  # s to arm
BEAT = 0.02  # s: the radio's
PER_SECOND = 10  # commands
MOTION = 30  # commands, after which it drives otherwise
STOPS = 0.05  # share of the motions that are a stop
REPLAY_AGES = (2.0, 60.0)  # s
BACK = 1.0  # s within which the host knows a board that speaks again
SETTLED = 30.0  # s after which the host knows the boards' clocks
FAULT_PERIOD, FAULT_BEGIN, FAULT_END = 60, 20, 40  # s


class Case(NamedTuple):
    """A radio; a board that is silent for a third of each minute, or is reset once in it; and another radio later."""

    radio: Radio
    silent: int = 0
    reset: int = 0
    once_it_stands: Radio | None = None


CASES = {
    "good": Case(Radio()),
    "bit errors, 1e-3": Case(Radio(bit_error_rate=1e-3)),
    "30 % of chunks lost": Case(Radio(chunk_loss=0.3)),
    "200 ms late": Case(Radio(latency=0.2)),
    "these three": Case(Radio(latency=0.2, chunk_loss=0.3, bit_error_rate=1e-3)),
    "1.2 s late once it stands": Case(Radio(), once_it_stands=Radio(latency=1.2)),
    "drive board silent, 20 s of 60": Case(Radio(), silent=DRIVE),
    "sensor board silent, 20 s of 60": Case(Radio(), silent=SENSOR),
    "sensor board reset, once in 60 s": Case(Radio(), reset=SENSOR),
}


class Drive:
    """One robot and its host, advanced together; the drive board's memory is looked at every millisecond."""

    def __init__(self, case: Case, seed: int):
        self.case = case
        self.rng = np.random.default_rng([seed, 0xAD10])
        self.robot = Tapped(hall(ROOM, ROOM), seed=seed, radio=case.radio)
        self.view, self.watch = HostView(self.robot), BoardWatch(self.robot)
        self.host = self.view.host
        self.motion: Command = StopCommand()
        self.history: list[tuple[float, bytes]] = []  # when the host said what to drive
        self.commands = self.replays = 0
        self.stands_since = 0.0
        self.lean = 0.0  # rad
        self.speaks_again: list[float] = []  # s

    def arm(self) -> None:
        """The host asks until the robot stands by itself; everything counts from then on."""
        while not self.watch.is_balancing:
            if self.robot.time > PATIENCE:
                raise RuntimeError("the drive board does not arm")
            self.robot.write(self.host.encode(ArmCommand(True)))
            self.live(1.0)  # as long as it is upright before it arms, or what is under way takes, at least
        self.stands_since = self.robot.time
        self.view.begin()
        self.watch.begin()
        self.robot.look = self.look
        if self.case.once_it_stands and self.robot.air:
            self.robot.air.radio = self.case.once_it_stands

    def drive(self, seconds: float) -> None:
        """Ten commands a second, and harm."""
        for i in range(round(seconds * PER_SECOND)):
            if i % PER_SECOND == 0:
                self.replay()
                self.inflict(i // PER_SECOND % FAULT_PERIOD)
            if i % MOTION == 0:
                self.choose()
            self.say(self.motion)
            self.live(1.0 / PER_SECOND)

    def choose(self) -> None:
        """Where to go next."""
        speed, turn = self.rng.uniform(-0.25, 0.25), self.rng.uniform(-0.6, 0.6)
        self.motion = StopCommand() if self.rng.random() < STOPS else DriveCommand(speed, turn)

    def say(self, command: Command) -> None:
        """The host gives a command."""
        first = self.host.sequence
        data = self.host.encode(command)
        for i in range((self.host.sequence - first) % 256):
            self.watch.note(command, (first + i) % 256)
            self.commands += 1
        if isinstance(command, DriveCommand):  # a stop may be as old as it likes
            self.history.append((self.robot.time, data))
        self.robot.write(data)

    def replay(self) -> None:
        """An old command to drive once more."""
        youngest, oldest = REPLAY_AGES
        old = [data for t, data in self.history if youngest <= self.robot.time - t <= oldest]
        if old:
            self.robot.write(old[self.rng.integers(0, len(old))])
            self.replays += 1

    def inflict(self, second: int) -> None:
        """The boards' own faults, by the second of the minute."""
        if self.case.reset and second == FAULT_BEGIN:
            self.robot.lib.microcontroller_hang(self.robot.robot.sensor, True)
            self.speaks_again.append(self.robot.time)
        if self.case.silent and second == FAULT_BEGIN:
            self.robot.robot.muted = 1 << (self.case.silent - 1)
        if self.case.silent and second == FAULT_END:
            self.robot.robot.muted = 0
            self.speaks_again.append(self.robot.time)

    def live(self, seconds: float) -> None:
        """Time passes, and the host hears."""
        for _ in range(round(seconds / BEAT)):
            heard = self.robot.advance(BEAT)
            if heard:
                self.host.receive("air", heard, self.robot.time)
        self.view.look(knows_clocks=self.robot.time - self.stands_since > SETTLED)

    def look(self) -> None:
        """A millisecond has passed."""
        self.lean = max(self.lean, abs(self.robot.tilt))
        self.watch.look()


def run(name: str, seed: int, minutes: float | None = None) -> Record:
    """One drive over one radio."""
    drive = Drive(CASES[name], seed)
    drive.arm()
    drive.drive(60.0 * (MINUTES if minutes is None else minutes))
    return {"seed": seed, **of_board(drive), **of_host(drive)}


def of_board(drive: Drive) -> Record:
    """Whether it stood, and what it obeyed."""
    watch = drive.watch
    return {
        "stood": not watch.has_fallen,
        "lean": math.degrees(drive.lean),
        "commands": drive.commands,
        "obeyed": watch.obeyed,
        "oldest": 1000.0 * watch.oldest,
        "refused": watch.read("supervisor.refused"),
        "rejected": watch.read("decoder.rejected"),
        "replays": drive.replays,
        "wrong": watch.wrong,
        "old_stops": watch.old_stops,
        "collisions": drive.robot.collisions,
    }


def of_host(drive: Drive) -> Record:
    """What it heard, believed, and made of the boards' clocks."""
    view = drive.view
    errors = view.clock_errors()
    fault = drive.case.silent or drive.case.reset
    back = [view.first_after(fault, t) for t in drive.speaks_again if t < drive.robot.time - 1.0]
    return {
        "said": view.said,
        "heard": 100.0 * view.heard / view.said,
        "false": view.false,
        "gap": max(map(view.longest_gap, (DRIVE, SENSOR))),
        "clock": 1000.0 * float(np.quantile(errors, 0.99)) if errors.size else None,
        "clock_worst": 1000.0 * float(np.max(errors)) if errors.size else None,
        "back": max(back) if back else None,
    }


def stood(row: Row) -> str:
    """Whether it balanced all the time, in all runs."""
    return "yes" if all(values_of(row, "stood")) else "NO"


def verdict(rows: list[Row]) -> Iterator[str]:
    """No robot may fall, obey nothing or what was not meant, speak while its other board does, or stay unknown."""
    for row in rows:
        if not all(values_of(row, "stood")):
            yield f"{row.name}: a robot fell"
        if not all(values_of(row, "obeyed")):
            yield f"{row.name}: nothing was obeyed"
        if any(back > BACK for back in values_of(row, "back")):
            yield f"{row.name}: a board that spoke again was not known within {BACK:g} s"
        for key, what in (
            ("wrong", "commands were obeyed wrongly"),
            ("collisions", "bytes of the two boards overlapped"),
        ):
            if count := sum(values_of(row, key)):
                yield f"{row.name}: {count} {what}"


def notes(rows: list[Row]) -> Iterator[str]:
    """What all rows have in common."""
    wrong, replays, old_stops = (
        sum(sum(values_of(row, key)) for row in rows) for key in ("wrong", "replays", "old_stops")
    )
    yield (
        f"Obeyed were {wrong} commands that the host had not sent, or to drive over a second before; it said {replays} "
        f"old ones again. A stop is obeyed however old it is: {old_stops} were over a second. The silence itself is "
        "part of the longest gap."
    )


BENCH = Bench(
    name="radio",
    about="the real boards over a bad radio, ten simulated minutes each: what stands, is obeyed and is known",
    rows=each(run, {name: name for name in CASES}),
    columns=(
        Column("balances", stood),
        Column("most lean (deg)", middle("lean", 1)),
        Column("commands", middle("commands", 0)),
        Column("obeyed", middle("obeyed", 0)),
        Column("oldest to drive (ms)", middle("oldest", 0)),
        Column("old ones said again", middle("replays", 0)),
        Column("refused by the board", middle("refused", 0)),
        Column("no frame", middle("rejected", 0)),
        Column("obeyed wrongly", plain("wrong")),
        Column("old stops obeyed", plain("old_stops")),
        Column("telemetry heard (%)", middle("heard", 1)),
        Column("believed, never said", plain("false")),
        Column("longest gap (s)", middle("gap")),
        Column("clocks 99 % within (ms)", middle("clock", 0)),
        Column("worst (ms)", middle("clock_worst", 0)),
        Column("back after (s)", middle("back")),
        Column("transmitters overlap", plain("collisions")),
    ),
    minutes=15,
    heading="radio",
    notes=notes,
    verdict=verdict,
)

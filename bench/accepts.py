"""What of corrupted frames is taken for good: telemetry through the host's sieves, commands through the boards'.

Corrupted is every piece between two delimiters that nobody sent so. Telemetry goes through the decoder and the channels
of the server. Commands and adjustments of both boards, about as many, go through both boards' own C with their clocks
standing still, so that none of them is refused for its age.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from bench.benchmark import Bench, Column, Record, Row, each, runs, values_of
from bench.corruption import KINDS, line_of, pieces_of
from firmware.virtual import VirtualCrunch, corridor_plan, load_world
from firmware.virtual.host import HostCrunch
from server.channels import DRIVE, SENSOR, SETTINGS, STREAMS, VERBS, Refused, addressee, encode_command, read
from server.commands import AdjustCommand, ArmCommand, Command, DriveCommand, StopCommand
from server.link import DELIMITER, Decoder, encode

PIECES = 150_000  # corrupted ones of each run, at least
BATCH = 40_000  # frames: what the boards count does not reach its counters' ends
DRIVE_SECONDS = 120.0
COMMANDS = 20_000
HALF = 10  # of 20 commands
FRESH_MS = 1000  # that a command's echo may be old
BOARDS = (("drive", SETTINGS), ("sensor", STREAMS))
VALUES = (0.0, 0.1, 0.5, 2.0, 5.0, 40.0, 80.0, 400.0, 2000.0)


def telemetry(seed: int) -> list[bytes]:
    """Encoded frames of both boards on a drive."""
    robot = VirtualCrunch(load_world("corridor50"), seed=seed, plan=corridor_plan(seed))
    said = robot.advance(DRIVE_SECONDS)
    return [piece + DELIMITER for piece in said.split(DELIMITER) if piece]


def commands(rng: np.random.Generator, now_ms: Mapping[int, int]) -> list[bytes]:
    """Encoded commands that the boards would obey while their clocks show this."""
    given = [command_of(rng) for _ in range(COMMANDS)]
    echoes = [(now_ms[addressee(command)] - int(rng.integers(0, FRESH_MS))) % 65536 for command in given]
    return [encode(encode_command(command, i % 256, echoes[i])) for i, command in enumerate(given)]


def command_of(rng: np.random.Generator) -> Command:
    """Something to drive or an adjustment; now and then a stop or an order to arm."""
    match rng.integers(0, 20):
        case 0:
            return StopCommand()
        case 1:
            return ArmCommand(bool(rng.integers(0, 2)))
        case kind if kind < HALF:
            return DriveCommand(rng.uniform(-0.6, 0.6), rng.uniform(-3.0, 3.0))
        case _:
            return adjustment_of(rng)


def adjustment_of(rng: np.random.Generator) -> AdjustCommand:
    """Any verb for either board; the value is within some setting's bounds."""
    board, settings = BOARDS[rng.integers(0, len(BOARDS))]
    verb, setting = (names[rng.integers(0, len(names))] for names in (VERBS, settings))
    return AdjustCommand(board, verb, setting, float(rng.choice(VALUES)))


def corrupted(kind: str, frames: list[bytes], rng: np.random.Generator) -> Iterator[list[bytes]]:
    """Batches of pieces that nobody sent, PIECES and a few in all."""
    sent = {frame[:-1] for frame in frames}
    left = PIECES
    while left > 0:
        chosen = [frames[i] for i in rng.integers(0, len(frames), BATCH)]
        pieces = pieces_of(KINDS[kind](line_of(chosen), rng), sent)
        left -= len(pieces)
        yield pieces


def heard(batches: Iterator[list[bytes]]) -> Record:
    """What the host makes of such pieces: how many, those with a right CRC-16, and those that it would believe."""
    found = {"telemetry": 0, "telemetry_crc": 0, "believed": 0}
    for pieces in batches:
        frames = Decoder().feed(DELIMITER.join(pieces) + DELIMITER)
        found["telemetry"] += len(pieces)
        found["telemetry_crc"] += len(frames)
        found["believed"] += sum(map(is_believed, frames))
    return found


def is_believed(frame) -> bool:
    """Whether the frame passes the second sieve as well."""
    try:
        read(frame, (DRIVE, SENSOR))
    except Refused:
        return False
    return True


class Boards:
    """Both boards' C, the drive board armed, with their clocks standing still."""

    def __init__(self, seed: int):
        world = load_world("demo")
        self.robot = HostCrunch(world, world.start, seed)
        self.robot.stand()
        self.drive = self.robot.robot.drive.loop
        self.sensor = self.robot.robot.sensor.loop
        self.answers()

    @property
    def now_ms(self) -> dict[int, int]:
        """The boards' clocks."""
        return {DRIVE: self.drive.teller.uptime_ms, SENSOR: self.sensor.teller.uptime_ms}

    def obeyed(self) -> int:
        """Commands obeyed so far."""
        return sum(self.robot.accepted)

    def adjusted(self) -> bytes:
        """All that an adjustment changes on either board, in bytes."""
        places = (
            (self.drive, "adjuster"),
            (self.sensor, "adjuster"),
            (self.drive, "zeroing"),
            (self.drive, "is_zeroing"),
        )
        return b"".join(bytes(self.robot.ffi.buffer(self.robot.ffi.addressof(*place))) for place in places)

    def answers(self) -> int:
        """Frames that the boards have said since it was asked last, those without room in the outbox too."""
        outbox = self.robot.robot.outbox
        said = bytes(self.robot.ffi.buffer(outbox.bytes, outbox.size)).count(DELIMITER) + outbox.dropped
        outbox.size = outbox.dropped = 0
        return said

    def hear(self, pieces: list[bytes]) -> tuple[int, int, int]:
        """How many of the pieces were frames by their CRC-16, how many commands were obeyed, and how many adjustments
        answered; what is done without an answer counts as one."""
        obeyed, adjusted = self.obeyed(), self.adjusted()
        self.drive.decoder.rejected = 0
        self.robot.receive(DELIMITER.join(pieces) + DELIMITER)
        answered = self.answers()
        is_silent = answered == 0 and self.adjusted() != adjusted
        return len(pieces) - self.drive.decoder.rejected, self.obeyed() - obeyed, answered + is_silent


def commanded(boards: Boards, batches: Iterator[list[bytes]]) -> Record:
    """What the boards make of such pieces."""
    found = {"commands": 0, "commands_crc": 0, "obeyed": 0, "adjusted": 0}
    for pieces in batches:
        crc, obeyed, adjusted = boards.hear(pieces)
        found["commands"] += len(pieces)
        found["commands_crc"] += crc
        found["obeyed"] += obeyed
        found["adjusted"] += adjusted
    return found


def run(kind: str, seed: int) -> Record:
    """One kind of harm to telemetry and to commands."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    boards = Boards(seed)
    host = heard(corrupted(kind, telemetry(seed), rng))
    return {"seed": seed, **host, **commanded(boards, corrupted(kind, commands(rng, boards.now_ms), rng))}


def total(key: str) -> Callable[[Row], str]:
    """The sum over the runs."""
    return lambda row: f"{sum(values_of(row, key)):,}"


def notes(rows: list[Row]) -> Iterator[str]:
    """All kinds together."""
    sums = {key: sum(sum(values_of(row, key)) for row in rows) for key in rows[0].records[0]}
    yield (
        f"In all {sums['telemetry']:,} corrupted pieces of telemetry, of which the host believed {sums['believed']:,}, "
        f"and {sums['commands']:,} of commands and adjustments, of which the drive board obeyed {sums['obeyed']:,} and "
        f"either board did or answered {sums['adjusted']:,}."
    )


def verdict(rows: list[Row]) -> Iterator[str]:
    """A board may not take anything corrupted for good."""
    for row in rows:
        for key, what in (("obeyed", "commands were obeyed"), ("adjusted", "adjustments were done or answered")):
            if count := sum(values_of(row, key)):
                yield f"{row.name}: {count} corrupted {what}"


BENCH = Bench(
    name="accepts",
    about="corrupted frames that are taken for good: by the host after CRC-16 and sieve, by both boards",
    rows=each(run, {name: name for name in KINDS}),
    columns=(
        Column("runs", runs),
        Column("telemetry", total("telemetry")),
        Column("with a right CRC-16", total("telemetry_crc")),
        Column("believed", total("believed")),
        Column("commands", total("commands")),
        Column("with a right CRC-16", total("commands_crc")),
        Column("obeyed", total("obeyed")),
        Column("adjustments done or answered", total("adjusted")),
    ),
    seeds=10,
    minutes=1,
    quick=1,
    heading="harm",
    notes=notes,
    verdict=verdict,
)

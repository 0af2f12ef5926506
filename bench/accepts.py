"""What of corrupted frames is taken for good: telemetry through the host's sieves, commands through the drive board's.

Corrupted is every piece between two delimiters that nobody sent so. Telemetry goes through the decoder and the channels
of the server, commands through the drive board's own C with its clock standing still, so that none of them is refused
for its age.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from bench.benchmark import Bench, Column, Record, Row, each, runs, values_of
from bench.corruption import KINDS, line_of, pieces_of
from firmware.virtual import VirtualCrunch, corridor_plan, load_world
from firmware.virtual.host import HostCrunch
from server.channels import Refused, encode_command, read
from server.link import DELIMITER, Decoder, encode
from server.messages import ArmCommand, Command, DriveCommand, StopCommand

PIECES = 150_000  # corrupted ones of each run, at least
BATCH = 40_000  # frames: what the board counts does not reach its counters' ends
DRIVE_SECONDS = 120.0
COMMANDS = 20_000
FRESH_MS = 1000  # that a command's echo may be old


def telemetry(seed: int) -> list[bytes]:
    """Encoded frames of both boards on a drive."""
    robot = VirtualCrunch(load_world("corridor50"), seed=seed, plan=corridor_plan(seed))
    said = robot.advance(DRIVE_SECONDS)
    return [piece + DELIMITER for piece in said.split(DELIMITER) if piece]


def commands(rng: np.random.Generator, now_ms: int) -> list[bytes]:
    """Encoded commands that a board would obey at `now_ms`: nine in ten drive."""
    return [
        encode(encode_command(command_of(rng), i % 256, (now_ms - int(rng.integers(0, FRESH_MS))) % 65536))
        for i in range(COMMANDS)
    ]


def command_of(rng: np.random.Generator) -> Command:
    """Something to drive, or now and then a stop or an order to arm."""
    match rng.integers(0, 20):
        case 0:
            return StopCommand()
        case 1:
            return ArmCommand(bool(rng.integers(0, 2)))
        case _:
            return DriveCommand(rng.uniform(-0.6, 0.6), rng.uniform(-3.0, 3.0))


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
        read(frame)
    except Refused:
        return False
    return True


class Board:
    """The drive board's C, armed, with its clock standing still."""

    def __init__(self, seed: int):
        world = load_world("demo")
        self.robot = HostCrunch(world, world.start, seed)
        self.robot.stand()
        self.drive = self.robot.robot.drive

    @property
    def now_ms(self) -> int:
        """The board's clock."""
        return self.drive.loop.teller.uptime_ms

    def obeyed(self) -> int:
        """Commands obeyed so far."""
        return sum(self.robot.accepted)

    def hear(self, pieces: list[bytes]) -> tuple[int, int]:
        """How many of the pieces were frames by their CRC-16, and how many were obeyed."""
        before = self.obeyed()
        self.drive.loop.supervisor.refused = 0
        self.robot.receive(DELIMITER.join(pieces) + DELIMITER)
        obeyed = self.obeyed() - before
        return self.drive.loop.supervisor.refused + obeyed, obeyed


def commanded(board: Board, batches: Iterator[list[bytes]]) -> Record:
    """What the board makes of such pieces."""
    found = {"commands": 0, "commands_crc": 0, "obeyed": 0}
    for pieces in batches:
        crc, obeyed = board.hear(pieces)
        found["commands"] += len(pieces)
        found["commands_crc"] += crc
        found["obeyed"] += obeyed
    return found


def run(kind: str, seed: int) -> Record:
    """One kind of harm to telemetry and to commands."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    board = Board(seed)
    host = heard(corrupted(kind, telemetry(seed), rng))
    return {"seed": seed, **host, **commanded(board, corrupted(kind, commands(rng, board.now_ms), rng))}


def total(key: str) -> Callable[[Row], str]:
    """The sum over the runs."""
    return lambda row: f"{sum(values_of(row, key)):,}"


def notes(rows: list[Row]) -> Iterator[str]:
    """All kinds together."""
    sums = {key: sum(sum(values_of(row, key)) for row in rows) for key in rows[0].records[0]}
    yield (
        f"In all {sums['telemetry']:,} corrupted pieces of telemetry, of which the host believed {sums['believed']:,}, "
        f"and {sums['commands']:,} of commands, of which the board obeyed {sums['obeyed']:,}."
    )


BENCH = Bench(
    name="accepts",
    about="corrupted frames that are taken for good: by the host after CRC-16 and sieve, by the drive board",
    rows=each(run, {name: name for name in KINDS}),
    columns=(
        Column("runs", runs),
        Column("telemetry", total("telemetry")),
        Column("with a right CRC-16", total("telemetry_crc")),
        Column("believed", total("believed")),
        Column("commands", total("commands")),
        Column("with a right CRC-16", total("commands_crc")),
        Column("obeyed", total("obeyed")),
    ),
    seeds=10,
    minutes=1,
    quick=1,
    heading="harm",
    notes=notes,
)

"""What the boards' programs take of their ATmega32s in flash, RAM and time, and how fast they simulate."""

from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from bench.benchmark import Bench, Column, Record, Row, each, figures, runs, values_of
from bench.boards import Rider, hall
from firmware.virtual import load_world
from firmware.virtual.avr.motor_board import AvrMotorBoard
from firmware.virtual.avr.programs import Imu, programs
from firmware.virtual.bumper_cart import VirtualCart
from server.channels import CART, DRIVE, MOTOR, SENSOR, STATUS, encode_command, read
from server.commands import AdjustCommand, PowersCommand, RunCommand, UploadCommand
from server.link import Decoder, encode

FLASH, RAM = 32768, 2048  # bytes
MHZ = 16
STEP_CYCLES = 80_000  # of a control step of 5 ms
SECONDS = 30.0
PATIENCE = 1.5  # s for an adjustment, of which a record takes the longest
REFRESH_MS = 100  # between powers


class Board(NamedTuple):
    """A board's name, its number on the wire, the drive board's kind of gyro, and the share of RAM that it may take."""

    name: str
    source: int
    imu: Imu = "analogue"
    ram: float = 0.6


def flash_of(board: Board) -> int:
    """Bytes of a program as avr-size tells them."""
    elf = getattr(programs(board.imu), board.name)
    said = subprocess.run(["avr-size", "-C", "--mcu=atmega32", elf], capture_output=True, text=True, check=True).stdout
    found = re.search(r"Program:\s+(\d+) bytes", said)
    assert found is not None, said
    return int(found[1])


def run(board: Board, seed: int) -> Record:
    """Adjusted in all ways, reset by its watchdog, armed; then half a minute of driving, turning and standing."""
    if board.name == "cart":
        return run_cart(board, seed)
    if board.source == MOTOR:
        return run_motor(board, seed)
    rider = Rider(hall(12.0), (-4.0, 0.0, 0.0), seed, imu=board.imu)
    lib, microcontroller = rider.robot.lib, getattr(rider.robot.robot, board.name)
    adjust(rider, board.name)
    lib.microcontroller_hang(microcontroller, True)  # from then on it tells its last words, too
    rider.wait(PATIENCE)
    if not rider.arm():
        raise RuntimeError("the robot does not arm")
    watch = Watch(lib, microcontroller)
    for wish in ((0.3, 0.0), (0.0, 1.0), (0.0, 0.0)):
        rider.tell(*wish)
        rider.wait(SECONDS / 3.0)
    return {"seed": seed, "flash": flash_of(board), "step": rider.statuses[board.source][6] * MHZ, **watch.figures()}


def run_motor(board: Board, seed: int) -> Record:
    """Reset by its watchdog; then half a minute of powers that are refreshed and reversed."""
    made, decoder, rng = AvrMotorBoard(), Decoder(), np.random.default_rng(seed)
    made.run(REFRESH_MS)
    made.lib.microcontroller_hang(made.mcu, True)
    frames = decoder.feed(made.run(round(1000 * PATIENCE)))
    watch = Watch(made.lib, made.mcu)
    for i in range(round(1000 * SECONDS / REFRESH_MS)):
        powers = PowersCommand(rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0), 0.3)
        made.receive(encode(encode_command(powers, i % 256, frames[-1].time_ms)))
        frames += decoder.feed(made.run(REFRESH_MS))
    status = [read(frame) for frame in frames if frame.channel == STATUS][-1]
    return {"seed": seed, "flash": flash_of(board), "step": status[6] * MHZ, **watch.figures()}


def run_cart(board: Board, seed: int) -> Record:
    """Reset by its watchdog; then half a minute of a run from bump to bump, and its log told again."""
    cart, decoder = VirtualCart(load_world("cut-rectangle"), seed=seed, board="avr"), Decoder()
    cart.advance(0.001 * REFRESH_MS)
    cart.board.lib.microcontroller_hang(cart.board.mcu, True)
    frames = decoder.feed(cart.advance(PATIENCE))
    watch = Watch(cart.board.lib, cart.board.mcu)
    for number, command in enumerate((RunCommand(0, seed + 1), UploadCommand(0, 0xFFFF))):
        cart.write(encode(encode_command(command, number, frames[-1].time_ms)))
        frames += decoder.feed(cart.advance(SECONDS if number == 0 else PATIENCE))
    status = [read(frame) for frame in frames if frame.channel == STATUS][-1]
    return {"seed": seed, "flash": flash_of(board), "step": status[6] * MHZ, **watch.figures()}


class Watch:
    """What a microcontroller does from now on."""

    def __init__(self, lib: Any, microcontroller: Any) -> None:
        self.lib, self.microcontroller = lib, microcontroller
        lib.microcontroller_longest_awake(microcontroller)  # the start is another matter
        self.cycle, self.slept = lib.microcontroller_cycle(microcontroller), lib.microcontroller_slept(microcontroller)
        self.began = time.process_time()

    def figures(self) -> Record:
        """RAM ever touched (bytes), longest time awake (cycles), asleep (%), times as fast as the clock."""
        worked = time.process_time() - self.began
        lib, microcontroller = self.lib, self.microcontroller
        passed = lib.microcontroller_cycle(microcontroller) - self.cycle
        return {
            "ram": RAM - lib.microcontroller_untouched(microcontroller),
            "awake": lib.microcontroller_longest_awake(microcontroller),
            "asleep": 100.0 * (lib.microcontroller_slept(microcontroller) - self.slept) / passed,
            "speed": passed / (1e6 * MHZ) / worked,
        }


def adjust(rider: Rider, board: str) -> None:
    """Everything that `crunch board` may ask of it; RuntimeError for what it does not answer."""
    rider.wait(PATIENCE)
    wishes = [("ask", 0.0), ("set", 20.0), ("store", 0.0), ("built in", 0.0)]
    if board == "drive":
        wishes += [("level", 0.0), ("zero gyro", 0.0)]
    for verb, value in wishes:
        rider.setting = ()
        rider.send(AdjustCommand(board, verb, "odometry_ms", value))
        rider.wait(PATIENCE)
        if not rider.setting:
            raise RuntimeError(f"the {board} board does not answer `{verb}`")


def of(key: str, whole: int):
    """The worst of the runs, and its share of the whole."""

    def text(row: Row) -> str:
        worst = max(record[key] for record in row.records)
        return f"{worst:,} ({100.0 * worst / whole:.1f} %)"

    return text


LIMITS = {"flash": 0.5 * FLASH, "step": 0.4 * STEP_CYCLES, "awake": 0.4 * STEP_CYCLES}


def verdict(rows: list[Row]) -> Iterator[str]:
    """Half of the flash, a board's share of the RAM and two fifths of a step must do."""
    for row in rows:
        for key, most in {**LIMITS, "ram": BOARDS[row.name].ram * RAM}.items():
            if (worst := max(values_of(row, key))) >= most:
                yield f"{row.name}: {key} is {worst:,}, not below {most:,.0f}"


BOARDS = {
    "drive board": Board("drive", DRIVE),
    "drive board, IMU=mpu6050": Board("drive", DRIVE, "mpu6050"),
    "sensor board": Board("sensor", SENSOR),
    "motor board": Board("motor", MOTOR),
    "cart": Board("cart", CART, ram=0.85),  # half of which is its log
}

BENCH = Bench(
    name="avr",
    about="what the boards' programs take of their ATmega32s, and how fast they simulate",
    rows=each(run, BOARDS),
    columns=(
        Column("flash (bytes)", of("flash", FLASH)),
        Column("RAM with stack, high-water mark (bytes)", of("ram", RAM)),
        Column("worst step it tells (cycles, share of 5 ms)", of("step", STEP_CYCLES)),
        Column("longest between two sleeps (the same)", of("awake", STEP_CYCLES)),
        Column("asleep: median (%)", figures("asleep", 0, 0.5)),
        Column("pair, or board alone: x real time of a core", figures("speed", 1, 0.5)),
        Column("runs", runs),
    ),
    seeds=3,
    minutes=1,
    is_timed=True,
    heading="program",
    verdict=verdict,
)

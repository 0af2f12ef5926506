"""A coverage-guided fuzzer (libFuzzer) against the boards' receive path, under AddressSanitizer and UBSan.

It starts from real frames and commands that are fresh. `firmware/fuzz` tells what is insisted on; this builds it, lets
it run, and counts which lines of the firmware its inputs reach.
"""

from __future__ import annotations

import json
import re
import shutil
import struct
import subprocess
import zlib
from collections.abc import Iterator
from pathlib import Path

from bench.benchmark import Bench, Column, Crew, Record, Row, middle, plain
from firmware.virtual import VirtualCrunch, load_world
from firmware.virtual.native import FIRMWARE
from server.channels import VERBS, encode_command
from server.commands import (
    AdjustCommand,
    ArmCommand,
    DriveCommand,
    PowersCommand,
    RunCommand,
    StopCommand,
    UploadCommand,
)
from server.errors import UserError
from server.link import DELIMITER, encode

MINUTES = 10.0
FUZZ = FIRMWARE.parent / "build" / "fuzz"
PACKAGES = "make gcc clang-14 libclang-rt-14-dev"
LONGEST = 512  # bytes of an input
NOTHING = "none"  # among the findings
LINK = ("link/frame.c", "link/cobs.c", "link/crc.c", "link/seal.c", "link/adjust.c")
MOTOR = ("motor/command.c", "motor/loop.c", "motor/ramp.c", "motor/supervisor.c")
CART = ("cart/command.c", "cart/log.c", "cart/loop.c", "cart/program.c", "cart/supervisor.c")
TOLD = (*LINK, "drive/command.c", "drive/loop.c", "drive/supervisor.c", *MOTOR, *CART)
ARMING = DELIMITER * 90  # each zero lets 5 ms pass
POWERS = PowersCommand(0.5, -0.5, 0.3)
RUN, UPLOAD = RunCommand(3, 7, True, 1), UploadCommand(0, 99)
RUNNING = DELIMITER * 180  # in which the cart logs two stages


def corpus() -> list[bytes]:
    """What there is to begin with: each kind of frame that the boards send, and commands alone and together.

    One has its checks right and no deadline: no host says so, and by chance it is not found in a short run.
    """
    robot = VirtualCrunch(load_world("demo"), seed=1)
    said = robot.advance(3.0).split(DELIMITER)
    kinds = {(piece[1:2], len(piece)): piece + DELIMITER for piece in said if piece}
    commands = [ArmCommand(True), DriveCommand(0.3, -0.5), StopCommand(), DriveCommand(-9.0, 9.0), ArmCommand(False)]
    commands += [POWERS, PowersCommand(-1.0, 1.0, 1.0), RUN, UPLOAD]
    commands += [AdjustCommand(board, verb, "odometry_ms", 40.0) for board in ("drive", "sensor") for verb in VERBS]
    frames = [encode_command(command, i, 0) for i, command in enumerate(commands)]
    body = struct.pack("<hhHH", 5000, -5000, 0, 0)
    endless = frames[commands.index(POWERS)]._replace(payload=body + struct.pack("<I", zlib.crc32(body)))
    encoded = [encode(frame) for frame in (*frames, endless)]
    run, upload = (encoded[commands.index(command)] for command in (RUN, UPLOAD))
    whole = encoded[0] + ARMING + b"".join(encoded[1:])
    return [*kinds.values(), *encoded, whole, run + RUNNING + upload + ARMING]


def make(target: str) -> Path:
    """A program of firmware/Makefile, up to date; UserError where it cannot be built."""
    if shutil.which("make") is None:
        raise UserError(f"no make here; Debian/Ubuntu: apt-get install {PACKAGES}")
    made = subprocess.run(["make", "-C", str(FIRMWARE), target], capture_output=True, text=True, check=False)
    if made.returncode != 0:
        raise UserError(f"`{target}` cannot be built (apt-get install {PACKAGES}): {made.stderr.strip()[:500]}")
    return FUZZ / target


def fuzz(program: Path, folder: Path, seed: int, *limits: str) -> subprocess.CompletedProcess:
    """One run of the fuzzer; `folder` gets its inputs, beginning with the corpus, and its findings."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "inputs").mkdir(parents=True)
    for number, data in enumerate(corpus()):
        (folder / "inputs" / f"seed-{number:02}").write_bytes(data)
    fixed = [f"-seed={seed + 1}", f"-max_len={LONGEST}", "-timeout=10", f"-artifact_prefix={folder}/", "-verbosity=1"]
    command = [str(program), *fixed, *limits, "-print_final_stats=1", str(folder / "inputs")]
    return subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)


def told(done: subprocess.CompletedProcess, folder: Path) -> Record:
    """What a run of the fuzzer says of itself."""
    said = done.stderr
    progress = re.findall(r"cov: (\d+) ft: (\d+) corp: (\d+)", said)
    stats = dict(re.findall(r"stat::(\w+):\s+(\d+)", said))
    findings = sorted(path.name for path in folder.iterdir() if path.is_file())
    if not findings and (not progress or done.returncode != 0):
        raise RuntimeError(f"the fuzzer did not run:\n{said[-2000:]}")
    return {
        "executions": int(stats.get("number_of_executed_units", 0)),
        "per_second": int(stats.get("average_exec_per_sec", 0)),
        "edges": int(progress[-1][0]) if progress else 0,
        "inputs": int(progress[-1][2]) if progress else 0,
        "findings": ", ".join(findings) or NOTHING,
    }


def reached(program: Path, inputs: Path) -> dict[str, tuple[int, int]]:
    """Of each C file the lines that the inputs reach, and all lines."""
    for old in FUZZ.rglob("*.gcda"):
        old.unlink()
    subprocess.run([str(program), *map(str, sorted(inputs.iterdir()))], check=True)
    notes = [str(path) for path in sorted(FUZZ.rglob("*.gcda"))]
    printed = subprocess.run(["gcov", "--json-format", "--stdout", *notes], capture_output=True, check=True).stdout
    lines: dict[str, tuple[int, int]] = {}
    for file in (file for text in printed.splitlines() if text for file in json.loads(text)["files"]):
        counts = [line["count"] for line in file["lines"]]
        lines[file["file"]] = (sum(count > 0 for count in counts), len(counts))
    return lines


def run(seed: int) -> Record:
    """MINUTES of fuzzing from one seed, and what its inputs reach."""
    folder = FUZZ / f"run-{seed}"
    found = told(fuzz(make("fuzzer"), folder, seed, f"-max_total_time={round(60 * MINUTES)}"), folder)
    lines = reached(make("replay"), folder / "inputs")
    found["lines"] = ", ".join(f"{name} {lines[name][0]}/{lines[name][1]}" for name in TOLD)
    return {"seed": seed, **found}


def rows(crew: Crew) -> Iterator[Row]:
    """One for each seed."""
    for seed in range(crew.seeds):
        if crew.wants(f"seed {seed}"):
            yield Row(f"seed {seed}", [run(seed)])


def verdict(rows: list[Row]) -> Iterator[str]:
    """Nothing may be found."""
    for row in rows:
        for record in row.records:
            if record["findings"] != NOTHING:
                yield f"{row.name}: {record['findings']}, in {FUZZ}/run-{record['seed']}"


BENCH = Bench(
    name="fuzz",
    about="ten minutes of coverage-guided fuzzing of the boards' receive path under sanitizers",
    rows=rows,
    columns=(
        Column("executions", middle("executions", 0)),
        Column("per second", middle("per_second", 0)),
        Column("edges covered", middle("edges", 0)),
        Column("inputs kept", middle("inputs", 0)),
        Column("lines reached", plain("lines")),
        Column("findings", plain("findings")),
    ),
    minutes=MINUTES,
    quick=1,
    is_timed=True,
    heading="run",
    verdict=verdict,
)

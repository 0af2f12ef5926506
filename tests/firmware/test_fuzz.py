"""The fuzzer runs, finds nothing in the firmware, reaches its decoders' every line, and finds mistakes put there."""

import shutil
import subprocess

import pytest

from bench import fuzz
from firmware.virtual.native import FIRMWARE
from server.errors import UserError
from tests.tools import miss

RUNS = 10_000
PATIENCE = 300_000  # runs; the hardest takes 20,000 on average


def program(name):
    try:
        return fuzz.make(name)
    except UserError as error:
        miss(str(error))


def test_nothing_is_found_and_every_line_of_the_decoders_reached(tmp_path):
    done = fuzz.fuzz(program("fuzzer"), tmp_path, 7, f"-runs={RUNS}")
    found = fuzz.told(done, tmp_path)
    assert found["findings"] == "none", done.stderr[-3000:]
    assert found["executions"] >= RUNS
    lines = fuzz.reached(program("replay"), tmp_path / "inputs")
    for name in ("link/frame.c", "link/cobs.c", "link/seal.c", "drive/command.c", "motor/command.c", "cart/command.c"):
        assert lines[name][0] == lines[name][1], name


@pytest.mark.parametrize(
    ("name", "sound", "broken"),
    [
        ("link/frame.c", "decoder->size < sizeof decoder->pending", "decoder->size <= sizeof decoder->pending"),
        ("link/cobs.c", "code - 1 > size - from", "code - 1 > size"),
        ("link/seal.c", "== seal_get32(frame->payload + covered)", "!= ~seal_get32(frame->payload + covered)"),
        ("link/seal.c", "<= SEAL_MAX_AGE_MS", "<= 4 * SEAL_MAX_AGE_MS"),
        ("drive/supervisor.c", "limited(wish->speed, MAX_SPEED)", "wish->speed"),
        ("motor/command.c", "deadline_ms == 0 || !is_power(command->powers[0]) ||", "deadline_ms == 0 ||"),
        ("cart/command.c", "if (manner & ~(RUN_MATCHED | RUN_COARSE))", "if (manner == 99)"),
        ("cart/loop.c", "count < end && first < end - count", "count < UINT16_MAX"),
        ("motor/ramp.c", "magnitude_of(wanted) < most", "true"),
    ],
    ids=[
        "overflow",
        "over-read",
        "no CRC-32",
        "stale",
        "no limit",
        "no limit of power",
        "no such manner",
        "beyond the log",
        "no ramp",
    ],
)
def test_what_is_broken_is_found(name, sound, broken, tmp_path):
    program("fuzzer")
    shutil.copytree(FIRMWARE, tmp_path / "firmware", ignore=shutil.ignore_patterns("__pycache__"))
    source = tmp_path / "firmware" / name
    assert sound in source.read_text()
    source.write_text(source.read_text().replace(sound, broken))
    subprocess.run(["make", "-C", str(tmp_path / "firmware"), "fuzzer"], check=True, capture_output=True)
    folder = tmp_path / "run"
    done = fuzz.fuzz(tmp_path / "build" / "fuzz" / "fuzzer", folder, 1, f"-runs={PATIENCE}")
    assert fuzz.told(done, folder)["findings"] != "none"

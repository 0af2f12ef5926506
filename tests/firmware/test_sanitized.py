"""The C under sanitizers: its own tests once more, the simulated boards among them; and that a mistake is found."""

import shutil

import pytest

from tests.firmware.sanitizers import ROOT, python

SUITES = {
    "link": ["test_link_c.py", "test_line.py"],
    "boards": ["test_drive_c.py", "test_supervisor_c.py", "test_sensor_c.py"],
    "motor board": ["test_motor_c.py"],
    "cart": ["test_cart_c.py", "test_cart_body.py"],
    "gyro on a bus": ["test_imu.py", "-k", "set_up or is_told or rails or stays_away"],
    "virtual robot": ["test_virtual_crunch.py", "test_rangefinders.py", "test_scripted.py", "test_drift.py"],
    "simulated boards": ["test_avr.py", "test_imu.py", "-k", "same_seed"],
}


@pytest.mark.parametrize("suite", SUITES)
def test_no_rule_of_c_is_broken(suite):
    words = [f"tests/firmware/{word}" if word.endswith(".py") else word for word in SUITES[suite]]
    done = python("-m", "pytest", "-q", "-p", "no:cacheprovider", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout


FEED = """
from firmware.virtual.native import native
ffi, lib, _ = native()
decoder, frame = ffi.new("struct frame_decoder *"), ffi.new("struct frame *")
lib.frame_decoder_init(decoder)
for byte in bytes([1] * 40) + bytes(1):
    lib.frame_decoder_feed(decoder, byte, frame)
outbox, room = ffi.new("struct outbox *"), ffi.new("uint8_t[6]")
lib.outbox_init(outbox, room, 6)
lib.outbox_put(outbox, frame)
print("survived")
"""


@pytest.mark.parametrize(
    ("name", "sound", "broken"),
    [
        ("frame.c", "decoder->size < sizeof decoder->pending", "decoder->size <= sizeof decoder->pending"),
        ("outbox.c", "outbox->capacity - outbox->size < LINK_MAX_ENCODED", "outbox->capacity < outbox->size"),
        ("", "", ""),
    ],
    ids=["an array's end", "a buffer's end", "nothing"],
)
def test_a_planted_overflow_is_found(name, sound, broken, tmp_path):
    shutil.copytree(ROOT / "firmware", tmp_path / "firmware", ignore=shutil.ignore_patterns("__pycache__"))
    if name:
        source = tmp_path / "firmware" / "link" / name
        assert sound in source.read_text()
        source.write_text(source.read_text().replace(sound, broken))
    done = python("-c", FEED, checkout=tmp_path)
    said = done.stdout + done.stderr
    assert ("survived" in done.stdout) == (name == ""), said
    assert ("runtime error" in said or "AddressSanitizer" in said) == (name != ""), said

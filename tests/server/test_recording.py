import os
import random
import signal
import subprocess
import sys
import zlib

import pytest

from server.recording import (
    HEAD,
    MAGIC,
    EmptyRecording,
    FutureVersion,
    Header,
    Kind,
    LinkName,
    NoHeader,
    NotARecording,
    Reader,
    Record,
    Recorder,
    RecordingError,
    is_recording,
)

HEADER = Header(
    robot="crunch",
    links=(LinkName(id="radio", spec="tcp://robot:9000"), LinkName(id="spare")),
    unix_ns=1_700_000_000_000_000_000,
    monotonic_ns=12_345_678_901_234,
    configuration={"local_map": {"size": 2.0}},
    software={"crunch": "0.1.0"},
)


def some_records(n, seed=0):
    rng = random.Random(seed)
    kinds = {Kind.RX: ("radio", "spare"), Kind.TX: ("radio",), Kind.MARK: ("",)}
    records = []
    for i in range(n):
        kind = rng.choice(list(kinds))
        records.append(Record(i * 1_234_567 / 1e9, kind, rng.choice(kinds[kind]), rng.randbytes(rng.randrange(60))))
    return records


def write(path, records):
    recorder = Recorder(path, HEADER)
    for record in records:
        recorder.append(record.kind, record.link_id, record.data, record.t)
    recorder.close()
    return path.read_bytes()


def offsets_of(records, content):
    """Offset at which each record ends, the last being the file's length."""
    ends = [len(content)]
    for record in reversed(records):
        ends.append(ends[-1] - HEAD.size - len(record.data))
    return ends[::-1]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.rlog"


def test_a_recording_comes_back_as_it_was_written(path):
    records = some_records(200)
    content = write(path, records)
    reader = Reader(path)
    assert reader.header == HEADER
    assert list(reader) == records == list(reader)
    assert reader.truncated_at is None
    assert reader.skipped == []
    assert is_recording(path)
    assert len(content) == offsets_of(records, content)[-1]


def test_the_bytes_of_a_record(path):
    content = write(path, [Record(1.5, Kind.TX, "spare", b"abc")])
    tail = content[-21:]
    assert tail[:4] == (3).to_bytes(4, "little")
    assert tail[8:16] == (HEADER.monotonic_ns + 1_500_000_000).to_bytes(8, "little")
    assert tail[16:] == b"\x02\x01abc"
    assert tail[4:8] == zlib.crc32(tail[:4] + tail[8:]).to_bytes(4, "little")


@pytest.mark.parametrize("t", [0.0, 0.1, 1 / 3, 86_400.123456789, 1e6 + 0.000000001])
def test_times_in_whole_nanoseconds_come_back_bit_for_bit(path, t):
    t = round(t * 1e9) / 1e9
    write(path, [Record(t, Kind.RX, "radio", b"")])
    assert next(iter(Reader(path))).t == t


def test_a_file_cut_at_any_offset_gives_what_was_whole(path):
    records = some_records(20)
    content = write(path, records)
    ends = offsets_of(records, content)
    for cut in range(ends[0], len(content) + 1):
        path.write_bytes(content[:cut])
        reader = Reader(path)
        whole = sum(end <= cut for end in ends) - 1
        assert list(reader) == records[:whole]
        assert reader.truncated_at == (None if cut == ends[whole] else ends[whole])
        assert reader.skipped == []


def test_a_file_cut_within_the_header_says_so(path):
    content = write(path, [])
    for cut in range(1, len(content)):
        path.write_bytes(content[:cut])
        with pytest.raises(RecordingError, match=r"cannot be used|not the beginning"):
            Reader(path)


def test_a_flipped_bit_costs_one_record(path):
    records = some_records(8)
    content = write(path, records)
    ends = offsets_of(records, content)
    for at in range(ends[0], len(content)):
        hit = sum(end <= at for end in ends) - 1
        path.write_bytes(content[:at] + bytes((content[at] ^ 1 << at % 8,)) + content[at + 1 :])
        reader = Reader(path)
        assert list(reader) == records[:hit] + records[hit + 1 :]
        if hit == len(records) - 1:
            assert (reader.truncated_at, reader.skipped) == (ends[hit], [])
        else:
            assert (reader.truncated_at, reader.skipped) == (None, [(ends[hit], ends[hit + 1] - ends[hit])])


@pytest.mark.parametrize("filler", [b"\0", b"\xff", None])
def test_megabytes_of_damage_between_good_records_are_skipped(path, filler):
    records = some_records(30)
    content = write(path, records)
    ends = offsets_of(records, content)
    size = 2_500_000
    damage = random.Random(6).randbytes(size) if filler is None else filler * size
    path.write_bytes(content[: ends[10]] + damage + content[ends[10] :])
    reader = Reader(path)
    assert list(reader) == records
    assert reader.skipped == [(ends[10], size)]
    assert reader.truncated_at is None


def test_a_record_that_a_full_disk_cut_is_skipped(path):
    records = some_records(10)
    content = write(path, records)
    ends = offsets_of(records, content)
    path.write_bytes(content[: ends[4] - 1] + content[ends[4] :])
    reader = Reader(path)
    assert list(reader) == records[:3] + records[4:]


def damaged(path, how):
    content = write(path, some_records(3))
    path.unlink()
    match how:
        case "directory":
            path.mkdir()
        case "empty":
            path.write_bytes(b"")
        case "text":
            path.write_text("ODOM 0 0 0 0 0 0 0 nohost 0\n")
        case "noise":
            path.write_bytes(random.Random(1).randbytes(10_000))
        case "cut":
            path.write_bytes(content[:20])
        case "header":
            path.write_bytes(content[:30] + b"?" + content[31:])
        case "future":
            path.write_bytes(MAGIC + bytes((9,)) + content[len(MAGIC) + 1 :])
    return path


@pytest.mark.parametrize(
    ("how", "kind", "words"),
    [
        ("directory", RecordingError, "is a directory; name one recording"),
        ("missing", RecordingError, "cannot be read (No such file or directory)"),
        ("empty", EmptyRecording, "is empty"),
        ("text", NotARecording, "offset 0 is not the beginning of an .rlog; give a file"),
        ("noise", NotARecording, "offset 0 is not"),
        ("cut", NoHeader, "the header at offset 8 is cut"),
        ("header", NoHeader, "the header at offset 8 is cut or damaged"),
        ("future", FutureVersion, "offset 7 says format 9, but this crunch reads 1; install a newer one"),
    ],
)
def test_what_cannot_be_read_is_told_in_one_line(path, how, kind, words):
    with pytest.raises(kind) as raised:
        Reader(damaged(path, how))
    message = str(raised.value)
    assert message.startswith(f"{path}: ")
    assert words in message
    assert "\n" not in message


def test_a_header_without_a_robot_says_what_is_missing(path):
    good = write(path, [])
    data = HEADER.model_dump_json(exclude={"robot"}).encode()
    covered = len(data).to_bytes(4, "little") + good[16:26]
    head = covered[:4] + zlib.crc32(covered + data).to_bytes(4, "little") + covered[4:]
    path.write_bytes(good[:8] + head + data)
    with pytest.raises(NoHeader, match="says nothing usable for robot"):
        Reader(path)


def test_an_existing_file_is_never_overwritten(path):
    path.write_bytes(b"precious")
    with pytest.raises(RecordingError, match="choose another place or name"):
        Recorder(path, HEADER)
    assert path.read_bytes() == b"precious"


def test_trouble_with_the_disk_does_not_raise(path):
    recorder = Recorder(path, HEADER)
    os.close(recorder.descriptor)
    recorder.descriptor = os.open(path, os.O_RDONLY)
    recorder.append(Kind.RX, "radio", b"lost", 0.0)
    assert (recorder.failed, recorder.error) == (1, "Bad file descriptor")
    recorder.close()
    recorder.close()


def test_a_link_that_the_header_does_not_name_is_a_mistake(path):
    recorder = Recorder(path, HEADER)
    with pytest.raises(KeyError):
        recorder.append(Kind.RX, "unheard of", b"", 0.0)
    with pytest.raises(ValueError, match="at most"):
        recorder.append(Kind.RX, "radio", bytes(2_000_000), 0.0)
    recorder.close()


WRITER = """
import sys
from pathlib import Path
from server.recording import Header, Kind, LinkName, Recorder
recorder = Recorder(Path(sys.argv[1]), Header(robot="crunch", links=(LinkName(id="radio"),), unix_ns=0, monotonic_ns=0))
for i in range(10**9):
    recorder.append(Kind.RX, "radio", i.to_bytes(4, "little") * 8, i * 1e-3)
    if i % 100 == 0:
        print(i, flush=True)
"""


def test_kill_minus_nine_loses_nothing_that_was_appended(path):
    with subprocess.Popen([sys.executable, "-c", WRITER, path], stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout
        lines = [writer.stdout.readline() for _ in range(30)]
        writer.send_signal(signal.SIGKILL)
        lines += [line for line in writer.stdout if line.endswith("\n")]
    acknowledged = max(map(int, lines))
    reader = Reader(path)
    numbers = [int.from_bytes(record.data[:4], "little") for record in reader]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) > acknowledged
    assert reader.skipped == []


def test_sync_waits_for_the_disk_and_append_does_not(tmp_path, monkeypatch):
    name = "fdatasync" if hasattr(os, "fdatasync") else "fsync"
    flush, flushed = getattr(os, name), []

    def counted(descriptor):
        flushed.append(os.fstat(descriptor).st_size)
        flush(descriptor)

    recorder = Recorder(tmp_path / "a.rlog", HEADER)
    monkeypatch.setattr(os, name, counted)
    for record in some_records(5):
        recorder.append(record.kind, record.link_id, record.data, record.t)
    assert flushed == []
    recorder.sync()
    assert flushed == [(tmp_path / "a.rlog").stat().st_size], "all that was appended"
    recorder.close()
    recorder.close()
    recorder.sync()
    assert len(flushed) == 2, "once more at the end, and never on a closed file"

import asyncio
import contextlib
import os
import pty
import socket
import time
import tty

import pytest

from server.transport import MAX_WAITING, Backoff, LinkError, StreamLink, open_link
from tests.server.links import Ear, running, until

QUICK = Backoff(first=0.01, last=0.04)


class Tower:
    """A TCP server that keeps what it hears and the connections it has."""

    def __init__(self, port=0):
        self.port = port
        self.heard = b""
        self.writers = []

    async def __aenter__(self):
        self.server = await asyncio.start_server(self.serve, "127.0.0.1", self.port)
        self.spec = f"tcp://127.0.0.1:{self.server.sockets[0].getsockname()[1]}"
        return self

    async def __aexit__(self, *_):
        self.server.close()
        self.hang_up()
        await self.server.wait_closed()

    async def serve(self, reader, writer):
        self.writers.append(writer)
        with contextlib.suppress(OSError):
            while data := await reader.read(1000):
                self.heard += data
        writer.close()

    def hang_up(self):
        for writer in self.writers:
            writer.close()
        self.writers.clear()


def test_tcp_carries_bytes_both_ways_with_their_time():
    async def scene():
        ear = Ear()
        async with Tower() as tower:
            link = open_link(tower.spec)
            async with running(link, ear):
                await until(lambda: link.is_connected and tower.writers)
                start = time.monotonic()
                tower.writers[0].write(b"reading")
                assert link.write(b"command")
                await until(lambda: ear.data == b"reading" and tower.heard == b"command")
                assert start <= ear.times[0] <= time.monotonic()
                summary = link.summary()
            assert not link.is_connected
        return summary

    summary = asyncio.run(scene())
    assert (summary["received"], summary["sent"], summary["dropped"], summary["reconnects"]) == (7, 7, 0, 0)


def test_a_lost_connection_is_opened_again():
    async def scene():
        ear = Ear()
        async with Tower() as tower:
            link = open_link(tower.spec, QUICK)
            async with running(link, ear):
                for n in range(4):
                    await until(lambda: link.is_connected and tower.writers)
                    tower.writers[0].write(b"x")
                    await until(lambda n=n: len(ear.data) == n + 1)
                    tower.hang_up()
                    await until(lambda: not link.is_connected)
                    assert link.error == "closed by the other end"
                await until(lambda: link.is_connected)
                assert link.error == ""
                assert link.reconnects == 4

    asyncio.run(scene())


def test_a_robot_that_comes_later_is_found():
    async def scene():
        with socket.socket() as reserved:  # nobody else gets the port meanwhile, and nobody listens on it yet
            reserved.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            reserved.bind(("127.0.0.1", 0))
            port = reserved.getsockname()[1]
            link = open_link(f"tcp://127.0.0.1:{port}", QUICK)
            async with running(link):
                await until(lambda: link.error)
                assert not link.is_connected
                assert not link.write(b"too early")
                async with Tower(port):
                    await until(lambda: link.is_connected)
                    assert link.reconnects == 0
                    assert link.summary()["dropped"] == 9

    asyncio.run(scene())


def test_a_mistake_in_the_receiver_is_not_taken_for_a_lost_line():
    async def scene():
        def fail(data, t):
            raise OSError("disk full")

        async with Tower() as tower:
            link = open_link(tower.spec, QUICK)
            task = asyncio.create_task(link.run(fail))
            await until(lambda: link.is_connected and tower.writers)
            tower.writers[0].write(b"reading")
            with pytest.raises(OSError, match="disk full"):
                await task
            assert not link.is_connected

    asyncio.run(scene())


def test_pauses_grow_to_the_last_and_begin_anew_after_a_good_line(monkeypatch):
    pauses = []
    attempts = 0

    async def scene():
        sleep = asyncio.sleep

        async def noted(seconds):
            pauses.append(seconds)
            await sleep(0)

        async def connect():
            nonlocal attempts
            attempts += 1
            if attempts == 7:
                reader, (_, writer) = asyncio.StreamReader(), await asyncio.open_connection(*address)
                reader.feed_data(b"good")
                reader.feed_eof()
                return reader, writer
            raise ConnectionRefusedError("no")

        server = await asyncio.start_server(lambda _, writer: writer.close(), "127.0.0.1", 0)
        address = server.sockets[0].getsockname()
        async with server:
            monkeypatch.setattr(asyncio, "sleep", noted)
            async with running(StreamLink("test", connect, Backoff())):
                while len(pauses) < 10:
                    await sleep(0.001)

    asyncio.run(scene())
    assert pauses[:10] == [0.5, 1.0, 2.0, 4.0, 5.0, 5.0, 0.5, 1.0, 2.0, 4.0]


def test_a_congested_line_drops_commands_instead_of_keeping_them():
    async def scene():
        listener = socket.create_server(("127.0.0.1", 0))
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        link = open_link(f"tcp://127.0.0.1:{listener.getsockname()[1]}")
        assert isinstance(link, StreamLink)
        async with running(link):
            await until(lambda: link.is_connected)
            for _ in range(200_000):
                if not link.write(bytes(MAX_WAITING)):
                    break
            assert link.writer
            assert link.writer.transport.get_write_buffer_size() <= MAX_WAITING
            assert link.dropped == MAX_WAITING
        listener.close()  # and the link ended, though the line takes nothing

    asyncio.run(scene())


@pytest.fixture
def terminal():
    """(master, path) of a pseudo-terminal that a robot serves."""
    tty = pytest.importorskip("tty")
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave), slave
    for descriptor in (master, slave):
        with contextlib.suppress(OSError):
            os.close(descriptor)


@pytest.mark.parametrize("form", ["pty:{}", "serial:{}", "serial:{}?baud=115200"])
def test_a_terminal_carries_every_byte_both_ways(terminal, form):
    master, path, _ = terminal
    every_byte = bytes(range(256))

    async def scene():
        ear = Ear()
        link = open_link(form.format(path))
        async with running(link, ear):
            await until(lambda: link.is_connected)
            os.write(master, every_byte)
            await until(lambda: ear.data == every_byte)
            assert link.write(every_byte)
            await until(lambda: link.summary()["sent"] == 256)
            heard = b""
            while len(heard) < 256:  # a terminal hands over what it has
                heard += await asyncio.to_thread(os.read, master, 1000)
            assert heard == every_byte

    asyncio.run(scene())


def test_a_terminal_that_vanishes_and_comes_back_is_opened_again(tmp_path):
    tty = pytest.importorskip("tty")
    place = tmp_path / "robot"

    def serve():
        master, slave = os.openpty()
        tty.setraw(slave)
        place.unlink(missing_ok=True)
        place.symlink_to(os.ttyname(slave))
        os.close(slave)
        return master

    async def scene():
        ear = Ear()
        link = open_link(f"pty:{place}", QUICK)
        async with running(link, ear):
            await until(lambda: link.error)  # not there yet
            master = serve()
            await until(lambda: link.is_connected)
            os.write(master, b"one")
            await until(lambda: ear.data == b"one")
            os.close(master)
            await until(lambda: not link.is_connected)
            master = serve()
            await until(lambda: link.is_connected)
            os.write(master, b"two")
            await until(lambda: ear.data == b"onetwo")
            assert link.reconnects == 1
        os.close(master)

    asyncio.run(scene())


@pytest.mark.parametrize(
    ("spec", "fault"),
    [
        ("", "is no link"),
        ("radio", "is no link"),
        ("/dev/ttyUSB0", "is no link"),
        ("udp://robot:9000", "is no link"),
        ("pty:", "is no link"),
        ("serial:", "names no device"),
        ("serial:/dev/ttyUSB0?baud=fast", "has no usable baud rate: 'fast'"),
        ("serial:/dev/ttyUSB0?baud=0", "has no usable baud rate: '0'"),
        ("serial:/dev/ttyUSB0?bauds=9600", "has an unknown setting 'bauds' (known: baud)"),
        ("serial:/dev/ttyUSB0?9600", "has settings that are not name=value: '9600'"),
        ("tcp:robot", "does not name a host and a port"),
        ("tcp://robot", "does not name a host and a port"),
        ("tcp://:9000", "does not name a host and a port"),
        ("tcp://robot:many", "has no usable port"),
        ("tcp://robot:99999", "has no usable port"),
        ("tcp://robot:9000/path", "does not name a host and a port"),
        ("virtual:?speed=0", "needs a speed above 0"),
        ("virtual:?speed=nan", "needs a speed above 0"),
        ("virtual:?seed=one", "needs numbers for seed and speed"),
        ("virtual:?sped=2", "has an unknown setting 'sped'"),
        ("mouse:", "is no link"),
    ],
)
def test_a_text_that_is_no_link_is_told_in_one_line_with_the_forms(spec, fault):
    with pytest.raises(LinkError) as raised:
        open_link(spec)
    message = str(raised.value)
    assert message.startswith(f"link {spec!r} {fault}")
    assert "use serial:/dev/ttyUSB0[?baud=38400], tcp://host:port, pty:PATH, mouse:/dev/input/mouse0 or" in message
    assert "\n" not in message


def test_a_mouse_is_only_heard_and_survives_that_it_is_pulled_out(tmp_path):
    """A named pipe stands in for the device: it gives bytes, ends, and is gone until somebody plugs it in again."""

    async def scene():
        ear, place = Ear(), tmp_path / "mouse0"
        link = open_link(f"mouse:{place}", QUICK)
        async with running(link, ear):
            await until(lambda: "mouse0" in link.error)
            for n in range(3):
                os.mkfifo(place)
                await until(lambda: link.is_connected)
                with open(place, "wb", buffering=0) as mouse:
                    mouse.write(bytes([8, n, 0]))
                    await until(lambda n=n: len(ear.data) == 3 * (n + 1))
                    assert not link.write(b"x")
                    place.unlink()
                await until(lambda: not link.is_connected)
        assert not link.is_connected
        return ear.data, link.summary()

    heard, summary = asyncio.run(scene())
    assert heard == bytes([8, 0, 0, 8, 1, 0, 8, 2, 0])
    assert (summary["received"], summary["sent"], summary["dropped"], summary["reconnects"]) == (9, 0, 3, 2)


def test_a_mouse_s_character_device_that_fails_is_survived():
    """A raw pseudo-terminal is one; reading it fails once its other end is closed, as when a mouse is pulled out."""

    async def scene():
        ear = Ear()
        master, slave = pty.openpty()
        tty.setraw(slave)
        link = open_link(f"mouse:{os.ttyname(slave)}", QUICK)
        async with running(link, ear):
            await until(lambda: link.is_connected)
            os.close(slave)
            os.write(master, bytes([0x18, 0xFE, 3]))
            await until(lambda: len(ear.data) == 3)
            os.close(master)
            await until(lambda: link.error)
        return ear.data

    assert asyncio.run(scene()) == bytes([0x18, 0xFE, 3])


def test_a_file_is_no_mouse(tmp_path):
    async def scene():
        link = open_link(f"mouse:{tmp_path / 'notes'}", QUICK)
        (tmp_path / "notes").write_bytes(b"abc")
        async with running(link):
            await until(lambda: "no device that bytes come from" in link.error)

    asyncio.run(scene())


def test_the_event_device_of_a_mouse_is_refused(tmp_path):
    (tmp_path / "event3").touch()
    (tmp_path / "usb-event-mouse").symlink_to(tmp_path / "event3")
    with pytest.raises(LinkError, match="is an event device; name the one without `event`"):
        open_link(f"mouse:{tmp_path / 'usb-event-mouse'}")


def test_a_dead_line_is_warned_of_once(caplog, tmp_path):
    async def scene():
        link = open_link(f"serial:{tmp_path / 'nope'}", QUICK)
        async with running(link):
            await until(lambda: link.error)
            await asyncio.sleep(0.1)
        assert "nope" in link.error

    asyncio.run(scene())
    (warning,) = (record.getMessage() for record in caplog.records if record.name == "server.transport")
    assert "nope" in warning
    assert "trying again" in warning

"""Links that carry a robot's bytes: serial ports, TCP, pseudo-terminals and mice.

Every link looks the same: `run` is awaited in the caller's task group, hands over bytes with the time of their arrival,
and opens the line again, ever more patiently, whenever it is lost; `write` never waits. Nothing here knows what the
bytes mean. Uses its sibling `virtual_link`, for a robot in this process.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import time
from collections.abc import Awaitable, Callable
from typing import NamedTuple, Protocol, cast
from urllib.parse import parse_qsl, urlsplit

import serial_asyncio_fast

from server.errors import UserError
from server.virtual_link import Receive, VirtualLink

log = logging.getLogger(__name__)

BAUD = 38400
FORMS = (
    "serial:/dev/ttyUSB0[?baud=38400], tcp://host:port, pty:PATH, mouse:/dev/input/mouse0 "
    "or virtual:[WORLD][?seed=0&speed=1]"
)
READ_SIZE = 4096
MAX_WAITING = 512  # bytes kept for a slow line (0.13 s at 38400 baud); a command that waited longer is refused anyway
MAX_SPEED = 100.0  # of a virtual robot
CONNECT_SECONDS = 5.0
CLOSE_SECONDS = 0.5

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class LinkError(UserError):
    """A link that cannot be understood; the message names the accepted forms."""


class Backoff(NamedTuple):
    """Seconds between two attempts: the first pause, doubled up to the last."""

    first: float = 0.5
    last: float = 5.0


class Link(Protocol):
    """A line to a robot."""

    @property
    def spec(self) -> str:
        """The text that named it."""
        ...

    @property
    def is_connected(self) -> bool:
        """Whether the line is open now."""
        ...

    @property
    def reconnects(self) -> int:
        """How often the line was opened again."""
        ...

    @property
    def error(self) -> str:
        """Why the line was last lost or not found; empty while it is open."""
        ...

    @property
    def speed(self) -> float:
        """Seconds of `now` in a second of the people who watch; only a virtual robot's may differ from 1."""
        ...

    async def run(self, receive: Receive) -> None:
        """Calls receive(bytes, arrival) until cancelled; arrivals are seconds of `now`."""
        ...

    def write(self, data: bytes) -> bool:
        """Sends at once or not at all: what cannot go now is old when it could."""
        ...

    def now(self) -> float:
        """The clock that arrivals are told in (s)."""
        ...

    def summary(self) -> dict:
        """State and counts for people."""
        ...


class StreamLink:
    """A link over asyncio's streams, opened by `connect`, again and again."""

    speed = 1.0

    def __init__(self, spec: str, connect: Callable[[], Awaitable[Streams]], backoff: Backoff) -> None:
        self.spec = spec
        self.connect = connect
        self.backoff = backoff
        self.writer: asyncio.StreamWriter | None = None
        self.connections = 0
        self.received = self.sent = self.dropped = 0  # bytes
        self.error = ""
        self.told = ""  # the last error that was logged; a line that is heard makes it news again

    @property
    def is_connected(self) -> bool:
        """Whether the line is open now."""
        return self.writer is not None

    @property
    def reconnects(self) -> int:
        """How often the line was opened again."""
        return max(self.connections - 1, 0)

    def now(self) -> float:
        """The host's monotonic clock."""
        return time.monotonic()

    def write(self, data: bytes) -> bool:
        """Sends unless the line is closed or congested; then the bytes are dropped and counted."""
        if self.writer is None or self.writer.transport.get_write_buffer_size() + len(data) > MAX_WAITING:
            self.dropped += len(data)
            return False
        self.writer.write(data)
        self.sent += len(data)
        return True

    def summary(self) -> dict:
        """State and counts for people."""
        return {
            "spec": self.spec,
            "connected": self.is_connected,
            "reconnects": self.reconnects,
            "received": self.received,
            "sent": self.sent,
            "dropped": self.dropped,
            "error": self.error,
        }

    async def run(self, receive: Receive) -> None:
        """Opens the line, listens, and begins again when it is lost."""
        pause = self.backoff.first
        while True:
            before = self.received
            try:
                reader, writer = await self.connect()
            except OSError as error:
                self._fail(told(error))
            else:
                self._fail(await self._listen(reader, writer, receive))
            if self.received > before:  # the line was good; one that only opens and closes is not
                pause = self.backoff.first
            await asyncio.sleep(pause)
            pause = min(2.0 * pause, self.backoff.last)

    def _fail(self, error: str) -> None:
        """Keeps the error, and tells it once, not at each attempt."""
        if error != self.told:
            log.warning("link %s: %s; trying again", self.spec, error)
        self.error = self.told = error

    async def _listen(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, receive: Receive) -> str:
        """Hands over what comes until the line is lost, and tells why; errors of `receive` are not the line's."""
        self.writer = writer
        self.connections += 1
        self.error = ""
        try:
            while True:
                try:
                    data = await reader.read(READ_SIZE)
                except OSError as error:
                    return told(error)
                if not data:
                    return "closed by the other end"
                self.received += len(data)
                self.told = ""
                receive(data, self.now())
        finally:
            self.writer = None
            await close(writer)


class ListeningLink(StreamLink):
    """A line that only tells."""

    def write(self, data: bytes) -> bool:
        """Sends nothing."""
        self.dropped += len(data)
        return False


def told(error: OSError) -> str:
    """An error in words; a connection that takes too long has none of its own."""
    return str(error) or type(error).__name__


async def close(writer: asyncio.StreamWriter) -> None:
    """Sends what waits, then closes; a line that takes nothing more is cut."""
    writer.close()
    try:
        async with asyncio.timeout(CLOSE_SECONDS):
            await writer.wait_closed()
    except TimeoutError:
        if writer.transport.get_write_buffer_size() > 0:
            writer.transport.abort()
    except OSError:
        pass  # it was lost before


def open_link(spec: str, backoff: Backoff = Backoff()) -> Link:  # noqa: B008 (a NamedTuple is frozen)
    """The link that a text like `tcp://robot:9000` names, not yet running; LinkError where it names none."""
    scheme, colon, rest = spec.partition(":")
    if colon:
        match scheme:
            case "serial":
                return serial_link(spec, rest, backoff)
            case "tcp":
                return tcp_link(spec, backoff)
            case "pty" if rest:
                return StreamLink(spec, lambda: open_serial(rest, BAUD), backoff)
            case "mouse" if rest:
                return mouse_link(spec, rest, backoff)
            case "virtual":
                return virtual_link(spec, rest)
    raise malformed(spec, "is no link")


def malformed(spec: str, fault: str) -> LinkError:
    """The error for a text that names no link."""
    return LinkError(f"link {spec!r} {fault}; use {FORMS}")


def options(spec: str, rest: str, allowed: tuple[str, ...]) -> tuple[str, dict[str, str]]:
    """The part before a question mark, and the settings after it."""
    place, _, query = rest.partition("?")
    try:
        settings = dict(parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query)))
    except ValueError:
        raise malformed(spec, f"has settings that are not name=value: {query!r}") from None
    for name in settings:
        if name not in allowed:
            raise malformed(spec, f"has an unknown setting {name!r} (known: {', '.join(allowed)})")
    return place, settings


def serial_link(spec: str, rest: str, backoff: Backoff) -> StreamLink:
    """`serial:/dev/ttyUSB0?baud=38400`."""
    place, settings = options(spec, rest, ("baud",))
    baud = settings.get("baud", str(BAUD))
    if not place or not baud.isdecimal() or int(baud) == 0:
        raise malformed(spec, "names no device" if not place else f"has no usable baud rate: {baud!r}")
    return StreamLink(spec, lambda: open_serial(place, int(baud)), backoff)


async def open_serial(place: str, baud: int) -> Streams:
    """Streams over a serial device or a pseudo-terminal."""
    return await serial_asyncio_fast.open_serial_connection(url=place, baudrate=baud)


def tcp_link(spec: str, backoff: Backoff) -> StreamLink:
    """`tcp://host:port`."""
    try:
        parts = urlsplit(spec)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise malformed(spec, "has no usable port") from None
    if not host or not port or parts.path.strip("/"):
        raise malformed(spec, "does not name a host and a port")

    async def connect() -> Streams:
        async with asyncio.timeout(CONNECT_SECONDS):
            reader, writer = await asyncio.open_connection(host, port)
        with contextlib.suppress(OSError):  # notices a peer that vanished without a word
            writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        return reader, writer

    return StreamLink(spec, connect, backoff)


def mouse_link(spec: str, place: str, backoff: Backoff) -> StreamLink:
    """`mouse:/dev/input/mouse0`, which is only read: whoever else listens to the mouse, as a desktop, hears it too.

    An event device of the same mouse has other bytes, and is refused.
    """
    if os.path.basename(os.path.realpath(place)).startswith("event"):
        raise malformed(spec, "is an event device; name the one without `event`")
    return ListeningLink(spec, lambda: open_mouse(place), backoff)


async def open_mouse(place: str) -> Streams:
    """Streams over a device that is only read; nothing may be written to them."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader()
    protocol = asyncio.StreamReaderProtocol(reader)
    device = open(os.open(place, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY), "rb", buffering=0)  # noqa: SIM115 (the transport's)
    try:
        transport, _ = await loop.connect_read_pipe(lambda: protocol, device)
    except ValueError:
        device.close()
        raise OSError(f"{place} is no device that bytes come from") from None
    return reader, asyncio.StreamWriter(cast(asyncio.WriteTransport, transport), protocol, reader, loop)


def virtual_link(spec: str, rest: str) -> VirtualLink:
    """`virtual:`, or `virtual:WORLD?plan=PLAN&seed=1&speed=2&drift=low&boards=avr`; names are files' or built-in."""
    world, settings = options(spec, rest, ("plan", "seed", "speed", "drift", "boards"))
    try:
        seed, speed = int(settings.get("seed", "0")), float(settings.get("speed", "1"))
    except ValueError:
        raise malformed(spec, "needs numbers for seed and speed") from None
    if not 0.0 < speed <= MAX_SPEED:
        raise malformed(spec, f"needs a speed above 0, up to {MAX_SPEED:.0f}")
    from firmware import virtual  # the simulator compiles C: only who asks for it pays for it

    try:
        plan = virtual.load_plan(settings["plan"]) if "plan" in settings else None
        drift = cast(virtual.Drift, settings.get("drift", "medium"))
        build = cast(virtual.Build, settings.get("boards", "host"))
        place = virtual.load_world(world or "demo")
        robot = virtual.VirtualCrunch(place, seed=seed, drift=drift, plan=plan, build=build)
    except (ValueError, virtual.CompilerError) as error:
        raise LinkError(f"link {spec!r}: {error}") from None
    return VirtualLink(robot, spec, speed)

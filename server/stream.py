"""Binary frames to the page, and a window that keeps them fresh: the newest replaces the older, per topic.

A frame is `u32 sequence, u32 size of the header, header (JSON, padded with spaces), arrays`, little-endian; the arrays
start at a multiple of eight bytes, each padded to eight. The header's `arrays` lists (name, dtype, shape) in order.

At most 12 frames or 8 kB are under way, and 3 of a topic; the page acknowledges what it has shown, and what waits
meanwhile is replaced, so that a slow line shows fewer pictures and not old ones: at 30 kB/s the window is 0.3 s. Knows
no robot and no web framework.
"""

from __future__ import annotations

import asyncio
import json
import struct
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

import numpy as np

WINDOW_FRAMES = 12
WINDOW_BYTES = 8 * 1024
WINDOW_OF_A_TOPIC = 3  # frames: more would only queue behind a large one, and keep newer ones back
ROOM_BYTES = 1024  # a frame larger than the window goes when no more than this is under way: fresh poses
HEAD_START = {"pose": 5, "tile": 4, "status": 2}  # frames: these go before what has waited as long
NOTICES = 32  # notices to one viewer that may wait

Send = Callable[[bytes], Awaitable[None]]


def encode(topic: str, fields: Mapping[str, Any], arrays: Mapping[str, np.ndarray] | None = None) -> bytes:
    """A frame without its sequence number, the same for all viewers; ValueError for NaN or infinity in a field."""
    arrays = {name: np.ascontiguousarray(array) for name, array in (arrays or {}).items()}
    listing = [[name, array.dtype.newbyteorder("<").str, array.shape] for name, array in arrays.items()]
    header = json.dumps({"topic": topic, **fields, "arrays": listing}, separators=(",", ":"), allow_nan=False).encode()
    header += b" " * (-len(header) % 8)
    parts = [struct.pack("<I", len(header)), header]
    for array in arrays.values():
        payload = array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes()
        parts.append(payload + bytes(-len(payload) % 8))
    return b"".join(parts)


def decode(data: bytes) -> tuple[int, dict[str, Any], dict[str, np.ndarray]]:
    """Sequence number, header and arrays of a frame; for clients in Python."""
    sequence, size = struct.unpack_from("<II", data)
    header = json.loads(data[8 : 8 + size])
    offset, arrays = 8 + size, {}
    for name, dtype, shape in header["arrays"]:
        count = int(np.prod(shape))
        arrays[name] = np.frombuffer(data, dtype, count, offset).reshape(shape)
        offset += -(-arrays[name].nbytes // 8) * 8
    return sequence, header, arrays


def kind_of(topic: str) -> str:
    """A topic's name without its number: `tile` of `tile/3`."""
    return topic.partition("/")[0]


class Viewer:
    """One page: its waiting frames, and those under way."""

    def __init__(self, name: str, send: Send):
        self.name = name
        self.send = send
        self.waiting: dict[str, bytes] = {}
        self.notices: list[bytes] = []
        self.under_way: dict[int, tuple[str, int]] = {}  # sequence -> kind of topic, bytes
        self.last_sent: dict[str, int] = {}  # kind of topic -> sequence
        self.sequence = 0
        self.replaced = 0
        self.bytes_by_topic: Counter[str] = Counter()  # kind of topic -> bytes sent
        self.changed = asyncio.Event()

    def put(self, topic: str, body: bytes) -> None:
        """Have a frame sent when its turn comes, in place of an older one of its topic; notices are all sent."""
        if topic == "notice":
            self.notices = [*self.notices, body][-NOTICES:]
        else:
            self.replaced += topic in self.waiting
            self.waiting[topic] = body
        self.changed.set()

    def acknowledge(self, sequence: int) -> None:
        """All frames up to `sequence` were shown."""
        for sent in [number for number in self.under_way if number <= sequence]:
            del self.under_way[sent]
        self.changed.set()

    def next_frame(self) -> tuple[str, bytes] | None:
        """Topic and body to send now, chosen at the last moment; None while nothing waits or the window is full.

        The topic that was sent longest ago goes first, so that a slow line shows all of them. While it waits for room,
        only poses overtake it.
        """
        under_way = sum(size for _, size in self.under_way.values())
        if len(self.under_way) >= WINDOW_FRAMES:
            return None
        if self.notices:
            return "notice", self.notices.pop(0)
        of_kind = Counter(kind for kind, _ in self.under_way.values())
        ready = [topic for topic in self.waiting if of_kind[kind_of(topic)] < WINDOW_OF_A_TOPIC]
        if not ready:
            return None
        topic = min(ready, key=self.turn)
        if under_way + len(self.waiting[topic]) > WINDOW_BYTES and under_way > ROOM_BYTES:
            if "pose" not in ready:
                return None
            topic = "pose"
        self.last_sent[kind_of(topic)] = self.sequence + 1
        return topic, self.waiting.pop(topic)

    def turn(self, topic: str) -> int:
        """What waits is sent in this order; the tiles of a map take turns with other topics as if they were one."""
        kind = kind_of(topic)
        return self.last_sent.get(kind, -1) - HEAD_START.get(kind, 0)

    async def run(self) -> None:
        """Send until cancelled or until `send` fails."""
        while True:
            frame = self.next_frame()
            if frame is None:
                self.changed.clear()
                await self.changed.wait()
                continue
            topic, body = frame
            self.sequence += 1
            self.under_way[self.sequence] = kind_of(topic), len(body) + 4
            self.bytes_by_topic[kind_of(topic)] += len(body) + 4
            await self.send(struct.pack("<I", self.sequence) + body)


class Hub:
    """All viewers, and the newest frame of each topic for whoever joins."""

    def __init__(self):
        self.viewers: dict[str, Viewer] = {}
        self.newest: dict[str, bytes] = {}

    def publish(self, topic: str, fields: Mapping[str, Any], arrays: Mapping[str, np.ndarray] | None = None) -> None:
        """Encode once, give to everyone; what is as it was is not sent again."""
        body = encode(topic, fields, arrays)
        if body == self.newest.get(topic):
            return
        self.newest[topic] = body
        for viewer in self.viewers.values():
            viewer.put(topic, body)

    def forget(self, topic: str) -> None:
        """There is no such topic any more."""
        self.newest.pop(topic, None)
        for viewer in self.viewers.values():
            viewer.waiting.pop(topic, None)

    def begin(self) -> None:
        """Another session begins: viewers are told to forget what they have been shown."""
        self.newest.clear()
        for viewer in self.viewers.values():
            viewer.waiting.clear()
        self.notify({"kind": "begin"})

    def notify(self, fields: Mapping[str, Any]) -> None:
        """A notice to everyone who is here now."""
        body = encode("notice", fields)
        for viewer in self.viewers.values():
            viewer.put("notice", body)

    def join(self, viewer: Viewer) -> None:
        """Add a viewer and show it the present state."""
        self.viewers[viewer.name] = viewer
        for topic, body in self.newest.items():
            viewer.put(topic, body)

    def leave(self, viewer: Viewer) -> None:
        """Forget a viewer."""
        self.viewers.pop(viewer.name, None)

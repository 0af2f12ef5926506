"""A WebSocket with a viewer at its other end: frames go out as it bears them, words come in, and floods are cut off.

What the words are and who obeys them is up to the caller; acknowledgements and pings are answered here. Uses its
sibling `stream`.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect
from pydantic import TypeAdapter, ValidationError

from server.control import Refused
from server.stream import Viewer, encode
from server.words import AckWord, GoalWord, HoldWord, PingWord

log = logging.getLogger(__name__)

MAX_WORDS_PER_SECOND = 200
MAX_NONSENSE = 20  # words that cannot be understood, before the line is cut
MAX_WORD_BYTES = 4096
MAX_REASON_BYTES = 123  # RFC 6455, 5.5: a control frame's 125 less the code


class Gone(Exception):
    """The viewer has left, or was shown the door."""


async def converse(
    socket: WebSocket,
    viewer: Viewer,
    words: TypeAdapter[Any],
    hear: Callable[[Any], None],
    clock: Callable[[], dict[str, float]],
    *beside: Coroutine[Any, Any, None],
) -> None:
    """Send the viewer's frames and hand its words to `hear` until it leaves.

    `hear` raises Refused for what it does not obey. `clock` is the time (`t` and its `speed`) that pongs carry, so that
    the viewer knows how old a picture is. What runs `beside` ends with the conversation.
    """
    try:
        async with asyncio.TaskGroup() as group:
            for work in (viewer.run(), *beside):
                group.create_task(work)
            await listen(socket, viewer, words, hear, clock)
            raise Gone
    except* (Gone, WebSocketDisconnect, RuntimeError) as reasons:
        report_unexpected(reasons)


def report_unexpected(reasons: BaseExceptionGroup) -> None:
    """Sending on a closed socket raises RuntimeError; any other one is ours and must be seen."""
    for reason in reasons.exceptions:
        if isinstance(reason, RuntimeError) and "close" not in str(reason) and "Unexpected ASGI" not in str(reason):
            raise reason


def close_reason(text: str) -> str:
    """As much of a reason as a closing frame can hold."""
    return text.encode()[:MAX_REASON_BYTES].decode(errors="ignore")


class Patience:
    """Counts a viewer's words: too many at once, or too much nonsense, and the line is cut."""

    def __init__(self):
        self.second = 0
        self.words = 0
        self.nonsense = 0

    def allows(self, t: float, is_nonsense: bool) -> bool:
        """Whether to go on listening after another word at time t."""
        if int(t) != self.second:
            self.second, self.words = int(t), 0
        self.words += 1
        self.nonsense += is_nonsense
        return self.words <= MAX_WORDS_PER_SECOND and self.nonsense <= MAX_NONSENSE


async def listen(
    socket: WebSocket,
    viewer: Viewer,
    words: TypeAdapter[Any],
    hear: Callable[[Any], None],
    clock: Callable[[], dict[str, float]],
) -> None:
    """Take up a viewer's words until it leaves, floods or talks nonsense."""
    patience = Patience()
    loop = asyncio.get_running_loop()
    while True:
        event = await socket.receive()
        if event["type"] == "websocket.disconnect":
            return
        word = understand(words, event.get("text"))
        if not patience.allows(loop.time(), word is None):
            log.warning("%s was cut off: too many words", viewer.name)
            await socket.close(1008, "too many words")
            return
        match word:
            case None:
                tell(viewer, kind="refused", reason="not understood")
            case AckWord():
                viewer.acknowledge(word.seq)
            case PingWord():
                tell(viewer, kind="pong", sent=word.sent, **clock())
            case _:
                try:
                    hear(word)
                except Refused as refused:
                    about = {"id": word.id} if isinstance(word, GoalWord | HoldWord) else {}
                    tell(viewer, kind=refused.kind, word=word.type, **about, reason=str(refused))


def understand(words: TypeAdapter[Any], text: str | None) -> Any:
    """A viewer's word, or None for nonsense."""
    if text is None or len(text) > MAX_WORD_BYTES:
        return None
    try:
        return words.validate_json(text)
    except ValidationError:
        return None


def tell(viewer: Viewer, /, **notice: Any) -> None:
    """Send a notice to one viewer."""
    viewer.put("notice", encode("notice", notice))

"""Frames survive the way to the page bit for bit, and a slow page sees fewer of them, never old ones."""

import asyncio
import struct
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from server.layers import pack_curves
from server.stream import WINDOW_BYTES, WINDOW_FRAMES, WINDOW_OF_A_TOPIC, Hub, Viewer, decode, encode
from server.views import probabilities

TYPES = st.sampled_from(["u1", "<u2", "<i2", "<f4", ">f8", "<i4"])
ARRAYS = TYPES.flatmap(
    lambda dtype: arrays_of.arrays(dtype, arrays_of.array_shapes(min_dims=1, max_dims=3, min_side=0))
)


@given(st.dictionaries(st.text(min_size=1, max_size=8), ARRAYS, max_size=4), st.text(max_size=20))
def test_a_frame_comes_back_as_it_went(arrays, text):
    data = struct.pack("<I", 7) + encode("topic", {"text": text}, arrays)
    sequence, header, back = decode(data)
    assert (sequence, header["topic"], header["text"]) == (7, "topic", text)
    assert list(back) == list(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(back[name], array)


@given(st.text(max_size=40))
def test_arrays_start_where_a_browser_can_look_at_them(text):
    data = struct.pack("<I", 1) + encode("t", {"text": text}, {"a": np.ones(3, np.uint8), "b": np.ones(2)})
    size = struct.unpack_from("<I", data, 4)[0]
    assert (8 + size) % 8 == 0
    assert len(data) == 8 + size + 8 + 16


def test_numbers_that_json_has_not_are_refused():
    with pytest.raises(ValueError, match="not JSON compliant"):
        encode("t", {"x": float("nan")})


def make_viewer() -> tuple[Viewer, list[bytes]]:
    sent: list[bytes] = []

    async def send(data: bytes) -> None:
        sent.append(data)

    return Viewer("viewer-1", send), sent


async def turn(viewer: Viewer) -> None:
    """Let the viewer send what it may."""
    sending = asyncio.create_task(viewer.run())
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    sending.cancel()
    await asyncio.gather(sending, return_exceptions=True)


def numbers(sent: list[bytes]) -> list[int]:
    return [decode(data)[1]["n"] for data in sent]


def test_the_window_holds_back_and_the_newest_replaces_the_older():
    async def story():
        viewer, sent = make_viewer()
        for n in range(WINDOW_OF_A_TOPIC):
            viewer.put("pose", encode("pose", {"n": n}))
            await turn(viewer)
        assert numbers(sent) == list(range(WINDOW_OF_A_TOPIC))
        for n in range(100, 200):
            viewer.put("pose", encode("pose", {"n": n}))
            await turn(viewer)
        assert len(sent) == WINDOW_OF_A_TOPIC, "nothing goes out while nothing is acknowledged"
        viewer.acknowledge(1)
        await turn(viewer)
        assert numbers(sent)[-1] == 199, "what goes next is the present, not what waited longest"
        assert viewer.replaced == 99

    asyncio.run(story())


def test_the_window_counts_frames_of_all_topics():
    async def story():
        viewer, sent = make_viewer()
        for n in range(3 * WINDOW_FRAMES):
            viewer.put(f"topic-{n}", encode(f"topic-{n}", {"n": n}))
        await turn(viewer)
        assert len(sent) == WINDOW_FRAMES
        viewer.acknowledge(WINDOW_FRAMES)
        await turn(viewer)
        assert len(sent) == 2 * WINDOW_FRAMES

    asyncio.run(story())


def test_a_frame_larger_than_the_window_goes_alone_and_only_poses_overtake_it():
    async def story():
        viewer, sent = make_viewer()
        half = {"x": np.zeros(WINDOW_BYTES // 2, np.uint8)}
        large = {"x": np.zeros(2 * WINDOW_BYTES, np.uint8)}
        viewer.put("local", encode("local", {"n": 0}, half))
        await turn(viewer)
        viewer.put("path", encode("path", {"n": 1}, large))
        await turn(viewer)
        for topic, n in (("histogram", 2), ("pose", 3), ("local", 4)):
            viewer.put(topic, encode(topic, {"n": n}))
            viewer.last_sent[topic] = viewer.sequence  # the large one has waited longest
        await turn(viewer)
        assert numbers(sent) == [0, 3]
        viewer.acknowledge(1)
        await turn(viewer)
        assert numbers(sent) == [0, 3, 1], "what is small and fresh may be under way"
        viewer.put("pose", encode("pose", {"n": 5}))
        await turn(viewer)
        assert numbers(sent) == [0, 3, 1, 5]
        viewer.acknowledge(3)
        await turn(viewer)
        assert sorted(numbers(sent)[4:]) == [2, 4]

    asyncio.run(story())


def test_tiles_take_turns_with_the_other_topics():
    async def story():
        viewer, sent = make_viewer()
        tile = {"x": np.zeros(2000, np.uint8)}
        for n in range(40):
            viewer.put(f"tile/{n}", encode(f"tile/{n}", {"n": n}, tile))
        for n in range(200):
            for topic in ("pose", "status", "local"):
                viewer.put(topic, encode(topic, {"n": n}, tile if topic == "local" else {}))
            await turn(viewer)
            viewer.acknowledge(viewer.sequence)
        topics = [decode(data)[1]["topic"] for data in sent]
        tiles = [at for at, topic in enumerate(topics) if topic.startswith("tile")]
        assert [topics[at] for at in tiles] == [f"tile/{n}" for n in range(40)]
        for first, last in zip(tiles[:-4:4], tiles[4::4], strict=False):
            assert {"pose", "status", "local"} <= set(topics[first:last])

    asyncio.run(story())


def test_traffic_is_counted_by_topic():
    async def story():
        viewer, sent = make_viewer()
        for topic in ("pose", "tile/0", "tile/1", "notice"):
            viewer.put(topic, encode(topic, {"n": 0}))
        await turn(viewer)
        counted: Counter[str] = Counter()
        for data in sent:
            counted[decode(data)[1]["topic"].partition("/")[0]] += len(data)
        assert viewer.bytes_by_topic == counted

    asyncio.run(story())


def test_no_topic_starves_on_a_slow_line():
    async def story():
        viewer, sent = make_viewer()
        for n in range(60):
            for topic in ("pose", "status", "histogram", "local"):
                viewer.put(topic, encode(topic, {"n": n}))
            if n == 0:
                viewer.put("map", encode("map", {"n": n}))
            await turn(viewer)
            viewer.acknowledge(viewer.sequence)
        topics = [decode(data)[1]["topic"] for data in sent]
        assert topics.index("map") < 8
        assert min(topics[:30].count(topic) for topic in ("pose", "status", "histogram", "local")) >= 3

    asyncio.run(story())


def test_notices_are_all_sent_and_first():
    async def story():
        viewer, sent = make_viewer()
        viewer.put("pose", encode("pose", {"n": 0}))
        for n in (1, 2, 3):
            viewer.put("notice", encode("notice", {"n": n}))
        await turn(viewer)
        assert numbers(sent) == [1, 2, 3, 0]

    asyncio.run(story())


def test_who_joins_sees_the_present_at_once():
    async def story():
        hub = Hub()
        hub.publish("map", {"n": 5})
        viewer, sent = make_viewer()
        hub.join(viewer)
        await turn(viewer)
        assert numbers(sent) == [5]
        hub.leave(viewer)
        hub.publish("map", {"n": 6})
        await turn(viewer)
        assert numbers(sent) == [5]

    asyncio.run(story())


def test_what_is_as_it_was_is_not_sent_again():
    async def story():
        hub = Hub()
        viewer, sent = make_viewer()
        hub.join(viewer)
        for n in (1, 1, 2, 2, 1):
            hub.publish("labels", {"n": n})
            await turn(viewer)
            viewer.acknowledge(viewer.sequence)
        assert numbers(sent) == [1, 2, 1]

    asyncio.run(story())


def test_another_session_makes_viewers_forget():
    async def story():
        hub = Hub()
        viewer, sent = make_viewer()
        hub.join(viewer)
        hub.publish("tile/0", {"n": 1})
        hub.publish("path", {"n": 1})
        hub.begin()
        hub.publish("path", {"n": 2})
        await turn(viewer)
        headers = [decode(data)[1] for data in sent]
        assert [header["topic"] for header in headers] == ["notice", "path"]
        assert headers[0]["kind"] == "begin"
        assert list(hub.newest) == ["path"]

    asyncio.run(story())


def test_curves_are_packed_to_the_centimetre():
    rng = np.random.default_rng(0)
    curves = [rng.uniform(-40.0, 40.0, (k, 2)) for k in (3, 0, 7)]
    packed = pack_curves(curves)
    assert packed["lengths"].tolist() == [3, 7]
    np.testing.assert_allclose(packed["points"] * 0.01, np.concatenate(curves), atol=0.0051)
    assert pack_curves([])["points"].shape == (0, 2)


def test_unknown_cells_stay_exactly_in_the_middle():
    shown = probabilities(np.array([-30.0, 0.0, 30.0, np.inf, -np.inf]))
    assert shown.tolist() == [1, 128, 255, 255, 1]

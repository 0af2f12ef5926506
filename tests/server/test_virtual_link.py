"""A virtual robot lives on a link as its clock says, and a machine that is too slow for it is told of."""

import asyncio
import time

import numpy as np
import pytest

from server.transport import LinkError, open_link
from server.virtual_link import LONGEST_STEP, VirtualLink
from tests.firmware.avr_tools import need_simavr
from tests.server.links import Ear, running, until


class Ticker:
    """A virtual robot that sends a byte for each whole millisecond it lived."""

    def __init__(self):
        self.lived = 0.0
        self.heard = b""

    def advance(self, seconds):
        before, self.lived = self.lived, self.lived + seconds
        return bytes(int(self.lived * 1000) - int(before * 1000))

    def write(self, data):
        self.heard += data


@pytest.mark.parametrize("speed", [1.0, 20.0])
def test_a_virtual_robot_lives_as_its_clock_says(speed):
    async def scene():
        robot, ear, lived = Ticker(), Ear(), []

        def receive(data, t):
            ear(data, t)
            lived.append(robot.lived)

        link = VirtualLink(robot, speed=speed)
        async with running(link, receive):
            assert link.write(b"go")
            await until(lambda: robot.lived > 0.2 * speed)
            assert link.is_connected
        assert robot.heard == b"go"
        assert len(ear.data) == int(robot.lived * 1000) == link.received
        steps = np.minimum(np.diff(ear.times), LONGEST_STEP * speed)  # more is not caught up with
        assert np.all(steps >= 0.0)
        np.testing.assert_allclose(np.diff(lived), steps, atol=1e-9)

    asyncio.run(scene())


class Sluggard(Ticker):
    """A virtual robot that takes twice the time it should."""

    def advance(self, seconds):
        time.sleep(2.0 * seconds)
        return super().advance(seconds)


def test_a_machine_that_is_too_slow_for_its_robot_says_so_and_listens_meanwhile(monkeypatch, caplog):
    monkeypatch.setattr("firmware.virtual.pace.WINDOW", 0.5)

    async def scene():
        link, ear = VirtualLink(Sluggard()), Ear()
        async with running(link, ear):
            await until(lambda: link.error)
            assert "too slow for this robot" in link.error == link.summary()["error"]
            assert len(ear.times) > 10  # others had their turns

    asyncio.run(scene())
    assert caplog.text.count("too slow") == 1


@pytest.mark.parametrize("boards", ["host", "avr"])
def test_the_virtual_crunch_is_a_link_like_any_other(boards):
    if boards == "avr":
        need_simavr()

    async def scene():
        ear = Ear()
        spec = f"virtual:demo?seed=3&speed=2&drift=low&boards={boards}"
        link = open_link(spec)
        assert link.spec == spec
        async with running(link, ear):
            await until(lambda: ear.data.count(0) > 20)

    asyncio.run(scene())


@pytest.mark.parametrize(
    "spec", ["virtual:atlantis", "virtual:?drift=wild", "virtual:?boards=arm", "virtual:?plan=none-such"]
)
def test_a_virtual_robot_that_cannot_be_is_told_in_one_line(spec):
    with pytest.raises(LinkError, match="link 'virtual:"):
        open_link(spec)

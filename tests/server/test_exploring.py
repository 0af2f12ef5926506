"""Exploring as a person meets it: switched on and off, ended by whatever ends it, and told of."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import numpy as np
import pytest

from firmware.virtual.maze_runner import VirtualMazeRunner
from firmware.virtual.mazes import maze
from server.bridge import Bridge
from server.config import Config, load, navigation_of
from server.control import Control, ControlParams, Refused
from server.estimator import InlineEstimator
from server.explorer import Explorer, ExplorerParams, choose, warm_up
from server.headless import Headless
from server.messages import Drive, Stop
from server.navigator import NavigatorParams
from server.rest.health import checks_of
from server.robots.kinds import LASER
from server.robots.maze_runner import MazeRunner, make_estimator
from server.session import session_of
from server.words import ArmWord, AutopilotWord, DriveWord, PlainWord
from tests.firmware.avr_tools import need_simavr
from tests.server.executors import Later

STEP = 0.02  # s
SETTINGS = Config()
PARAMS = SETTINGS.maze_runner


class Line:
    """A line whose time passes only when the test says so."""

    speed = 1.0
    is_connected = True
    reconnects = 0
    error = ""

    def __init__(self, spec, write):
        self.spec, self.tell = spec, write
        self.time = 50.0

    def now(self):
        return self.time

    def write(self, data):
        self.tell(data)
        return True

    async def run(self, receive):
        """Not used."""

    def summary(self):
        return {}


class Served:
    """All of a live session with Maze Runner but asyncio."""

    def __init__(
        self, size="small", seed=1, autopilot=False, executor=None, rule: Literal["frontiers", "wall"] = "frontiers"
    ):
        self.is_deaf = self.is_cut = False  # for the laser, and for the board
        self.virtual = VirtualMazeRunner(maze(size, seed), seed=seed)
        self.lines = {
            "link0": Line("virtual:maze", self.virtual.write),
            LASER: Line("virtual:laser", self.virtual.write_laser),
        }
        robot = MazeRunner(PARAMS)
        navigation = navigation_of(SETTINGS, "maze_runner")
        control = Control(ControlParams(), autopilot)
        self.bridge = Bridge(robot, session_of("maze_runner", robot, PARAMS), self.lines, control, {}, navigation)
        self.explorer = Explorer(ExplorerParams(rule=rule), navigation, executor)
        self.explorer.autopilot = autopilot
        self.bridge.autopilot = self.explorer
        self.bridge.estimator = InlineEstimator(lambda: make_estimator(PARAMS), self.bridge.believe)

    def advance(self, seconds):
        for _ in range(round(seconds / STEP)):
            for line in self.lines.values():
                line.time += STEP
            now = self.lines["link0"].time
            said, swept = self.virtual.advance(STEP), self.virtual.take_laser()
            if not self.is_cut:
                self.bridge.receive("link0", said, now)
            if not self.is_deaf:
                self.bridge.receive(LASER, swept, now)
            self.bridge.tick()

    def drive(self, speed):
        self.bridge.hear("ann", DriveWord(type="drive", speed=speed, turn=0.0, seen=self.bridge.robot.t))


def test_health_is_not_well_while_the_laser_is_silent():
    served = Served()

    def checks():
        return {check.name: check for check in checks_of(served.bridge.status())}

    served.advance(4.5)
    assert all(check.ok for check in checks().values())
    assert "motors" in checks()
    assert "balance" not in checks(), "which it cannot lose"
    served.is_deaf = True
    served.advance(4.0)
    assert [name for name, check in checks().items() if not check.ok] == ["laser"]
    assert "says nothing" in checks()["laser"].detail
    assert checks()["link"].detail == "connected"
    served.is_deaf = False
    served.advance(2.0)
    assert all(check.ok for check in checks().values())
    served.lines[LASER].error = "no such device"
    assert checks()["laser"].detail == "no such device"
    served.bridge.links["mouse0"] = Line("mouse:/dev/input/mouse0", lambda data: None)
    assert checks()["mouse0"].ok
    served.bridge.links["mouse0"].error = "unplugged"
    assert (checks()["mouse0"].ok, checks()["mouse0"].detail) == (False, "unplugged")
    assert "mouse1" not in checks(), "which it has not"
    status = served.bridge.status()
    status.robot.state = "fault"
    assert "motors" in {check.name for check in checks_of(status) if not check.ok}


def test_the_status_tells_how_fast_the_robot_itself_can_go():
    served = Served()
    served.advance(1.5)
    driver = served.bridge.status().driver
    assert (driver.max_speed, driver.max_turn) == (pytest.approx(math.log(1 / 0.090149) / 6.44209, abs=1e-3), 0.8)
    tired = PARAMS.motors.model_copy(update={"standing": (0.09, 0.5), "track": 0.4})
    robot = MazeRunner(PARAMS.model_copy(update={"motors": tired}))
    wheel = math.log(2.0) / PARAMS.motors.growth[1]
    assert robot.snapshot().fastest == pytest.approx((wheel, 2.0 * wheel / 0.4))
    for share in (0.9, 1.0):
        straight, turn = robot.powers(share * wheel, 0.0), robot.powers(0.0, share * robot.fastest[1])
        assert max(straight.left, straight.right, turn.right) <= 1.0 + 1e-9
    assert robot.powers(wheel, 0.0).right == pytest.approx(1.0)


def test_it_explores_when_it_is_told_to_and_a_hand_on_the_stick_ends_it():
    served = Served()
    served.advance(1.0)
    still = served.virtual.pose
    assert (served.explorer.state, served.bridge.status().driver.exploring) == ("off", "off")
    served.bridge.hear("ann", AutopilotWord(type="autopilot", on=True))
    served.advance(8.0)
    assert served.bridge.status().driver.exploring == "looking"
    assert abs(served.virtual.pose[2] - still[2]) > 0.3
    served.drive(0.1)
    assert served.explorer.state == "off"
    served.advance(0.1)
    assert isinstance(served.bridge.control.wish, Drive)


def test_it_explores_to_the_end_with_nobody_there_and_then_says_so():
    served = Served(autopilot=True)
    for _ in range(120):
        served.advance(1.0)
        if served.explorer.finished:
            break
    status = served.bridge.status()
    assert (status.driver.exploring, status.driver.autopilot) == ("done", False)
    assert status.driver.abandoned == len(served.explorer.left_alone) == 0
    served.explorer.left_alone.append(np.zeros(2))
    assert served.bridge.status().driver.abandoned == 1
    assert served.virtual.body.bumps == 0
    still = served.virtual.pose
    served.advance(2.0)
    assert served.virtual.pose == pytest.approx(still, abs=0.02)
    assert status.map.vertices > 10
    assert status.robot.battery_volts is not None
    assert status.robot.powers is not None
    assert status.robot.tilt_rad is None


def test_a_stop_ends_it_and_it_does_not_begin_again_before_it_is_resumed():
    served = Served(autopilot=True)
    served.advance(3.0)
    served.bridge.hear("bob", PlainWord(type="stop"))
    assert served.explorer.state == "off"
    served.advance(1.0)
    still = served.virtual.pose
    served.advance(1.0)
    assert served.virtual.pose == pytest.approx(still, abs=1e-3)
    with pytest.raises(Refused, match="Resume"):
        served.bridge.hear("ann", AutopilotWord(type="autopilot", on=True))
    served.bridge.hear("ann", PlainWord(type="resume"))
    served.bridge.hear("ann", AutopilotWord(type="autopilot", on=True))
    served.advance(2.0)
    assert served.explorer.state == "looking"


def test_a_board_that_is_gone_is_told_though_its_laser_goes_on():
    served = Served()
    served.advance(1.0)
    assert served.bridge.status().link.connected
    served.lines["link0"].is_connected = False
    served.advance(0.2)
    status = served.bridge.status()
    assert not status.link.connected
    assert status.stops[0].reason == "connection lost"


def test_the_real_program_drives_it_as_the_same_c_does():
    need_simavr()
    way = []
    for build in ("host", "avr"):
        virtual = VirtualMazeRunner(maze("small", 1), seed=1, build=build)
        loop = Headless(virtual, 1)
        loop.run(1.0)
        loop.run(2.0, Drive(0.0, 0.1, 0.3))
        way.append(virtual.pose)
        assert loop.session.frames["laser"] > 10
        assert loop.session.health(virtual.time)["rejected"] == 0
    assert np.hypot(*(way[0] - way[1])[:2]) < 0.02
    assert np.hypot(*way[1][:2]) > 0.08


def test_the_radio_hears_it_no_more_often_than_a_person():
    served = Served(autopilot=True)
    served.advance(1.0)
    written = []
    write = served.lines["link0"].tell
    served.lines["link0"].tell = lambda data: written.append(data) or write(data)
    served.advance(20.0)
    assert 100 < len(written) <= 230


def test_a_choice_that_takes_long_does_not_hold_anybody_up():
    executor = Later()
    served = Served(executor=executor, autopilot=True)
    served.advance(12.0)
    assert executor.waiting
    served.advance(2.0)
    assert len(executor.waiting) == 1, "one at a time"
    assert served.explorer.state == "looking"
    executor.finish()
    served.advance(0.1)
    assert served.explorer.state == "driving"


@pytest.mark.parametrize("rule", ["frontiers", "wall"])
def test_who_sees_nothing_stands_and_waits(rule: Literal["frontiers", "wall"]):
    served = Served(autopilot=True, rule=rule)
    served.is_deaf = True
    served.advance(5.0)
    assert served.virtual.body.distance < 0.01
    assert abs(served.virtual.pose[2] - served.virtual.world.start[2]) < 0.02
    assert "the laser says nothing" in served.bridge.status().link.error
    served.is_deaf = False
    served.advance(6.0)
    assert served.virtual.body.distance + abs(served.virtual.pose[2]) > 0.3
    served.is_deaf = True
    served.advance(1.5)
    still = served.virtual.pose
    served.advance(3.0)
    assert served.virtual.pose == pytest.approx(still, abs=0.01)
    assert served.explorer.autopilot, "it goes on as soon as it sees again"


def test_disarmed_it_stands():
    served = Served(autopilot=True)
    served.advance(4.0)
    served.bridge.hear("ann", ArmWord(type="arm", armed=False))
    served.advance(1.0)
    still = served.virtual.pose
    served.advance(1.0)
    assert served.virtual.pose == pytest.approx(still, abs=1e-3)
    assert served.bridge.status().driver.exploring == "off"


def test_a_board_that_was_gone_is_not_driven_on_when_it_comes_back():
    served = Served(autopilot=True)
    served.advance(4.0)
    served.is_cut = True
    served.advance(4.0)
    assert served.bridge.status().driver.exploring == "off"
    assert served.bridge.status().stops[0].reason == "the robot fell silent"
    still = served.virtual.pose
    served.is_cut = False
    served.advance(2.0)
    assert served.virtual.pose == pytest.approx(still, abs=1e-3)


def test_who_let_it_explore_may_not_leave_it_alone():
    served = Served()
    served.advance(1.0)
    served.bridge.hear("ann", AutopilotWord(type="autopilot", on=True))
    served.advance(2.0)
    served.bridge.left("bob")
    assert served.explorer.autopilot
    served.bridge.left("ann")
    assert not served.explorer.autopilot
    unattended = Served(autopilot=True)
    unattended.advance(2.0)
    unattended.bridge.left("ann")
    assert unattended.explorer.autopilot, "the command line said so"


def test_walls_all_around_are_no_frontier():
    snapshot = dataclasses.replace(MazeRunner(PARAMS).snapshot(), looked=0.0)
    assert choose(snapshot, (), None, ExplorerParams(), navigation_of(SETTINGS, "maze_runner")) is None
    explorer = Explorer(ExplorerParams(around=0.6), NavigatorParams())
    explorer.autopilot = True
    said = [message for t in np.arange(0.0, 8.0, 0.1) for message in explorer.tick(float(t), lambda: snapshot)]
    assert isinstance(said[0], Drive)
    assert isinstance(said[-1], Stop)
    assert explorer.progress == ("done", 0)
    warm_up(ExplorerParams(), NavigatorParams())


def test_it_goes_around_a_maze_along_the_wall():
    settings = load({"explorer": {"rule": "wall"}})
    virtual = VirtualMazeRunner(maze("small", 1), seed=1)
    loop = Headless(virtual, 1, settings)
    assert loop.explore(200.0).progress == ("done", 0)
    assert virtual.body.bumps == 0
    assert len(loop.keyframes) > 20
    assert loop.robot.goal is None

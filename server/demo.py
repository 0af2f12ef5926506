"""`crunch demo`: a virtual robot lives in this process, and is served as a real one would be.

Uses its siblings `live` (what serves it) and `simulate` (which plan a world has).
"""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Literal

from server import live
from server.control import Control
from server.errors import UserError
from server.robots.kinds import LASER, ROBOTS, mouse_lines
from server.simulate import (
    BUMPING,
    ROOM,
    check_mice,
    mendable,
    plan_in,
    virtual_cart,
    with_mice,
    with_rule,
    world_and_plan,
)
from server.transport import Link
from server.virtual_link import SideLink, VirtualLink


def run_demo(
    options: live.LiveOptions,
    autopilot: bool = False,
    world: str | None = None,
    plan: str | None = None,
    drift: Literal["none", "low", "medium", "high"] = "medium",
    speed: float = 1.0,
    build: Literal["host", "avr"] = "host",
    mice: int = 0,
) -> int:
    """Serve a virtual robot in this process until Ctrl-C; exit code.

    `build` is that of the robot's boards. World and plan follow from one another as in `simulate`; a world where no
    tour can be planned has no autopilot. Maze Runner's is its explorer.
    """
    control = Control(options.config.control.at_speed(speed))
    if ROBOTS[options.robot].explores:
        options = replace(options, config=with_rule(options.config, options.robot, plan))
        options, links = virtual_maze_runner(options, world, drift, speed, mice, build)
        return live.run(options, lambda: links, control, autopilot=autopilot, is_virtual=True)
    if ROBOTS[options.robot].bumps:
        if autopilot:
            raise UserError(f"a {options.robot} runs by itself once it is told to on the page; leave out --autopilot")
        links = virtual_cart_line(options, world, plan, drift, speed, mice, build)
        return live.run(options, lambda: links, control, is_virtual=True)
    from firmware import virtual  # the simulator compiles C: only who asks for it pays for it

    check_mice(options.robot, mice)
    with mendable():
        try:
            place, route = world_and_plan(world, plan, options.seed)
        except virtual.PlanError as error:
            if plan is not None or world is None:
                raise
            if autopilot:
                raise UserError(f"--autopilot needs a plan for {world} ({error}); give one with --plan") from None
            place, route = virtual.load_world(world), None
        robot = virtual.VirtualCrunch(place, seed=options.seed, drift=drift, plan=route, build=build)
    robot.autopilot = autopilot
    name = world or plan or plan_in(None)
    own = robot if route else None
    return live.run(
        options, lambda: {"link0": VirtualLink(robot, f"virtual:{name}", speed)}, control, own, autopilot, True
    )


def virtual_maze_runner(
    options: live.LiveOptions,
    world: str | None,
    drift: Literal["none", "low", "medium", "high"],
    speed: float,
    mice: int,
    build: Literal["host", "avr"],
) -> tuple[live.LiveOptions, dict[str, Link]]:
    """The lines of a virtual Maze Runner in a maze, and options that know where its mice sit.

    UserError where there is no world of that name.
    """
    from firmware import virtual
    from firmware.virtual.mice import PLACES

    check_mice(options.robot, mice)
    name = world or f"maze:medium:{options.seed}"
    with mendable():
        robot = virtual.VirtualMazeRunner(
            virtual.load_world(name), seed=options.seed, drift=drift, mice=PLACES[:mice], build=build
        )
    board = VirtualLink(robot, f"virtual:{name}", speed)
    links: dict[str, Link] = {
        "link0": board,
        LASER: SideLink(board, "virtual:laser", robot.write_laser, robot.take_laser),
    }
    for number, link_id in enumerate(mouse_lines(mice)):
        ask = functools.partial(robot.take_mouse, number)
        links[link_id] = SideLink(board, f"virtual:{link_id}", lambda data: None, ask)
    return replace(options, config=with_mice(options.config, mice)), links


def virtual_cart_line(
    options: live.LiveOptions,
    world: str | None,
    plan: str | None,
    drift: Literal["none", "low", "medium", "high"],
    speed: float,
    mice: int,
    build: Literal["host", "avr"],
) -> dict[str, Link]:
    """The line of a virtual cart in a room; it runs once it is armed. UserError for an unknown world."""
    check_mice(options.robot, mice)
    if plan not in (None, BUMPING):
        raise UserError(f"--plan {plan}: {options.robot} drives by none but {BUMPING}")
    with mendable():
        cart = virtual_cart(world, options.config, options.seed, drift, build)
    return {"link0": VirtualLink(cart, f"virtual:{world or ROOM}", speed)}

"""The virtual robots: physics, sensors, radio and worlds around the firmware's own C. Knows no host, only bytes."""

from firmware.virtual.builds import BUILDS, Build
from firmware.virtual.bumper_cart import CartBuild, VirtualCart, run_cart
from firmware.virtual.corridor import corridor_cycle, corridor_plan
from firmware.virtual.host import DRIFTS, Drift
from firmware.virtual.maze_runner import VirtualMazeRunner
from firmware.virtual.mice import Floor, MousePlace
from firmware.virtual.native import CompilerError
from firmware.virtual.plans import Plan, PlanError, load_plan
from firmware.virtual.radio import Radio
from firmware.virtual.robot import VirtualCrunch
from firmware.virtual.routes import route, tour
from firmware.virtual.scripted import ScriptedCrunch
from firmware.virtual.worlds import World, WorldError, load_world

__all__ = [
    "BUILDS",
    "DRIFTS",
    "Build",
    "CartBuild",
    "CompilerError",
    "Drift",
    "Floor",
    "MousePlace",
    "Plan",
    "PlanError",
    "Radio",
    "ScriptedCrunch",
    "VirtualCart",
    "VirtualCrunch",
    "VirtualMazeRunner",
    "World",
    "WorldError",
    "corridor_cycle",
    "corridor_plan",
    "load_plan",
    "load_world",
    "route",
    "run_cart",
    "tour",
]

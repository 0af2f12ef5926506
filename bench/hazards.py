"""Every row of the safety table (firmware/drive/supervisor.h) as something that can be done to a robot.

The one list of what is inflicted, how long the boards may take, and what they must tell; the benchmark prints it and
the tests go through it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from bench.board_watch import LINK_LOST, drive_memory
from bench.boards import Rider, hall
from firmware.virtual.variation import ACCELEROMETER_COUNTS
from server.commands import ArmCommand

STANDING = (0.0, 0.0)
DRIVING = (0.3, 0.0)
STILL_SPEED = 0.05  # m/s
RUNNING_RATE = 8.0  # rad/s of a wheel: 0.4 m/s, which a robot that stands never has
FALLEN_TILT, LOST_TILT = 0.7, 0.25  # rad
HAND_RATE = (
    2.2  # rad/s: slower than what is called tumbling, and 0.7 rad before the motors are at their limit for 0.4 s
)
FULL_DUTY = 0.95
PATIENCE_MS = 5000
GYRO, ACCELEROMETER, BATTERY, LEFT_MOTOR = 0, 1, 3, 6  # the drive board's inputs
BRIDGE_AMPERES = 3.0  # for ever
WATCHDOG, BROWN_OUT = 8, 4  # MCUCSR
ADCSRA, ADIE = 0x26, 3
TIMSK, OCIE2 = 0x59, 7


def until(is_done: Callable[[Rider], bool]) -> Callable[[Rider], int | None]:
    """How many ms pass before it is so; None if they are too many."""

    def measure(rider: Rider) -> int | None:
        for ms in range(PATIENCE_MS):
            if is_done(rider):
                return ms
            rider.live(1)
        return None

    return measure


def is_off(rider: Rider) -> bool:
    """The action of most rows."""
    return rider.is_off


def own(name: str, rider: Rider) -> Any:
    """A variable of the drive board's loop, in its own memory."""
    return drive_memory().read(rider.robot.robot.drive, name)


def leans(rider: Rider, tilt: float) -> bool:
    """Whether the drive board believes that it leans beyond this (rad)."""
    return abs(own("tilt.angle", rider)) > tilt


def off_beyond(tilt: float) -> Callable[[Rider], int | None]:
    """How many ms pass before it is off; None too if it was off before the board believed that it leans beyond this."""
    return lambda rider: until(is_off)(rider) if leans(rider, tilt) or not rider.is_off else None


def is_without_link(rider: Rider) -> bool:
    """The drive board holds the link for lost."""
    return own("supervisor.state", rider) == LINK_LOST


def is_still(rider: Rider) -> bool:
    """Stops, and goes on balancing."""
    return abs(rider.body.speed) < STILL_SPEED and not rider.is_off


def is_reset(rider: Rider) -> bool:
    """The drive board has been reset, and no motor gets current."""
    lib, robot = rider.robot.lib, rider.robot.robot
    return lib.microcontroller_resets(robot.drive) > 1 and rider.has_no_current


def ms_on(rider: Rider) -> int:
    """For how many of the next ms the motors are on."""
    on = 0
    for _ in range(PATIENCE_MS):
        rider.live(1)
        on += not rider.is_off
    return on


def max_amperes(rider: Rider) -> float:
    """Of the two motors' currents the greater."""
    return max(map(abs, rider.body.motor_amperes))


def is_spared(rider: Rider) -> bool:
    """No motor takes more than its bridge bears, though they are on."""
    return max_amperes(rider) <= BRIDGE_AMPERES and not rider.is_off


class Hazard(NamedTuple):
    """One row. `told` are (state, reason) that are true words for it; `reset_causes` those of the status."""

    name: str
    rule: str
    inflict: Callable[[Rider], None]
    allowed_ms: int
    told: tuple[tuple[str, str], ...]
    wish: tuple[float, float] = STANDING  # speed, turn, before and during
    measure: Callable[[Rider], int | None] = until(is_off)
    is_armed: bool = True
    is_on: bool = False  # whether it balances on
    reset_causes: tuple[int, ...] = ()


def drive_unarmed(rider: Rider) -> None:
    """Commands to a robot that nobody has armed."""
    rider.is_silent = False
    rider.tell(*DRIVING)


def arm_with_gyro_at(volts: float) -> Callable[[Rider], None]:
    """Somebody asks it to arm whose gyro shows the same for ever."""

    def inflict(rider: Rider) -> None:
        force(GYRO, volts)(rider)
        rider.wait(2.0)  # in which it is held still
        rider.is_silent = False
        rider.send(ArmCommand(True))

    return inflict


def shove(newtons: float) -> Callable[[Rider], None]:
    """More than it can stand, up to the lean beyond which who tumbles is lost, or to a fall."""

    def inflict(rider: Rider) -> None:
        rider.robot.push(newtons)
        while not (leans(rider, LOST_TILT) or abs(rider.robot.tilt) >= FALLEN_TILT or rider.is_off):
            rider.live(1)
        rider.robot.push(0.0)

    return inflict


def tip(rate: float) -> Callable[[Rider], None]:
    """A hand turns the body about its axle, up to the lean at which it is called a fall."""

    def inflict(rider: Rider) -> None:
        while not (leans(rider, FALLEN_TILT) or rider.is_off):
            rider.body.tilt_rate = rate
            rider.live(1)

    return inflict


def hush(rider: Rider) -> None:
    """No more commands; the last was at most 100 ms ago."""
    rider.is_silent = True


def block(*sides: int) -> Callable[[Rider], None]:
    """Holds wheels: 0 is the left."""

    def inflict(rider: Rider) -> None:
        for side in sides:
            rider.robot.lib.body_block(rider.robot.ffi.addressof(rider.body), side)

    return inflict


def lift(rider: Rider) -> None:
    """A hand takes it off the floor; the time counts from when its wheels run."""
    rider.body.is_lifted = True
    for _ in range(6 * PATIENCE_MS):  # held exactly upright it may be quiet for long
        if max(map(abs, rider.body.wheel_rates)) > RUNNING_RATE:
            return
        rider.live(1)


def weaken(share: float) -> Callable[[Rider], None]:
    """A bad contact leaves a share of the motors' voltage, up to when a motor is given all there is."""

    def inflict(rider: Rider) -> None:
        rider.body.contact = share
        while max(map(abs, rider.robot.duties)) < FULL_DUTY and not rider.is_off:
            rider.live(1)

    return inflict


def overheat(rider: Rider) -> None:
    """Shorted turns in both motors and something in both wheels, until one takes more than its bridge bears."""
    rider.body.shorted = 5.0
    block(0, 1)(rider)
    while max_amperes(rider) <= BRIDGE_AMPERES:
        if rider.is_off:
            raise RuntimeError("the motors went off before they grew warm")
        rider.live(1)


def plug_in(rider: Rider) -> None:
    """The charger."""
    rider.robot.robot.charger_volts = 30.0


def force(channel: int, volts: float) -> Callable[[Rider], None]:
    """An input that shows these volts, whatever is true."""
    return lambda rider: rider.robot.force(channel, volts)


def crook(rider: Rider) -> None:
    """The accelerometer comes loose: 0.3 g off."""
    rider.robot.robot.inertial.accelerometer_zero += 0.3 * ACCELEROMETER_COUNTS


def hang(is_deaf: bool) -> Callable[[Rider], None]:
    """The drive board's program stops where it is, with the motors on; its interrupts go on, or do not."""
    return lambda rider: rider.robot.lib.microcontroller_hang(rider.robot.robot.drive, is_deaf)


def lose(register: int, bit: int) -> Callable[[Rider], None]:
    """A spike clears one bit of the drive board's registers."""

    def inflict(rider: Rider) -> None:
        lib, drive = rider.robot.lib, rider.robot.robot.drive
        lib.microcontroller_poke(drive, register, lib.microcontroller_peek(drive, register) & ~(1 << bit))

    return inflict


def brown_out(rider: Rider) -> None:
    """A dip of the supply resets both boards."""
    rider.robot.lib.microcontroller_brown_out(rider.robot.robot.drive)
    rider.robot.lib.microcontroller_brown_out(rider.robot.robot.sensor)


FAULT = "fault"
HAZARDS: tuple[Hazard, ...] = (
    Hazard("hang", "watchdog, 120 ms", hang(True), 140, (("disarmed", "watchdog"),), DRIVING, until(is_reset),
           reset_causes=(WATCHDOG,)),
    Hazard("hang, interrupts go on", "the same", hang(False), 140, (("disarmed", "watchdog"),), DRIVING,
           until(is_reset), reset_causes=(WATCHDOG,)),
    Hazard("no converter", "the same", lose(ADCSRA, ADIE), 140, (("disarmed", "watchdog"),), DRIVING, until(is_reset),
           reset_causes=(WATCHDOG,)),
    Hazard("no clock", "the same", lose(TIMSK, OCIE2), 140, (("disarmed", "watchdog"),), DRIVING, until(is_reset),
           reset_causes=(WATCHDOG,)),
    Hazard("both boards reset in flight", "off at once; disarmed", brown_out, 5, (("disarmed", "boot"),), DRIVING,
           until(is_reset), reset_causes=(BROWN_OUT, BROWN_OUT)),
    Hazard("a hard shove", "tumbling beyond 0.25 rad, same step", shove(60.0), 25, (("fallen", "fell"),),
           measure=off_beyond(LOST_TILT)),
    Hazard("a shove", "the same", shove(25.0), 25, (("fallen", "fell"),), measure=off_beyond(LOST_TILT)),
    Hazard("a shove from before", "the same", shove(-25.0), 25, (("fallen", "fell"),), measure=off_beyond(LOST_TILT)),
    Hazard("tipped over by a hand", "beyond 0.7 rad, same step", tip(HAND_RATE), 5, (("fallen", "fell"),),
           measure=off_beyond(FALLEN_TILT)),
    Hazard("tipped over backward", "the same", tip(-HAND_RATE), 5, (("fallen", "fell"),),
           measure=off_beyond(FALLEN_TILT)),
    Hazard("never armed", "no motor runs", drive_unarmed, 0, (("disarmed", "boot"),), measure=ms_on, is_armed=False),
    Hazard("asked to arm with a dead gyro", "no motor runs", arm_with_gyro_at(0.0), 0, (("disarmed", "boot"),),
           measure=ms_on, is_armed=False),
    Hazard("asked to arm with a stuck gyro", "the same", arm_with_gyro_at(2.5), 0, (("disarmed", "boot"),),
           measure=ms_on, is_armed=False),
    Hazard("link given up", "400 ms after the last command", hush, 415, (("link lost", "link"),), DRIVING,
           until(is_without_link), is_on=True),
    Hazard("link lost", "400 ms, then slows down and balances", hush, 2500, (("link lost", "link"),), DRIVING,
           until(is_still), is_on=True),
    Hazard("stall", "duty above 0.95 for 0.4 s", weaken(0.5), 600, ((FAULT, "stall"),), DRIVING),
    Hazard("stall that ends as a fall", "the same, leaning beyond 0.25 rad", weaken(0.45), 600, (("fallen", "fell"),),
           DRIVING),
    Hazard("blocked wheel", "duty above 0.3 on a still wheel for 0.4 s", block(0), 700, ((FAULT, "blocked"),), DRIVING),
    Hazard("both wheels blocked", "the same, or it falls first", block(0, 1), 700,
           ((FAULT, "blocked"), ("fallen", "fell")), DRIVING),
    Hazard("picked up", "the wheels gain 0.6 m/s that the body does not", lift, 300, ((FAULT, "lifted"),)),
    Hazard("picked up while driving", "the same", lift, 300, ((FAULT, "lifted"),), DRIVING),
    Hazard("over-current", "a motor above 5 A for 20 ms", force(LEFT_MOTOR, 4.5), 40, ((FAULT, "current"),)),
    Hazard("a motor too warm", "duties held down after 100 ms above 3 A", overheat, 200,
           ((FAULT, "blocked"), ("fallen", "fell")), DRIVING, until(is_spared)),
    Hazard("battery low", "below 24 V no moves; balances", force(BATTERY, 23.5 / 8.0), 2500, (("armed", "battery"),),
           DRIVING, until(is_still), is_on=True),
    Hazard("charger in", "no moves; balances", plug_in, 2500, (("armed", "charger"),), DRIVING, until(is_still),
           is_on=True),
    Hazard("gyro dead", "at an end of the converter for 20 ms", force(GYRO, 0.0), 40, ((FAULT, "sensor"),)),
    Hazard("gyro at its other end", "the same", force(GYRO, 5.0), 40, ((FAULT, "sensor"),)),
    Hazard("accelerometer dead", "the same", force(ACCELEROMETER, 0.0), 40, ((FAULT, "sensor"),)),
    Hazard("accelerometer at its other end", "the same", force(ACCELEROMETER, 5.0), 40, ((FAULT, "sensor"),)),
    Hazard("gyro stuck in the middle", "0.6 m/s that the wheels do not tell", force(GYRO, 2.5), 1000,
           ((FAULT, "disagreement"),), DRIVING),
    Hazard("gyro and accelerometer disagree", "0.6 m/s that the wheels do not tell", crook, 400,
           ((FAULT, "disagreement"),)),
)  # fmt: skip


def suffer(hazard: Hazard, seed: int) -> dict[str, Any]:
    """What one robot did: `ms` to the action (None if never), what it `told`, and whether all is as the table has it
    (`is_right`)."""
    rider = Rider(hall(12.0), (-4.0, 0.0, 0.0), seed)
    if hazard.is_armed:
        if not rider.arm():
            raise RuntimeError("the robot does not arm")
        rider.wait(1.0)
        rider.tell(*hazard.wish)
        rider.wait(2.0 + 0.007 * seed)  # the steps' phase is another one for each seed
    else:
        rider.wait(0.5)
    hazard.inflict(rider)
    ms = hazard.measure(rider)
    rider.wait(0.6)  # the balance frame comes twice a second, or at once
    told = rider.told
    is_right = ms is not None and ms <= hazard.allowed_ms and told in hazard.told and rider.is_off != hazard.is_on
    if hazard.reset_causes:
        rider.wait(1.5)
        is_right = is_right and rider.reset_causes[: len(hazard.reset_causes)] == hazard.reset_causes
    return {"seed": seed, "ms": ms, "told": ", ".join(told), "is_right": is_right}

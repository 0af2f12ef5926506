"""The rides of the bench, with the boards' C on this machine: robots that differ stand, drive and take blows."""

import pytest

from bench import ride
from bench.boards import Rider, hall
from firmware.virtual.variation import Variation
from server.commands import AdjustCommand, ArmCommand

HERE = ride.CASES["the same C on this machine"]
SEEDS = range(3)


@pytest.mark.parametrize("seed", SEEDS)
def test_robots_that_differ_drive_and_turn_as_told(seed):
    record = ride.drive(HERE, seed)
    assert record["is_kept"], record


@pytest.mark.parametrize("seed", SEEDS)
def test_they_take_the_blow_from_both_sides(seed):
    assert ride.recovers(HERE, seed, ride.BLOW)
    assert ride.recovers(HERE, seed, -ride.BLOW)
    assert not ride.recovers(HERE, seed, ride.HARDEST)


@pytest.mark.parametrize("seed", SEEDS)
def test_they_stand_in_their_place(seed, monkeypatch):
    monkeypatch.setattr(ride, "STAND_SECONDS", 60)
    record = ride.stand(HERE, seed)
    assert record["is_kept"], record


def test_a_wall_is_not_climbed():
    record = ride.wall(HERE, 0)
    assert record["is_kept"], record
    assert record["stands"]


def test_a_robot_without_calibration_stands_but_not_in_its_place():
    record = ride.stand(ride.CASES["the same, accelerometer not calibrated"], 0)
    assert record["stands"]
    assert not record["is_kept"]


def test_a_level_that_is_learned_later_takes_the_trim_with_it():
    """Standing on a wrong zero it has learned to lean against it; with the zero right, that would be wrong."""
    rider = Rider(hall(12.0), (0.0, 0.0, 0.0), 1, Variation(accelerometer_zero=0.1), is_real=False)
    rider.arm()
    rider.wait(40.0)
    assert abs(rider.robot.robot.drive.loop.balance.trim) > 0.05
    rider.send(ArmCommand(False))
    rider.is_silent = True
    rider.live(5)
    rider.body.is_held = True
    rider.wait(4.0)
    rider.send(AdjustCommand("drive", "level", "level"))
    rider.wait(1.0)
    assert rider.arm()
    place = rider.position
    rider.wait(20.0)
    assert rider.distance(place) < 0.1

"""The rides of the bench, with the boards' C on this machine: robots that differ stand, drive and take blows."""

import pytest

from bench import ride

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

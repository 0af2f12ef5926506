"""Two scans agree where they were taken, and not where one would see through the other's walls."""

import numpy as np
import pytest

from slam.pose import between, compose
from slam.scan_agreement import BESIDE, AgreementParams, agreement, compare_views, do_agree
from tests.naive import scan_agreement as naive
from tests.slam.laser_world import ring, scan_at

PARAMS = AgreementParams()


@pytest.mark.parametrize("seed", range(6))
def test_counts_are_those_of_asking_every_beam(seed):
    rng = np.random.default_rng(seed)
    scan, other = (scan_at(np.array([x, 1.0, 0.2]), ring(), seed) for x in (2.0, 2.6))
    pose = rng.uniform([-2.0, -1.0, -3.1], [2.0, 1.0, 3.1])
    told = compare_views(scan, other, pose, 0.15, 0.3)
    assert told == naive.compare_views(scan, other, pose, 0.15, 0.3, BESIDE * other.spacing)


def test_scans_agree_as_they_were_taken_and_not_when_one_is_shifted():
    here, there = np.array([3.0, 1.0, 0.0]), np.array([3.4, 1.1, 0.3])
    scan, other = scan_at(there, ring(), 1), scan_at(here, ring(), 2)
    true = between(here, there)
    share, overlap = agreement(scan, other, true, PARAMS)
    assert share > 0.97
    assert overlap > 0.6
    assert do_agree(scan, other, true, PARAMS)
    for off in ([1.2, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.3], [-1.2, 0.0, np.pi / 2]):
        assert not do_agree(scan, other, compose(true, np.array(off)), PARAMS)


def test_agreement_is_mutual():
    here, there = np.array([3.0, 1.0, 0.0]), np.array([5.0, 1.1, 0.2])
    scan, other = scan_at(there, ring(), 1), scan_at(here, ring(), 2)
    forth = agreement(scan, other, between(here, there), PARAMS)
    assert agreement(other, scan, between(there, here), PARAMS) == pytest.approx(forth)

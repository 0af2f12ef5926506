"""Pairs aligned and compared together are what each is alone, on one thread or on several."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from slam.laser_scan import Scan
from slam.pose import between, compose
from slam.scan_agreement import AgreementParams, agreement, views_of
from slam.scan_matching import ScanMatchingParams, match_scans
from slam.scan_pairs import BLOCK, align_pairs, bound, compare_pairs, do_pairs_agree
from tests.slam.laser_world import around, ring, scan_at

PARAMS = ScanMatchingParams(enough=0.3)
AGREEMENT = AgreementParams()


def some_pairs(seed=0, n=20):
    rng = np.random.default_rng(seed)
    poses = around(1.0, step=1.0)[:n]
    scans = [scan_at(pose, ring(), 10 * seed + k) for k, pose in enumerate(poses)]
    none = np.zeros((0, 2))
    scans[7] = Scan(none, none, none[:, 0], none[:, 0], none, scans[7].spacing)  # saw nothing
    pairs = np.array([(i, j) for j in range(n) for i in range(j) if j - i < 5])
    guesses = between(poses[pairs[:, 0]], poses[pairs[:, 1]])
    guesses = compose(guesses, rng.normal(0.0, [0.1, 0.1, 0.05], guesses.shape))
    gates = rng.uniform(0.3, 1.0, len(pairs))
    priors = np.eye(3) / np.column_stack([gates, gates, gates])[:, None] ** 2
    return scans, pairs, guesses, priors, gates


@pytest.fixture(params=[1, 3])
def share(request):
    with ThreadPoolExecutor(request.param) as pool:

        def run(n, task):
            borders = np.linspace(0, n, 2 * request.param + 1).astype(int)
            list(pool.map(task, borders[:-1], borders[1:]))

        yield run


@pytest.mark.parametrize("seed", range(2))
def test_pairs_are_aligned_as_each_is_alone(share, seed):
    scans, pairs, guesses, priors, gates = some_pairs(seed)
    matches = align_pairs(bound(scans), pairs, guesses, priors, gates, PARAMS, share)
    for row, (first, second) in enumerate(pairs):
        alone = PARAMS.model_copy(update={"gate": gates[row]})
        match = match_scans(scans[second], scans[first], guesses[row], priors[row], alone)
        assert matches.shares[row] == match.share
        if match.share >= PARAMS.enough:
            assert np.array_equal(matches.poses[row], match.pose)
            assert np.array_equal(matches.information[row], match.information)
    assert 0.5 < np.mean(matches.shares >= PARAMS.enough) < 1.0


@pytest.mark.parametrize("seed", range(2))
def test_pairs_are_compared_as_each_is_alone(share, seed):
    scans, pairs, guesses, *_ = some_pairs(seed)
    sheaf = bound(scans)
    counts = compare_pairs(sheaf, pairs, guesses, AGREEMENT, share)
    verdicts = do_pairs_agree(sheaf, pairs, counts, AGREEMENT)
    for row, (first, second) in enumerate(pairs):
        scan, other = scans[second], scans[first]
        assert counts[row].tolist() == [list(part) for part in views_of(scan, other, guesses[row], AGREEMENT)]
        agreeing, overlap = agreement(scan, other, guesses[row], AGREEMENT)
        assert verdicts[row] == (agreeing >= AGREEMENT.share and overlap >= AGREEMENT.overlap)
    assert 0.1 < np.mean(verdicts) < 0.9


def test_no_pairs_are_no_work_and_many_give_a_beat_for_each_block():
    scans, pairs, guesses, priors, gates = some_pairs()
    sheaf, none = bound(scans), np.zeros(0, int)
    assert len(align_pairs(sheaf, pairs[none], guesses[none], priors[none], gates[none], PARAMS).poses) == 0
    assert compare_pairs(sheaf, pairs[none], guesses[none], AGREEMENT).shape == (0, 2, 2)
    many, beats = np.resize(np.arange(len(pairs)), 2 * BLOCK + 1), []
    compare_pairs(sheaf, pairs[many], guesses[many], AGREEMENT, beat=lambda: beats.append(1))
    assert len(beats) == 3

"""Many pairs of laser scans at once: aligned by their walls, and compared by what they see through.

All scans lie in one array behind each other, so that a pair is a matter of two kernels, and pairs can be shared out
among threads. Uses its siblings `laser_scan`, `refinement`, for what a beat is, `scan_matching` and `scan_agreement`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from slam.laser_scan import Scan
from slam.refinement import Beat
from slam.scan_agreement import AgreementParams, compare_views
from slam.scan_matching import Rule, ScanMatchingParams, align

Share = Callable[[int, Callable[[int, int], None]], object]  # run task(first, end) over n rows, on all threads
BLOCK = 512  # pairs between two beats


class Sheaf(NamedTuple):
    """The ends of all scans: scan i's are those from `starts[i]` (n + 1,) on; `spacings` (n,) of their beams, rad."""

    points: np.ndarray
    normals: np.ndarray
    bearings: np.ndarray
    ranges: np.ndarray
    starts: np.ndarray
    spacings: np.ndarray


class Matches(NamedTuple):
    """Poses (m, 3) of the second scans in the frames of the first, information (m, 3, 3), and shares (m,) that met."""

    poses: np.ndarray
    information: np.ndarray
    shares: np.ndarray


def bound(scans: Sequence[Scan]) -> Sheaf:
    """All scans together; ValueError for none."""
    starts = np.cumsum([0, *(len(scan.points) for scan in scans)])
    points, normals, bearings, ranges = (
        np.concatenate([getattr(scan, name) for scan in scans]) for name in ("points", "normals", "bearings", "ranges")
    )
    return Sheaf(points, normals, bearings, ranges, starts, np.array([scan.spacing for scan in scans]))


@njit(cache=True, inline="always")
def scan_at(sheaf, row):
    """One of the scans; how far its beams went freely is not told."""
    low, high = sheaf.starts[row], sheaf.starts[row + 1]
    return Scan(
        sheaf.points[low:high], sheaf.normals[low:high], sheaf.bearings[low:high], sheaf.ranges[low:high],
        sheaf.points[low:low], sheaf.spacings[row],
    )  # fmt: skip


@njit(cache=True, nogil=True)
def align_rows(sheaf, pairs, poses, priors, gates, rule, information, shares, first, end):
    """Align the pairs first..end from `poses` (m, 3), in place, with `priors` (m, 3, 3) on them and `gates` (m,)."""
    for row in range(first, end):
        scan, other = scan_at(sheaf, pairs[row, 1]), scan_at(sheaf, pairs[row, 0])
        shares[row] = 0.0
        if scan.points.shape[0] > 0 and other.points.shape[0] > 0:
            own = Rule(rule.rounds, gates[row], rule.last_gate, rule.like, rule.sigma)
            met = align(scan, other, poses[row], priors[row], own, information[row])
            shares[row] = met / scan.points.shape[0]


@njit(cache=True, nogil=True)
def compare_rows(sheaf, pairs, poses, near, far, counts, first, end):
    """Fill `counts` (m, 2, 2): ends that agree and that see through, of the second scan and of the first."""
    back = np.empty(3)
    for row in range(first, end):
        scan, other, pose = scan_at(sheaf, pairs[row, 1]), scan_at(sheaf, pairs[row, 0]), poses[row]
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        back[0], back[1], back[2] = -cos * pose[0] - sin * pose[1], sin * pose[0] - cos * pose[1], -pose[2]
        counts[row, 0, 0], counts[row, 0, 1] = compare_views(scan, other, pose, near, far)
        counts[row, 1, 0], counts[row, 1, 1] = compare_views(other, scan, back, near, far)


def by_itself(n: int, task: Callable[[int, int], None]) -> None:
    """Rows shared out among no other threads."""
    task(0, n)


def in_blocks(n: int, share: Share, beat: Beat, task: Callable[[int, int], None]) -> None:
    """Run task(first, end) over n rows, with a beat now and then."""
    for start in range(0, n, BLOCK):
        share(min(BLOCK, n - start), lambda first, end: task(start + first, start + end))  # noqa: B023 (run at once)
        beat()


def align_pairs(
    sheaf: Sheaf, pairs: np.ndarray, guesses: np.ndarray, priors: np.ndarray, gates: np.ndarray,
    params: ScanMatchingParams, share: Share = by_itself, beat: Beat = lambda: None,
) -> Matches:  # fmt: skip
    """`slam.scan_matching.match_scans` for each of `pairs` (m, 2), but that the caller judges the shares.

    From `guesses` (m, 3), with the information `priors` (m, 3, 3) on them, and `gates` (m,) m of their own.
    """
    poses = np.array(guesses, float)
    information, shares = np.array(priors, float), np.zeros(len(pairs))
    rule = Rule(params.rounds, params.gate, params.last_gate, params.like, params.sigma)
    in_blocks(len(pairs), share, beat, lambda first, end: align_rows(
        sheaf, pairs, poses, priors, gates, rule, information, shares, first, end
    ))  # fmt: skip
    return Matches(poses, information, shares)


def do_pairs_agree(sheaf: Sheaf, pairs: np.ndarray, counts: np.ndarray, params: AgreementParams) -> np.ndarray:
    """Whether the scans of `pairs` (m, 2) see the same walls, and neither through the other's, by their counts."""
    sizes = np.maximum(1, np.diff(sheaf.starts))
    overlaps = np.minimum(counts[:, 0, 0] / sizes[pairs[:, 1]], counts[:, 1, 0] / sizes[pairs[:, 0]])
    shares = counts[:, :, 0].sum(axis=1) / np.maximum(1, counts.sum(axis=(1, 2)))
    return (shares >= params.share) & (overlaps >= params.overlap)


def compare_pairs(
    sheaf: Sheaf, pairs: np.ndarray, poses: np.ndarray, params: AgreementParams, share: Share = by_itself,
    beat: Beat = lambda: None,
) -> np.ndarray:  # fmt: skip
    """Counts (m, 2, 2) as of `slam.scan_agreement.views_of` for `pairs` (m, 2), the second scans at poses (m, 3)."""
    counts, poses = np.zeros((len(pairs), 2, 2), np.int64), np.ascontiguousarray(poses, float)
    in_blocks(len(pairs), share, beat, lambda first, end: compare_rows(
        sheaf, pairs, poses, params.near, params.far, counts, first, end
    ))  # fmt: skip
    return counts

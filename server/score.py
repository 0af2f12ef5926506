"""How good a replay was: its trajectory against the truth or against relations verified by hand, as plain numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from server.errors import UserError
from server.formats.relations import read_relations
from server.formats.tum import read_tum
from slam.evaluate import absolute_error, relations_error, relative_error, revisits
from slam.timeline import associate

TRAJECTORY = "trajectory.tum"
MAX_DIFFERENCE = 0.02  # s between an estimate and the truth that belong together: one odometry reading


def score(
    directory: Path | str,
    truth: Path | str | None = None,
    relations: Path | str | None = None,
    time_offset: float = 0.0,
    is_aligned: bool = True,
) -> dict[str, Any]:
    """ATE and RPE against a TUM file, errors of relations; truth time = estimate time + `time_offset`.

    UserError where a file cannot be read, nothing is asked for, or no two times match.
    """
    if truth is None and relations is None:
        raise UserError("nothing to score against; give --truth FILE.tum, --relations FILE.relations, or both")
    path = Path(directory)
    path = path if path.is_file() else path / TRAJECTORY
    times, poses = read_tum(path)
    scores: dict[str, Any] = {"trajectory": str(path), "poses": len(times), "time_offset_s": time_offset}
    if truth is not None:
        scores |= against_truth(times, poses, Path(truth), time_offset, is_aligned)
    if relations is not None:
        scores |= against_relations(times, poses, Path(relations), time_offset)
    return scores


def against_truth(
    times: np.ndarray, poses: np.ndarray, path: Path, time_offset: float, is_aligned: bool
) -> dict[str, Any]:
    """ATE, RPE over steps of one metre, and the error between true visits of one place."""
    true_times, true_poses = read_tum(path)
    matches = associate(times, true_times, time_offset, MAX_DIFFERENCE)
    if not matches.rows.size:
        span = f"{times.min() + time_offset:.3f} to {times.max() + time_offset:.3f}"
        raise UserError(
            f"{path}: no pose within {MAX_DIFFERENCE} s of the trajectory's ({span}, here {true_times.min():.3f} to "
            f"{true_times.max():.3f}); shift them with --time-offset"
        )
    estimate, reference = poses[matches.rows], true_poses[matches.reference_rows]
    return {
        "truth": str(path),
        "poses_used": int(matches.rows.size),
        "aligned": is_aligned,
        "ate": absolute_error(estimate, reference, is_aligned).to_dict(),
        "rpe_per_metre": relative_error(estimate, reference).to_dict(),
        "revisits": revisits(estimate, reference).to_dict(),
    }


def against_relations(times: np.ndarray, poses: np.ndarray, path: Path, time_offset: float) -> dict[str, Any]:
    """Errors of the relative poses."""
    errors = relations_error(times, poses, read_relations(path), time_offset)
    if not errors.translation.n:
        raise UserError(f"{path}: no relation lies within the trajectory's time; shift them with --time-offset")
    return {"relations_file": str(path), "relations": errors.to_dict()}

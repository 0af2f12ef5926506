"""Bundle a drive's single readings: least squares over places on the way, so that echoes of one wall make one line.

The path filter closes the loops with local maps of half a metre of drive each; from there `bundle` moves places a
quarter of a metre apart until the echoes of thin beams (`slam.echoes`) fall on common walls, as far as the odometry and
its biases allow. It is bundle adjustment with walls for landmarks: they are found anew in every round among the echoes
themselves, neighbouring places included, which is what scan matching would do. Where sweeps come farther apart than
places should stand, echoes are as much sparser, and walls are looked for as much farther around.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from slam.echo_matching import EchoMatches
from slam.echoes import Echoes, EchoParams
from slam.motion import MotionParams
from slam.odometry_chain import Chain
from slam.params import Params
from slam.pose_graph import descend
from slam.refinement import Problem, Refined


class BundleParams(Params):
    """How echoes are bundled; `rounds = 0` switches it off."""

    rounds: int = Field(default=0, ge=0, le=100)  # walls are found anew in each; 14 are enough
    steps: int = Field(default=1, ge=1, le=1000)  # of the search in a round, at most
    partners: int = Field(default=8, ge=1, le=100)  # echoes of the same wall that one is compared with
    sigma: float = Field(default=0.15, gt=0.0)  # m of an echo off another's wall; large, for partners err together
    gate: float = Field(default=0.8, gt=0.0)  # m between echoes of one wall in the first round
    last_gate: float = Field(default=0.2, gt=0.0)  # m, in the last
    kernel: float = Field(default=0.8, gt=0.0)  # m off a wall from which an echo counts less, in the first round
    last_kernel: float = Field(default=0.06, gt=0.0)  # m, in the last
    like: float = Field(default=0.9, ge=-1.0, le=1.0)  # cosine between the normals of one wall
    radius: float = Field(default=0.35, gt=0.0)  # m around an echo that its wall's direction is taken from
    last_radius: float = Field(default=0.25, gt=0.0)  # m, in the second half of the rounds
    visit: float = Field(default=2.5, gt=0.0)  # m of path whose echoes make one wall, until then
    echoes: EchoParams = EchoParams()


def bundle(poses: np.ndarray, chain: Chain, echoes: Echoes, motion: MotionParams, params: BundleParams) -> Refined:
    """Better poses for the nodes of `echoes`, which stand at `poses` (n, 3) by a good guess, to half a metre or so.

    The cost told is what is saved against echoes that match nothing, below 0 as a rule: paths of one drive can be
    compared by it, and one whose echoes make fewer common walls costs more.
    """
    poses = np.array(poses, float)
    matches = EchoMatches(echoes, params.sigma, params.partners)
    problem = Problem(chain, motion, [matches], np.zeros(len(poses), complex), 1.0)
    shared, cost = problem.start(poses), 0.0
    sparseness = sparseness_of(chain, params.echoes)
    for round_ in range(params.rounds if len(poses) > 1 else 0):
        done = round_ / max(1, params.rounds - 1)
        is_early = 2 * round_ < params.rounds
        matches.associate(
            poses,
            radius=sparseness * (params.radius if is_early else params.last_radius),
            window=round(params.visit / params.echoes.spacing) if is_early else len(poses),
            gate=params.gate * (params.last_gate / params.gate) ** done,
            like=params.like,
            kernel=params.kernel * (params.last_kernel / params.kernel) ** done,
        )
        poses, shared, cost = descend(problem, poses, shared, params.steps)
    return Refined(poses, shared, cost - matches.unmatched_cost, np.stack([matches.first, matches.second], axis=1))


def sparseness_of(chain: Chain, params: EchoParams) -> float:
    """How many times farther apart the nodes stand than wanted, since no sweep came in between; 1 as a rule."""
    spacing = float(np.median(chain.travelled[1:])) if len(chain.travelled) > 1 else 0.0
    return max(1.0, spacing / params.spacing)

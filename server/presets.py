"""Settings that belong together under one name: thesis and paper taken literally, and robots that are not Crunch.

A foreign log names the preset of the robot that made it; what a person says wins over that.
"""

from __future__ import annotations

from typing import Any

THESIS: dict[str, Any] = {
    "crunch": {
        "hindsight": 0,
        "refinement": {"rounds": 0},
        "local_map": {"reach": 1.0, "bridge": 0.0, "resample": True},
        "walls": {"thickness": 1e-3},  # the first point above the threshold
        "vfh": {"radial_sum": True, "robot_radius": 0.0, "clearance": 0.0},
        "filter": {
            "islands": 1,
            "motion": {"rotation_noise": 0.0, "turn_bias": 0.0, "scale_bias": 0.0, "jitter": 0.0},
            "direction": {"gain": 0.0},
            "comparison": {
                "affinity": {"states": 2, "both_free": 1.0, "both_wall": 1.0, "differ": -1.0, "gain": 0.3},
            },
        },
    }
}
# A gyroscope keeps the heading better than wheels do; optical flow measures distances no better.
CRAZYFLIE: dict[str, Any] = {
    "crunch": {"filter": {"motion": {"turn_noise": 0.02, "turn_bias": 0.01}}, "bundle": {"rounds": 14}}
}
# Beams that see far: one label in a hundred is wrong rather than one in ten, so that disagreement says more; walls
# stand about a corridor's width off, not as far as the beams reach; and single echoes are exact enough to be bundled.
BEAMS: dict[str, Any] = {
    "crunch": {
        "local_map": {"farthest": 10.0 / 3.0},
        "filter": {
            "comparison": {"affinity": {"differ": -3.0, "gain": 8.0, "spread": 0.4}},
        },
        "bundle": {"rounds": 14},
    }
}

# Maze Runner as its authors have it: a scan aligned with the one before, and their three algorithms at every decimetre.
PAPER: dict[str, Any] = {
    "maze_runner": {
        "estimator": "paper",
        "vertex_spacing": 0.1,
        "vertex_turn": 0.1,
        "odometry": {"has_map": False},
    }
}

NAMED: dict[str, dict[str, Any]] = {"thesis": THESIS, "paper": PAPER, "beams": BEAMS, "crazyflie": CRAZYFLIE}

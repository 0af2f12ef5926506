"""What viewers get of the navigator's way and of the adviser's suggestions: topics `route` and `suggestions`.

Uses its siblings `layers` and `views`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from server.layers import View
from server.messages import Snapshot
from server.navigator import Standing, metres_left
from server.views import rounded
from slam.suggestions import Suggestion


def route_view(snapshot: Snapshot, standing: Standing) -> View:
    """What is left of the way to the goal, the goal being its last place, and how it stands with it.

    A robot that was sent straight to a goal, without a plan, drives too.
    """
    goal = snapshot.goal
    state = "driving" if goal is not None and standing.state in ("none", "blocked") else standing.state
    places = np.zeros((0, 2)) if goal is None else np.vstack([snapshot.route, goal])
    return View(
        {
            "goal": None if goal is None else rounded(goal),
            "remaining_m": round(metres_left(snapshot), 1),
            "state": state,
            "reason": standing.reason if state == "blocked" else "",
        },
        {"route": places.astype(np.float32)},
    )


def suggestions_view(suggestions: Sequence[Suggestion]) -> View:
    """Places worth driving to, best first."""
    return View({"suggestions": [described(suggestion) for suggestion in suggestions]})


def described(suggestion: Suggestion) -> dict[str, float | str]:
    """One suggestion, for programs and for people."""
    x, y = rounded(suggestion.place)
    surer = f"{suggestion.gain:.1f} m" if suggestion.gain >= 0.95 else f"{100.0 * suggestion.gain:.0f} cm"
    return {
        "x": x,
        "y": y,
        "gain_m": round(suggestion.gain, 2),
        "drive_m": round(suggestion.drive, 1),
        "text": f"Drive {suggestion.drive:.0f} m to here, then on along the old path: the map gets {surer} surer.",
    }

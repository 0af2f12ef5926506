"""Areas that tests of the cart's estimators drive in."""

from __future__ import annotations

import numpy as np

RECTANGLE = [np.array([[0.0, 0.0], [1.5, 0.0], [1.5, 1.1], [0.0, 1.1]])]
CUT = [np.array([[0.0, 0.0], [1.5, 0.0], [1.5, 0.75], [1.1, 1.15], [0.0, 1.15]])]
PILLAR = [*CUT, np.array([[0.5, 0.5], [0.7, 0.45], [0.72, 0.65], [0.55, 0.7]])]

"""The page's colours that mean different things look different to any colour vision, in light and in dark.

Colour vision is simulated as Machado, Oliveira and Fernandes (2009) do at full severity, on linear RGB; how different
two colours look is their distance in CIELAB (CIE 1976).
"""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from server.map_picture import OPEN_TINT, SETTLED_TINT

SHEET = (Path(__file__).parents[2] / "web" / "style.css").read_text()
DEFINED = re.findall(r"--([\w-]+): light-dark\((#\w{6}), (#\w{6})\);", SHEET)
THEMES = {theme: {row[0]: row[column] for row in DEFINED} for column, theme in ((1, "light"), (2, "dark"))}
LEAST = 15.0  # far above what is just noticed (2.3): the marks are thin and far apart
PAIRS = [
    ("settled", "open"), ("goal", "steering"), ("good", "warn"), ("good", "bad"), ("warn", "bad"),
    ("particle", "settled"), ("particle", "open"), ("sonar", "infrared"), ("wall", "steering"),
    *itertools.combinations([f"valley-{n}" for n in range(1, 5)], 2),
]  # fmt: skip
VISIONS = {
    "normal": np.eye(3),
    "protan": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deutan": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritan": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = XYZ.sum(axis=1)


def linear(colour: str) -> np.ndarray:
    """Linear RGB (3,), 0 to 1, of `#rrggbb`."""
    value = np.frombuffer(bytes.fromhex(colour[1:]), np.uint8) / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lab(colour: str, vision: np.ndarray) -> np.ndarray:
    """CIELAB (3,) of a colour as somebody with this vision (3, 3) sees it."""
    seen = XYZ @ np.clip(vision @ linear(colour), 0.0, 1.0) / WHITE
    x, y, z = np.where(seen > 0.008856, np.cbrt(seen), 7.787 * seen + 16.0 / 116.0)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def difference(one: str, other: str, vision: np.ndarray) -> float:
    return float(np.linalg.norm(lab(one, vision) - lab(other, vision)))


def test_the_simulation_keeps_greys_and_confuses_what_is_confused():
    assert difference("#000000", "#ffffff", VISIONS["normal"]) == pytest.approx(100.0, abs=0.1)
    for vision in VISIONS.values():
        assert difference("#808080", "#808080", np.eye(3)) == difference("#808080", "#808080", vision) == 0.0
        np.testing.assert_allclose(lab("#808080", vision), lab("#808080", np.eye(3)), atol=0.1)
    red, green = "#a05000", "#508000"
    assert difference(red, green, VISIONS["deutan"]) < 0.4 * difference(red, green, VISIONS["normal"])


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("theme", THEMES)
def test_colours_that_mean_different_things_look_different(theme: str, vision: str):
    colours = THEMES[theme]
    found = {pair: difference(colours[pair[0]], colours[pair[1]], VISIONS[vision]) for pair in PAIRS}
    assert {pair: round(value, 1) for pair, value in found.items() if value < LEAST} == {}


@pytest.mark.parametrize("vision", VISIONS)
def test_two_maps_in_a_comparison_look_different(vision: str):
    assert difference(SETTLED_TINT, OPEN_TINT, VISIONS[vision]) > LEAST


def test_where_hue_could_mislead_there_is_a_shape_too():
    """Levels carry marks, the commanded arrow is dashed, and of two maps laid over each other one is the thicker."""
    for level, mark in (("warn", "!"), ("bad", "!!")):
        assert re.search(rf'\[data-level="{level}"\] b::after.*content: " {mark}"', SHEET)
    web = Path(__file__).parents[2] / "web"
    histogram, plan = (web / "histogram.js").read_text(), (web / "plan.js").read_text()
    assert re.search(r'"steering", [\d.]+, DASHES\)', histogram)
    thick, thin = (float(re.search(rf'\["{name}", ([\d.]+),', plan)[1]) for name in ("settled", "open"))  # type: ignore[index]
    assert thick > 2.0 * thin

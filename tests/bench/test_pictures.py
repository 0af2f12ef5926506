"""Pictures are drawn from what a benchmark kept, whichever of its rows there are."""

from __future__ import annotations

import numpy as np

from bench import beams, pictures
from bench.benchmark import Crew
from bench.command import run


def made(case: beams.Case, seed: int) -> dict[str, float]:
    """A record as of a run, without running."""
    errors = {"mean": 0.05 + 0.01 * seed, "degrees": 1.5} if "intel" in case.log else {}
    record = {f"{prefix}{key}": value for prefix in ("", "thesis_", "odometry_") for key, value in errors.items()}
    return {"seed": seed, "beams": case.beams, "reach": case.reach, "ate": 0.2, "closed": True} | record


def made_rows(crew: Crew):
    """Rows of an Intel of two numbers of beams, and an ACES."""
    cases = {
        "Intel, 4 beams": beams.Case("intel/a.log", 4),
        "Intel, 11 beams": beams.Case("intel/a.log", 11),
        "Intel, 11 beams of 5 m": beams.Case("intel/a.log", 11, 5.0),
        "ACES": beams.Case("aces/b.log", 11),
    }
    for name, case in cases.items():
        yield beams.Row(name, [made(case, seed) for seed in range(crew.seeds)])


def test_errors_are_drawn_against_beams():
    (*_, result) = run(beams.BENCH._replace(rows=made_rows), 3)
    figure = pictures.beams(result)
    mean, turn = figure.axes
    crunch = mean.get_lines()[0]
    np.testing.assert_allclose(np.asarray(crunch.get_xdata()), [4, 11])
    np.testing.assert_allclose(np.asarray(crunch.get_ydata()), [0.06, 0.06], err_msg="the median over the seeds")
    legend = turn.get_legend()
    assert legend is not None
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["Crunch", "the thesis's filter", "odometry", "Sparse-GSLAM, published", "GMapping, published"]
    assert [row.cells[2] for row in result.rows][-1] == "-", "no relations of ACES"
    assert any("ACES, by seed (m): 0.2000" in note for note in result.notes)

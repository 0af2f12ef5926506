"""The benchmarks of carts in small: what a metre's drive tells, and the pictures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench import bump_localization, cart_pictures
from bench.cart_lessons import ARCS, BENCH, COARSE, METRE, track
from bench.cart_lessons import MANNERS as DRIVEN
from bench.result import Machine, Result, ResultRow


def made(name, rows):
    machine = Machine.model_construct()
    return Result.model_construct(
        name=name, machine=machine, rows=[ResultRow(name=key, cells=[], records=found) for key, found in rows.items()]
    )


def test_a_metre_on_arcs_is_told_and_one_by_eight_powers_is_longer_than_told():
    longer = {}
    for manner in (ARCS, COARSE):
        ways, missed = [], []
        for seed in range(6):
            poses, told = track(DRIVEN[manner], seed)
            assert METRE <= math.hypot(*poses[-1, :2]) < METRE + 0.02
            ways.append(np.sum(np.hypot(*np.diff(poses[:, :2], axis=0).T)) / math.hypot(*poses[-1, :2]))
            missed.append(math.hypot(*(told[:2] - poses[-1, :2])))
        longer[manner] = np.median(ways), np.median(missed)
    assert longer[ARCS][0] < 1.01 < longer[COARSE][0]
    assert longer[ARCS][1] < 0.06 < longer[COARSE][1]


def test_lessons_are_drawn_with_medians_by_manner_and_by_width():
    record = {"track": [[0.0, 0.0], [1.0, 0.1]], "place": 2.0, "error": 0.01}
    rows = {
        ARCS: [record, record | {"place": 4.0, "error": 0.03}, record | {"place": 6.0, "error": 0.05}],
        "bumper 40 mm": [record | {"error": 0.2}],
    }
    tracks, ends, widths = cart_pictures.bump_lessons(made(BENCH.name, rows)).axes
    assert list(np.asarray(tracks.get_lines()[0].get_ydata())) == [0.0, 10.0]
    assert list(np.asarray(ends.get_lines()[1].get_ydata())) == [4.0, 4.0]
    middle = max(widths.get_lines()[:-1], key=lambda line: len(set(np.asarray(line.get_xdata()))))
    assert list(np.asarray(middle.get_xdata())) == pytest.approx([40.0, 76.2])
    assert list(np.asarray(middle.get_ydata())) == [0.2, 0.03]


def test_shares_are_drawn_against_particles_for_each_rule():
    right = {"is_right": True, "is_wrong": False, "hits": 6}
    wrong = {"is_right": False, "is_wrong": True, "hits": None}
    rows = {
        "paper, 300 particles": [wrong, wrong],
        "ours, 300 particles": [right, wrong],
        "ours, 700 particles": [right],
    }
    shares, wrongs, hits = cart_pictures.bumps(made("bumps", rows)).axes
    ours = next(line for line in shares.get_lines() if line.get_label() == "ours")
    assert (list(np.asarray(ours.get_xdata())), list(np.asarray(ours.get_ydata()))) == ([300, 700], [50.0, 100.0])
    paper = next(line for line in wrongs.get_lines() if line.get_label() == "paper")
    assert list(np.asarray(paper.get_ydata())) == [100.0]
    none = next(line for line in hits.get_lines() if str(line.get_label()).startswith("paper, median"))
    assert np.isnan(np.asarray(none.get_ydata(), float)).all(), "who was never right needed no number of bumps"


def test_sensitivity_is_drawn_around_what_is_usual():
    rows = {"ours": [{"is_right": True}], "ours, band times 2": [{"is_right": True}, {"is_right": False}]}
    figure = cart_pictures.bump_sensitivity(made("bump-sensitivity", rows))
    axes = next(axes for axes in figure.axes if axes.get_title() == "band")
    line = next(line for line in axes.get_lines() if line.get_label() == "ours")
    assert list(np.asarray(line.get_xdata())) == [1.0, 2.0]
    assert list(np.asarray(line.get_ydata())) == [100.0, 50.0]
    assert len(figure.axes) == len(bump_localization.SENSITIVE)


def test_maps_of_unknown_rooms_are_drawn_by_rank():
    def record(error):
        return {
            "error": error,
            "raw_error": 0.3,
            "room": 100,
            "walls": [[[0, 0], [1, error]]],
            "contacts": [[0, 0], [1, 1]],
        }

    rows = {"50 bumps": [record(0.2)], "100 bumps": [record(error) for error in (0.05, 0.01, 0.4)]}
    errors, *rooms = cart_pictures.bump_mapping(made("bump-mapping", rows)).axes
    assert list(np.asarray(errors.get_lines()[0].get_ydata())) == [0.2, 0.05]
    assert [axes.get_title() for axes in rooms] == ["best of 3: 1.0 cm", "middle of 3: 5.0 cm", "worst of 3: 40.0 cm"]
    for axes, error in zip(rooms, (0.01, 0.05, 0.4), strict=True):
        [mapped] = [line for line in axes.get_lines() if line.get_label() == "mapped"]
        assert np.asarray(mapped.get_ydata())[-1] == error


def test_merged_maps_are_drawn_against_the_number_of_carts():
    one = {"error": 0.02, "alone": 0.02, "seconds": 1.0}
    rows = {"1 cart": [one], "10 carts": [one | {"error": 0.004}, one | {"error": 0.006, "seconds": 9.0}]}
    errors, times = cart_pictures.bump_merging(made("bump-merging", rows)).axes
    merged = next(line for line in errors.get_lines() if line.get_label() == "merged map")
    assert list(np.asarray(merged.get_xdata())) == [1, 10]
    assert list(np.asarray(merged.get_ydata())) == pytest.approx([20.0, 5.0])
    assert list(np.asarray(times.get_lines()[0].get_ydata())) == pytest.approx([1.0, 5.0])

"""The thesis's claims are measured by what they say: rules cut short what they may, hooks change nothing unasked."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.benchmark import Row
from bench.claims import BENCH, CLAIMS, blur, crossing, pairs, points, resampling, search
from bench.claims.__main__ import PAGE, picture_of, texts_of
from bench.claims.drives import Watched, jobs, out_and_back, outcome, world_of
from bench.claims.findings import Effort, Findings, markdown, renewed
from bench.claims.plots import save
from bench.command import run as run_benchmark
from bench.result import Results
from slam.affinity import AffinityParams
from slam.path_filter import PathFilter, PathFilterParams
from slam.resampling import effective_sample_size
from tests.slam.drives import REACH, laps

TINY = Effort(seeds=1, particles=50, length=20.0, pairs=20)
PARAMS = AffinityParams(n_points=64)
SCORES = st.lists(st.sampled_from([0.0, PARAMS.both_free, PARAMS.both_wall, PARAMS.differ]), min_size=64, max_size=64)


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    """Drives of these tests are not the benchmarks'."""
    folder = tmp_path_factory.mktemp("drives")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bench.recordings.CACHE", folder)
        patch.setattr("bench.claims.drives.CACHE", folder)
        yield


def run(path_filter, n_laps=1.5):
    """A filter after a drive around a corridor."""
    drive = laps(n_laps, noise=1.0, seed=1)
    for k in range(len(drive.truth)):
        path_filter.extend(drive.odometry[k], drive.walls[k], drive.travelled[k])
    return path_filter


def params_of(**changes):
    return PathFilterParams.model_validate({"particles": 60, "reach": REACH} | changes)


# All claims


@pytest.mark.parametrize("name", CLAIMS)
def test_every_claim_gives_tables_that_the_page_has_a_place_for_and_a_picture(name, tmp_path, monkeypatch):
    monkeypatch.setattr(blur, "PRESETS", ("thesis",))
    monkeypatch.setattr(search, "PATIENT", 20)
    measure, draw = CLAIMS[name]
    findings = measure(TINY)
    for rows in findings.tables.values():
        assert len({tuple(row) for row in rows}) == 1, "rows of a table share their columns"
        assert markdown(rows).count("\n") == len(rows) + 1
    assert renewed(PAGE.read_text(), {f"{name}-made": "", **dict.fromkeys(findings.tables, "")})
    save(draw, findings, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")
    assert picture_of(name).is_file()
    assert f"(images/claims-{name}.png)" in PAGE.read_text()


def test_only_what_stands_between_the_marks_is_renewed():
    page = "before\n<!-- a -->\nold\n<!-- end -->\nafter\n<!-- b -->\nkept\n<!-- end -->\n"
    table = markdown([{"x": 1, "y (m)": 0.12345}, {"x": 2, "y (m)": 1234.5}])
    assert renewed(page, {"a": table}) == page.replace("old", "| x | y (m) |\n|---|---|\n| 1 | 0.123 |\n| 2 | 1234 |")
    assert renewed(renewed(page, {"a": table}), {"a": table}) == renewed(page, {"a": table})
    with pytest.raises(KeyError, match="no place for c"):
        renewed(page, {"c": table})


def test_the_page_has_what_the_command_kept():
    """Results that went through JSON fill the page's places; the line under them names command and machine."""
    findings = crossing.table(crossing.curves())
    record = {"tables": {"crossing-still": findings}, "curves": {}, "seconds": 123.0}
    bench = BENCH._replace(rows=lambda crew: [Row("crossing", [record])])
    *_, result = run_benchmark(bench, 3)
    read = Results.model_validate_json(Results(results={"claims": result}).model_dump_json()).results["claims"]
    assert texts_of(read)["crossing-still"] == markdown(findings)
    assert texts_of(read)["crossing-made"].startswith("*`crunch bench claims --only crossing --seeds 3`, ")
    assert read.machine.processor in texts_of(read)["crossing-made"]


# Blur


@pytest.mark.parametrize("rate", [50.0, 10.0])
def test_a_resampled_wall_widens_as_the_shares_of_its_cells_say(rate):
    """A bilinear step by a share f of a cell adds f (1 - f) cells squared to the variance."""
    step = blur.SPEED / rate / 0.025
    share = step - math.floor(step)
    still, *later = blur.carried("driven", 0.0, True, rate)
    for row in later[:3]:
        moves = math.ceil(float(row["way"]) / blur.SPEED * rate - 1e-9)
        expected = math.hypot(float(still["width"]), 2.5 * math.sqrt(moves * share * (1.0 - share)))
        assert row["width"] == pytest.approx(expected, rel=0.1)  # the map's border cuts the tails


def test_a_scrolled_wall_stays_as_it_is():
    for motion, direction in blur.CASES.values():
        rows = blur.carried(motion, direction, False, 10.0)
        assert [row["width"] for row in rows] == pytest.approx([rows[0]["width"]] * len(rows))
        assert all(row["found"] == 100.0 for row in rows)


# Affinities


@pytest.mark.parametrize("kind", ["points, 2 states", "points, 3 states"])
def test_single_points_add_up_to_the_librarys_affinity(kind):
    motions = [np.zeros(3), np.array([0.1, -0.2, 0.3]), np.array([-0.4, 0.1, 2.0]), np.array([1.5, 0.7, -1.0])]
    seen = [(crossing.sight(a), crossing.sight(b), np.zeros(3), motion)
            for a in crossing.SCENES for b in crossing.SCENES for motion in motions]  # fmt: skip
    params = pairs.params_of(kind)
    scores = pairs.point_scores(pairs.paired(seen, params, 1.0), pairs.points_of(params, 1.0), params)
    whole = [pairs.affinity(params, a, b, motion, 1.0) for a, b, _, motion in seen]
    off = np.abs(scores.mean(axis=1) - whole)
    assert off.max() <= 2.5 * 2.0 / params.n_points  # a point on the edge of two cells may fall into either
    assert np.median(off) < 1e-9


@pytest.mark.parametrize("scene", crossing.SCENES)
def test_a_place_agrees_best_with_itself(scene):
    for row in crossing.curves():
        if row["scene"] == scene:
            assert float(row["affinity"]) <= 1.0 + 1e-9


@settings(max_examples=200)
@given(st.lists(SCORES, min_size=1, max_size=4))
def test_what_no_rest_could_mend_is_truly_bad(scores):
    scores = np.array(scores)
    rule = next(rule for rule in points.rules(PARAMS, 64) if rule.name == "no rest could mend it")
    looked, _ = points.cut_short(scores, rule)
    assert np.all((looked == 64) | (scores.mean(axis=1) < points.BAD))


@settings(max_examples=200)
@given(SCORES, st.sampled_from(points.rules(PARAMS, 64)))
def test_a_rule_stops_at_the_first_sum_that_it_names(scores, rule):
    [looked], [found] = points.cut_short(np.array([scores]), rule)
    expected = next(
        (n for n in range(rule.every, 64, rule.every)
         if rule.stops(np.array([[sum(scores[:n])]]), np.array([n]))[0, 0]), 64,
    )  # fmt: skip
    assert looked == expected
    assert found == pytest.approx(np.mean(scores[:looked]))


# Local search


def test_a_search_tells_how_many_of_its_tries_it_kept():
    changes = {"estimator": "search", "perturbations": 20}
    [job] = jobs(1, 20.0, 50, changes=changes)
    accepted = outcome(job).accepted
    assert np.all(np.diff(accepted) >= 0)
    assert 0 < accepted[-1] <= 20 * len(accepted)


# Resampling


def test_watching_changes_nothing():
    plain, watched = run(PathFilter(params_of(), 3)), run(Watched(params_of(), 3))
    assert watched.estimate().path.tobytes() == plain.estimate().path.tobytes()
    assert watched.resamplings == plain.resamplings > 0
    measures = np.array(watched.degeneracy)
    assert np.all(measures[:, 1] <= measures[:, 0] + 1e-9)  # ESS is never more than 2^H


def test_always_is_at_every_vertex():
    watched = run(Watched(params_of(), 3, "always"))
    assert watched.resamplings == watched.vertices


def test_ess_resamples_no_later_than_entropy_at_the_same_threshold():
    assert run(Watched(params_of(), 3, "ess")).resamplings >= run(Watched(params_of(), 3)).resamplings


def test_independent_draws_lose_equal_particles_and_systematic_ones_do_not():
    rows = resampling.neutral()
    n, left = resampling.NEUTRAL, float(rows[0]["independent (%)"]) / 100.0
    assert left == pytest.approx(1.0 - math.exp(-1.0), abs=5.0 * math.sqrt(0.1 / n))
    assert all(row["systematic (%)"] == 100.0 for row in rows)
    lost = run(Watched(params_of(direction={"gain": 0.0}), 3, "always", multinomial=True), 0.5).estimate().profile
    kept = run(Watched(params_of(direction={"gain": 0.0}), 3, "always"), 0.5).estimate().profile
    assert lost[len(lost) // 2] < 0.5 < kept[len(kept) // 2] == 1.0


def test_log_normal_weights_have_an_ess_of_the_entropys_square():
    log_weights = 0.8 * np.random.default_rng(0).normal(size=200_000)
    weights = np.exp(log_weights) / np.exp(log_weights).sum()
    entropy = 2.0 ** -np.sum(weights * np.log2(weights)) / weights.size
    assert effective_sample_size(weights) / weights.size == pytest.approx(entropy**2, rel=0.03)


# Drives


@pytest.mark.parametrize("seed", range(4))
def test_out_and_back_closes_no_cycle_and_hits_no_wall(seed):
    plan, world = out_and_back(seed, 50.0), world_of(seed, 50.0)
    assert 95.0 < plan.length < 130.0
    assert np.all(world.clearances(plan.points, 2.0) > 0.2)
    steps = np.diff(plan.points, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    there = headings[: len(headings) // 8]
    assert abs(there[-1] - there[0]) < 1.5 * math.pi, "never all the way round"


def test_pairs_that_are_truly_seen_twice_agree_best():
    groups, reach = points.pairs_of(TINY)
    at = pairs.points_of(PARAMS, reach)
    mean = {
        name: pairs.point_scores(pairs.paired(seen, PARAMS, reach), at, PARAMS).mean() for name, seen in groups.items()
    }
    assert mean["true"] > mean["near"]
    assert mean["true"] > mean["elsewhere"]


def test_a_picture_is_drawn_from_rows_alone(tmp_path):
    curves = {"crossing": crossing.curves()}
    save(crossing.draw, Findings({}, curves), tmp_path / "a.png")
    save(crossing.draw, Findings({}, curves), tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()

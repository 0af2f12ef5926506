"""The benchmarks' frame: names, tables, figures, results as JSON. What they measure is not tested by measuring."""

from __future__ import annotations

import math

import pytest

from bench import benchmark, command, fuzz, parity, ride
from bench.ablation import INGREDIENTS, WHOLE, settings_of
from bench.benchmark import Bench, Column, Crew, Record, Row, each, values_of
from bench.catalogue import CATALOGUE, SETS
from bench.result import Results, show_table
from server.__main__ import run as run_command
from server.errors import UserError
from server.terminal import benchmarks


def square(case: float, seed: int) -> Record:
    """A run that costs nothing."""
    return {"seed": seed, "error": case * seed * seed, "good": seed < 3, "odd": math.nan}


CHEAP = Bench(
    name="cheap",
    about="squares",
    rows=each(square, {"one": 1.0, "two": 2.0}),
    columns=(
        Column("runs", benchmark.runs),
        Column("error", benchmark.tails("error", 1)),
        Column("good", benchmark.share("good")),
        Column("bad", benchmark.failed("good")),
    ),
    seeds=5,
    notes=lambda rows: [f"{len(rows)} rows"],
)


def ended(bench: Bench, *arguments):
    """The last word on a benchmark."""
    return list(command.run(bench, *arguments))[-1]


def test_every_benchmark_says_in_one_line_what_it_is():
    names = [bench.name for bench in CATALOGUE]
    assert len(set(names)) == len(names)
    for bench in CATALOGUE:
        assert bench.about
        assert "\n" not in bench.about
        assert bench.seeds >= max(1, bench.quick)
        assert bench.columns


def test_the_list_names_all(capsys):
    command.show_list()
    printed = capsys.readouterr().out
    assert all(f"| {bench.name} " in printed for bench in CATALOGUE)


def test_a_misspelt_name_is_told_with_the_near_ones():
    with pytest.raises(UserError, match="`cylce` is no benchmark; did you mean `cycle`"):
        command.chosen(["cycle", "cylce"])


def test_a_set_is_all_of_its_benchmarks_once(capsys):
    names = ["stand", "ride", "push", "wall", "safety", "radio", "avr", "accepts", "fuzz", "builds", "parity"]
    assert [bench.name for bench in command.chosen(["firmware"])] == names
    assert [bench.name for bench in command.chosen(["avr", "firmware", "avr"])] == ["avr", *names[:6], *names[7:]]
    assert {bench.name for bench in CATALOGUE}.isdisjoint(SETS)
    command.show_list()
    assert f"firmware: {', '.join(names)}; " in capsys.readouterr().out


def test_what_must_not_be_is_said_and_is_the_exit_code(monkeypatch, capsys, tmp_path):
    judged = CHEAP._replace(
        name="judged", verdict=lambda rows: [row.name for row in rows if not all(values_of(row, "good"))]
    )
    monkeypatch.setattr(command, "CATALOGUE", (CHEAP, judged))
    output = ["--output", str(tmp_path / "results.json")]
    for seeds, names, code in (("3", ["judged"], 0), ("4", ["cheap"], 0), ("4", ["judged", "cheap"], 1)):
        assert run_command(["bench", *names, "--seeds", seeds, *output], False) == code
        printed = capsys.readouterr().out
        assert printed.count("WRONG: ") == 2 * code
        assert not code or "\nWRONG: one\nWRONG: two\n" in printed
    assert Results.read(tmp_path / "results.json").results["judged"].wrong == ["one", "two"]


def test_what_the_fuzzer_finds_is_told_with_its_place():
    assert not list(fuzz.verdict([Row("seed 0", [{"seed": 0, "findings": "none"}])]))
    [sentence] = fuzz.verdict([Row("seed 1", [{"seed": 1, "findings": "crash-12"}])])
    assert sentence.startswith("seed 1: crash-12, in ")


def test_a_robot_may_not_fall_and_one_that_is_calibrated_keeps_all():
    kept, missed, fallen = ({"seed": i, "stands": i < 2, "is_kept": i < 1} for i in range(3))
    sound, _, rough = ride.CASES
    assert not list(ride.verdict([Row(sound, [kept]), Row(rough, [kept, missed])]))
    assert list(ride.verdict([Row(sound, [kept, missed]), Row(rough, [missed, fallen])])) == [
        f"{sound}: not as it should be with the seeds 1",
        f"{rough}: fallen are the seeds 2",
    ]
    assert list(ride.verdict([Row(sound, [{"seed": 0, "is_kept": False, "largest": 0.4}])]))


def test_parity_tells_what_pytest_found_with_that_many_steps(monkeypatch, tmp_path):
    path = tmp_path / "test_few.py"
    path.write_text(
        "import os, pytest\n"
        "def test_same(): assert os.environ['PARITY_STEPS'] == '123'\n"
        "@pytest.mark.parametrize('seed', [1, 2])\n"
        "def test_seed(seed): assert seed == 1\n"
        "def test_without_tools(): pytest.skip('none here')\n"
    )
    monkeypatch.setattr(parity, "TESTS", str(path))
    record = parity.run(123, 0)
    assert record == {
        "seed": 0, "passed": 2, "failed": 1, "skipped": 1, "error": 0, "differing": "test_seed[2]",
    }  # fmt: skip
    assert list(parity.verdict([Row("long", [record])])) == ["long: 1 failed", "long: 1 skipped"]
    assert not list(parity.verdict([Row("long", [record | {"failed": 0, "skipped": 0}])]))
    monkeypatch.setattr(parity, "TESTS", str(tmp_path / "nowhere.py"))
    with pytest.raises(RuntimeError, match="did not run"):
        parity.run(123, 0)


def test_rows_have_all_columns_whatever_the_number_of_processes():
    alone, together = ended(CHEAP, 5, 1), ended(CHEAP, 5, 2)
    assert [row.cells for row in alone.rows] == [row.cells for row in together.rows]
    assert alone.rows[0].records[4]["error"] == 16.0
    assert alone.columns == ["run", "runs", "error", "good", "bad"]
    assert alone.rows[1].cells == ["5", "8.0 / 26.4 / 32.0", "60 % (23 to 88)", "3, 4"]
    assert alone.notes == ["2 rows"]


def test_only_leaves_rows_out_and_needs_one():
    assert [row.name for row in ended(CHEAP, 1, 1, "two").rows] == ["two"]
    with pytest.raises(UserError, match="no row of `cheap` has `tw` in its name"):
        ended(CHEAP, 1, 1, "tw")


def test_a_run_that_is_stopped_leaves_what_it_had():
    parts = [len(result.rows) for result in command.run(CHEAP, 1)]
    assert parts == [1, 2, 2]


def test_what_is_timed_runs_alone():
    assert ended(CHEAP._replace(is_timed=True), 1, 4).jobs == 1


def test_results_survive_json(tmp_path):
    result = ended(CHEAP, 2)
    path = tmp_path / "there" / "results.json"
    Results(results={"cheap": result}).write(path)
    read = Results.read(path).results["cheap"]
    assert read.rows[0].records[1] == {"seed": 1, "error": 1.0, "good": True, "odd": None}
    assert read.model_dump_json() == result.model_dump_json()
    assert read.machine.cores >= 1
    assert "python" in read.machine.versions
    assert read.commit


def test_the_table_is_markdown_with_what_it_depends_on(capsys):
    result = ended(CHEAP, 2)
    result.show()
    lines = capsys.readouterr().out.splitlines()
    table = [line for line in lines if line.startswith("|")]
    assert len(table) == 4
    assert all(line.count("|") == 6 for line in table)
    assert result.command in lines[-2]
    assert result.commit in lines[-2]
    assert str(result.machine) == lines[-1]


def test_cells_may_hold_what_looks_like_markup(capsys):
    show_table(["a"], [["[red]1[/red] :smile:"]])
    assert "[red]1[/red] :smile:" in capsys.readouterr().out


def test_wilsons_interval_is_the_published_one():
    low, high = benchmark.wilson(20, 20)
    assert low == pytest.approx(0.8389, abs=1e-4)
    assert high == pytest.approx(1.0)
    low, high = benchmark.wilson(15, 50)  # Brown, Cai and DasGupta 2001: the roots of the score test
    for edge in (low, high):
        assert abs(0.3 - edge) == pytest.approx(1.96 * math.sqrt(edge * (1 - edge) / 50))


def test_figures_tell_how_many_runs_they_leave_out():
    row = Row("row", [{"a": 1.0}, {"a": math.nan}, {"a": None}, {}])
    assert benchmark.middle("a")(row) == "1.00 (1 of 4)"
    assert benchmark.middle("b")(row) == "-"
    assert benchmark.share("b")(row) == "-"


def test_an_error_of_a_run_is_not_swallowed():
    with Crew(1) as crew, pytest.raises(TypeError):
        crew.map(square, [("no number", 1.5)], "wrong")


def test_without_a_checkout_the_command_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setattr("server.terminal.__file__", str(tmp_path / "server" / "terminal.py"))
    with pytest.raises(UserError, match="make setup"):
        benchmarks()


def test_without_recordings_it_is_skipped_in_one_line(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("CRUNCH_DATA", str(tmp_path / "nowhere"))
    command.run_all(["sonar8"], None, 1, "", None)
    assert "sonar8: skipped" in capsys.readouterr().out


def test_what_is_switched_off_is_a_setting():
    for name in INGREDIENTS:
        assert (settings_of(name) == settings_of(WHOLE)) == (name == WHOLE), name


def test_a_fresh_process_gives_back_what_it_found():
    with Crew(1) as crew:
        assert crew.alone(square, 3.0, 2)["error"] == 12.0


def test_the_command_lists_and_tells_mistakes(capsys):
    assert run_command(["bench", "--list"], False) == 0
    assert "| cycle" in capsys.readouterr().out
    assert run_command(["bench", "cylce"], False) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "crunch: error: `cylce` is no benchmark; did you mean `cycle`?\n"

"""Many junctions in one mark, and samples of what they multiply out to."""

import json
import shlex
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.report.session_report import Cell, Drawn
from pytest_rvads.session.plan import Plan
from tools.crossings import Layout

from .conftest import Lines

TEST = """
    import pytest_rvads as rvads

    @rvads.scenario({arguments})
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""
STOP, LIGHTS, NONE = JunctionControl.STOP, JunctionControl.LIGHTS, JunctionControl.NONE
LAYOUTS = {
    "20": Layout(4, STOP),
    "7": Layout(3, LIGHTS),
    "3": Layout(4, STOP, approach=15.0),
    "5": Layout(5, NONE, stop=20.0),
    "v3": Layout(3, LIGHTS),
}
Collect = Callable[..., list[str]]


@pytest.fixture(autouse=True)
def town(pytester: pytest.Pytester, write_town: Callable[..., Path]) -> Path:
    """A stop, a T with lights, a stop with approaches of 15 m, five arms with neither, and one that can't be used."""
    return write_town(pytester.path / "town.xodr", LAYOUTS, virtual=("v3",))


@pytest.fixture
def collect(pytester: pytest.Pytester, brackets: Lines) -> Collect:
    """Return a function that collects a mark and returns what stands in brackets of its items."""

    def collect(arguments: str, *options: str) -> list[str]:
        pytester.makepyfile(TEST.format(arguments=arguments))
        return brackets(pytester.runpytest("--collect-only", "-q", *options))

    return collect


def junctions(listed: list[str]) -> list[str]:
    """Return the junctions of items, each once, in order."""
    return list(dict.fromkeys(name.partition("-")[0] for name in listed))


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        ('"*", map="town.xodr"', ["20", "7", "3", "5"]),
        ('["7", "20"], map="town.xodr"', ["7", "20"]),
        ('("4-way stop", "7"), map="town.xodr"', ["20", "3", "7"]),
        ('"4-way stop with 40 m of approach", map="town.xodr"', ["20"]),
        ('map="town.xodr", junctions={"control": ["stop", "none"], "approach": 10}', ["20", "3", "5"]),
        ('["7", "20", "5"], map="town.xodr", junctions={"arms": (3, 5)}', ["7", "5"]),
        ('"*", map="town.xodr", limit=4', ["20", "7", "3", "5"]),
    ],
)
def test_a_mark_asks_for_several_junctions(collect: Collect, arguments: str, found: list[str]) -> None:
    listed = collect(f'{arguments}, rules="no_collision", distances=1, cover="pairs"')
    assert junctions(listed) == [f"town.{id}" for id in found]


def test_the_map_of_the_session_and_built_in_names_go_together(collect: Collect) -> None:
    listed = collect('["stop3", "7"], rules="no_collision", grid="E", classes=1', "--rvads-map=town.xodr")
    assert junctions(listed) == ["stop3", "town.7"]
    assert len(junctions(collect('"*", rules="no_collision", grid="E", classes=1'))) >= 10, "without a map, all built-in ones"


def test_items_of_one_junction_are_selected_as_ever(collect: Collect) -> None:
    mark = '"*", map="town.xodr", rules="no_collision", distances=1, cover="pairs"'
    by_word = collect(mark, "-k", "town.20")
    assert junctions(by_word) == ["town.20"]
    assert by_word == collect(mark, "-m", "rvads(junction='town.20')")


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        ('classes=20, distances=1, rules="no_collision"', ["20", "3", "5"]),  # a T has four classes
        ('scenarios="1133", distances=1, rules="no_collision"', ["20", "3"]),
        ('scenarios="222", distances=1, rules="no_collision"', ["7"]),
        ('distances=[(1, 2, 3)], cover="pairs", rules="no_collision"', ["7"]),
        ('distances=1, cover="pairs", rules="paper"', ["20", "7", "3"]),  # it says nothing of junctions without control
        ('distances=20, cover="pairs", rules="no_collision"', ["20", "7", "5"]),  # 3 has 15 m
    ],
)
def test_junction_without_the_requested_approach_is_left_out(collect: Collect, arguments: str, found: list[str]) -> None:
    assert junctions(collect(f'"*", map="town.xodr", {arguments}')) == [f"town.{id}" for id in found]


@pytest.mark.extended
def test_named_junction_and_empty_choice_are_errors(pytester: pytest.Pytester) -> None:
    for mark, says in (
        ('"7", map="town.xodr", classes=20', "a 3-way junction has classes 1..4, got 20"),
        ('"v3", map="town.xodr"', "junction 'v3' of map file * cannot be used: it is of type *"),
        ('["7", "v3"], map="town.xodr"', "junction 'v3' of map file * cannot be used: it is of type *"),
        ('"*", map="town.xodr", classes=2000', "none of 4 junctions fits the mark, the first: a 4-way junction has *"),
        ('"*", map="town.xodr", junctions={"arms": 8}', "* no usable junction that fits '[*]' and is of the kinds *(8 arms)*"),
    ):
        pytester.makepyfile(TEST.format(arguments=mark))
        result = pytester.runpytest("--collect-only", "-q")
        result.stdout.fnmatch_lines([f"test_*.py:3: test_*: {says}", "no tests collected, 1 error in *"])


def test_limit_counts_usable_junctions(collect: Collect) -> None:
    """Of the three with 20 m of approach one is drawn from each kind."""
    mark = '"*", map="town.xodr", distances=20, cover="pairs", rules="no_collision", limit={}'
    assert junctions(collect(mark.format(3))) == ["town.20", "town.7", "town.5"]
    drawn = {tuple(junctions(collect(mark.format(1), f"--rvads-seed={seed}"))) for seed in range(6)}
    assert {len(names) for names in drawn} == {1}
    assert len(drawn) > 1


@pytest.mark.extended
def test_a_sample_is_spread_over_junctions_and_drawn_by_the_seed(collect: Collect) -> None:
    mark = '"*", map="town.xodr", distances=[1, 2, 3], cover="class", rules=("no_collision", "progress")'
    few = collect(mark, "--rvads-sample=10", "--rvads-seed=1")
    runs = list(dict.fromkeys(name.rpartition("-")[0] for name in few))
    assert (len(few), len(runs)) == (20, 10), "runs are drawn, each with all its rules"
    assert sorted(Counter(name.partition("-")[0] for name in runs).values()) == [2, 2, 3, 3]
    whole = collect(mark)
    assert [name for name in whole if name in few] == few, "as they stand without a sample"
    assert collect(mark, "--rvads-sample=10", "--rvads-seed=1") == few
    assert collect(mark, "--rvads-sample=10", "--rvads-seed=2") != few
    assert collect(mark, "--rvads-sample=99999") == whole


def test_the_sample_may_stand_in_the_ini_file(pytester: pytest.Pytester, collect: Collect) -> None:
    mark = '"*", map="town.xodr", distances=1, cover="class", rules="no_collision"'
    given = collect(mark, "--rvads-sample=5", "--rvads-seed=3")
    pytester.makeini("[pytest]\nrvads_sample = 5\nrvads_seed = 3\n")
    assert collect(mark) == given


def test_the_marks_of_a_test_share_a_sample_and_a_run_counts_once(pytester: pytest.Pytester, brackets: Lines) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("7", map="town.xodr", classes=(1, 2), grid="E")
        @rvads.scenario("7", map="town.xodr", classes=(2, 3), grid="E")
        @rvads.scenario("stop3", classes=4, grid="E")
        def test_run(run): ...
        """
    )
    assert len(brackets(pytester.runpytest("--collect-only", "-q", "--rvads-sample=4"))) == 4
    assert Counter(name[:5] for name in brackets(pytester.runpytest("--collect-only", "-q", "--rvads-sample=3"))) == {
        "town.": 2,
        "stop3": 1,
    }


@pytest.mark.extended
def test_more_items_than_allowed_are_counted_after_the_draw(pytester: pytest.Pytester, collect: Collect) -> None:
    mark = '"*", map="town.xodr", distances=1, cover="class", rules=("no_collision", "progress")'
    assert len(collect(mark, "--rvads-max-items=20", "--rvads-sample=10")) == 20
    pytester.runpytest("--collect-only", "-q", "--rvads-max-items=20").stdout.fnmatch_lines(
        ["*would expand to * items at 4 junctions: * run some of them by --rvads-sample, or raise --rvads-max-items"]
    )
    pytester.runpytest("--collect-only", "-q", "--rvads-max-items=20", "--rvads-sample=11").stdout.fnmatch_lines(
        ["*would expand to 22 items (11 runs drawn): lower --rvads-sample, ask for fewer rules, or raise --rvads-max-items"]
    )


@pytest.mark.parametrize("option", ["--rvads-sample=0", "--rvads-sample=some", "--rvads-seed=-1", "--rvads-seed=1.5"])
def test_a_sample_and_its_seed_are_whole_numbers(pytester: pytest.Pytester, option: str) -> None:
    name, _, value = option.removeprefix("--").partition("=")
    least = "1" if name.endswith("sample") else "0"
    pytester.runpytest(option).stderr.fnmatch_lines(
        [f"*{name.replace('-', '_')} must be a whole number from {least} to 999999999, got '{value}'"]
    )


@pytest.mark.parametrize("workers", [(), pytest.param(("-n", "2"), marks=pytest.mark.slow)])
def test_undrawn_runs_and_refused_junctions_are_reported(pytester: pytest.Pytester, workers: tuple[str, ...]) -> None:
    pytester.makepyfile(
        TEST.format(
            arguments='"*", map="town.xodr", scenarios=("1133", "1111"), distances=13, rules=("progress", "no_collision")'
        )
    )
    result = pytester.runpytest(
        "--rvads-autopilot=reference",
        "--rvads-sample=1",
        "--rvads-seed=4",
        "--rvads-report=r.json",
        "--rvads-report=r.md",
        *workers,
    )
    assert result.ret == 0
    told = [
        "1 junction left out: scenario '1133' names 4 entrances, the junction has 3: town.7",
        "1 junction left out: scenario '1133' names 4 entrances, the junction has 5: town.5",
        "1 of 4 runs drawn by --rvads-sample, seed 4: test_undrawn_runs_and_refused_junctions_are_reported.py::test_rules",
    ]
    result.stdout.fnmatch_lines(["1 junction left out: it is of type*town.v3", *told])
    report = json.loads((pytester.path / "r.json").read_text())
    assert [names for _, names in report["refused"].items()] == [["town.v3"], ["town.7"], ["town.5"]]
    assert report["drawn"] == [["test_undrawn_runs_and_refused_junctions_are_reported.py::test_rules", "runs", 1, 4, 4]]
    assert all(line in (pytester.path / "r.md").read_text().replace("\\", "") for line in told)
    assert [record["control"] for record in report["records"]] == ["stop", "stop"]
    assert {cell[0] for cell in report["planned"]} == {report["records"][0]["junction"]}, "what was not drawn is not planned"


@pytest.mark.extended
def test_undrawn_item_is_outside_of_the_baseline(pytester: pytest.Pytester) -> None:
    known = """
    import pytest_rvads as rvads

    @rvads.known("slow", scenario="222")
    @rvads.scenario("7", map="town.xodr", scenarios=("{}", "222"), grid="E")
    def test_run(run): ...
    """
    pytester.makepyfile(known.format("111").replace("@rvads.known", "# "))
    run = ("--rvads-autopilot=reference",)
    assert pytester.runpytest(*run, "--rvads-report=old.json").parseoutcomes() == {"passed": 2}
    drawn = {}
    for seed in range(9):
        result = pytester.runpytest(*run, "--collect-only", "-q", "--rvads-sample=1", f"--rvads-seed={seed}")
        drawn[next(name for name in ("as111", "as222") if name in result.stdout.str())] = seed
    only = ("--rvads-sample=1", f"--rvads-seed={drawn['as111']}")
    less = pytester.runpytest(*run, *only, "--rvads-baseline=old.json", "--rvads-fail-on=new")
    less.stdout.fnmatch_lines(["against old.json: 1 UNCHANGED, 1 OUTSIDE"])
    assert less.ret == 0
    pytester.makepyfile(known.format("111"))
    assert pytester.runpytest(*run, *only).ret == 0, "the known failure stands at a scenario that was not drawn"


def test_workers_send_what_did_not_run() -> None:
    """See `Plan.pack`."""
    sent, received = Plan(), Plan()
    sent.cells[Cell("town.20", 7, "C", "p1", None, None)] = None
    sent.refused = {"it has 2 arms": dict.fromkeys(("town.1", "town.2"))}
    sent.drawn = {Drawn("test_it.py::test_it", "runs", 4, 5, 1): None}
    for _ in range(2):  # every worker sends it
        received.unpack(sent.pack())
    assert (received.refused, received.drawn) == (sent.refused, sent.drawn)


@pytest.mark.extended
def test_rerun_line_of_a_sampled_failure_reproduces_the_failure(pytester: pytest.Pytester) -> None:
    alone = 'scenarios=("1000", "2000", "3000"), subject=0, distances=20, speeds=8, rules="full_stop"'
    pytester.makepyfile(TEST.format(arguments=f'["20", "3"], map="town.xodr", {alone}'))
    options = ("--rvads-autopilot=rolling_stop", "--rvads-sample=2", "--rvads-seed=5")
    result = pytester.runpytest("-vv", *options)
    result.assert_outcomes(failed=2)
    lines = [line.partition("pytest ")[2] for line in result.outlines if line.startswith("rerun ")]
    assert len(lines) == 2
    for line in lines:
        *given, item = line.split()
        assert tuple(given) == options
        pytester.runpytest(*given, item.strip('"')).assert_outcomes(failed=1)


@pytest.mark.extended
def test_rerun_line_below_a_cause_runs_a_drawn_item(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(TEST.format(arguments='"4-way stop", map="town.xodr", grid="BC", rules="p2"'))
    options = ("--rvads-max-items=20", "--rvads-sample=3", "--rvads-autopilot=lgsvl", "--rvads-seed=3", "-n0")
    failed = pytester.runpytest(*options)
    assert failed.parseoutcomes()["failed"] > 0
    line = next(line for line in failed.stdout.lines if "first: pytest" in line)
    again = pytester.runpytest(*shlex.split(line.partition("pytest")[2]), "-n0")
    again.assert_outcomes(failed=1)
    told = [shlex.split(line)[1:] for line in failed.stdout.lines if "rerun     pytest" in line]
    assert shlex.split(line)[1:] in told, "as below its failure"

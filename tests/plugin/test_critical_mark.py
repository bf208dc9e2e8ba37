"""``@rvads.critical``: items, their ids, their failures, and wrong arguments."""

import json
import shutil
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.starts.lines import Setting
from pytest_rvads.scenarios.ids import from_id
from pytest_rvads.simulators.loop import usual
from pytest_rvads.support.installed import load

from ..synthetic_starts import Answer, judged_by
from .conftest import Lines

Make = Callable[..., Run]
TEST = """
import pytest_rvads as rvads

@rvads.critical({arguments})
def test_gaps(): ...
"""


def passing(lead: int) -> tuple[bool, Mapping[str, Status]]:
    return lead >= 0, {"no_collision": Status.PASS}


def colliding(lead: int) -> tuple[bool, Mapping[str, Status]]:
    return True, {"no_collision": Status.FAIL}


def test_every_group_of_equal_lines_is_an_item_with_the_ways_in_its_id(pytester: pytest.Pytester, brackets: Lines) -> None:
    """The 28 conflicting pairs of ways have two seats each, moving and from rest; a crossing of equal arms has four rotations."""
    pytester.makepyfile(TEST.format(arguments='"stop4"'))
    ids = brackets(pytester.runpytest("--collect-only", "-q"))
    assert len(ids) == len(set(ids)) == 28
    assert {"stop4-s0-0to2-meets-1to3", "stop4-s0-0to2-meets-1to3-rest"} <= set(ids)
    seats = [id.split("-")[1] for id in ids]
    assert {f"s{id.split('-')[2][0]}" for id in ids} == set(seats), "the way of the subject begins at its seat"


def test_seats_choose_items(pytester: pytest.Pytester, brackets: Lines) -> None:
    pytester.makepyfile(TEST.format(arguments='"stop3", seats=[1]'))
    ids = brackets(pytester.runpytest("--collect-only", "-q"))
    assert ids
    assert all(id.startswith("stop3-s1-1to") for id in ids)


def test_pedestrians_take_the_place_of_other_vehicles(pytester: pytest.Pytester, brackets: Lines, reference: None) -> None:
    """Of the eight ways over the crosswalks of arms with lights, those of a seat turn right and left, each from two sides."""
    pytester.makepyfile(TEST.format(arguments='"walk4", seats=[0], pedestrians="steady", rules="no_collision"'))
    ids = brackets(pytester.runpytest("--collect-only", "-q"))
    ways = [f"walk4-s0-0to{arm}-meets-{arm}{side}.steady" for arm in (1, 3) for side in "nf"]
    assert ids == [f"{way}{begin}" for way in ways for begin in ("", "-rest")]
    result = pytester.runpytest("-k", "0to3-meets-3f and rest", "--rvads-report=report.json")
    result.assert_outcomes(passed=1, deselected=7)
    (record,) = [r for r in json.loads(Path("report.json").read_text())["records"] if r["status"] != "NOT RUN"]
    assert record["pedestrians"] == "3f.steady"
    assert record["run"].startswith("walk4-class00-as3000-s0-w3f.steady.")
    assert [agent["name"] for agent in record["agents"]] == ["a0", "p0"]


def test_keyword_expression_selects_a_pair_of_ways(pytester: pytest.Pytester, make: Make, reference: None) -> None:
    pytester.makepyfile(TEST.format(arguments='"stop4", rules="no_collision"'))
    with judged_by(passing, make):
        pytester.runpytest("-k", "0to1-meets-2to1").assert_outcomes(passed=2, deselected=26)


def test_body_runs_after_the_search_with_its_fixtures(pytester: pytest.Pytester, make: Make, reference: None) -> None:
    body = "def test_gaps(tmp_path):\n    assert not tmp_path.is_dir()"
    pytester.makepyfile(TEST.format(arguments='"stop3", seats=[0]').replace("def test_gaps(): ...", body))
    with judged_by(passing, make):
        result = pytester.runpytest("-k", "0to1-meets-2to1")
    assert result.parseoutcomes()["failed"] == 2
    result.stdout.fnmatch_lines(["E * assert not True"])


def test_failure_names_the_start_and_shows_code_that_simulates_it(pytester: pytest.Pytester, make: Make, reference: None) -> None:
    pytester.makepyfile(TEST.format(arguments='"stop4", rules="no_collision"'))
    with judged_by(colliding, make):
        result = pytester.runpytest("-k", "0to1-meets-2to1 and not rest")
    result.assert_outcomes(failed=1, deselected=27)
    # The subject always goes, so that the most critical start is the least lead, -12 s.
    result.stdout.fnmatch_lines(
        [
            "*stop4: 0->1 meets 2->1, too bold where it goes: no_collision FAIL, lead -12.00 s, in stop4-* and 3 more of 8 *",
            "*no_collision is judged FAIL*",
            "*to see it again:*",
            "*@rvads.scenario('stop4', scenarios='1030', distances=(116, 20, 20, 20), speeds=(8, 0, 8, 0), *subject=0)",
        ]
    )
    message = next(line for line in result.outlines if "too bold where it goes" in line)
    scenario = from_id(message.partition(" in ")[2].partition(",")[0])
    assert (scenario.subject, scenario.start(0), scenario.start(2)) == (0, (116.0, 8.0), (20.0, 8.0))


@pytest.mark.extended
def test_driver_that_never_looks_fails_and_the_reference_passes(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        class NeverLooks(rvads.Reference):
            def __init__(self):
                super().__init__(tie=0.5)

            def control(self, seen):
                return super().control(seen._replace(others=(), created=0))

        @rvads.critical("stop4", seats=[0], autopilot=NeverLooks)
        def test_never_looks(): ...

        @rvads.critical("stop4", seats=[0], autopilot=rvads.traffic("reference"))
        def test_reference(): ...
        """
    )
    result = pytester.runpytest("-k", "0to2-meets-1to3 and not rest")
    result.assert_outcomes(failed=1, passed=1, deselected=54)
    result.stdout.fnmatch_lines(["*stop4: 0->2 meets 1->3, * FAIL, lead *"])


def test_wrong_argument_is_shown_with_the_line_of_the_mark_and_without_a_traceback(pytester: pytest.Pytester) -> None:
    file = pytester.makepyfile(TEST.format(arguments='"stop4", seats=[4]'))
    result = pytester.runpytest("--collect-only", "-q")
    result.stdout.fnmatch_lines([f"{file.name}:3: a seat of 'stop4' is one of its entrances, 0 to 3, got 4"])
    assert "Traceback" not in result.stdout.str()
    assert result.ret == pytest.ExitCode.INTERRUPTED


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"junction": "stop5"}, "unknown junction 'stop5'"),
        ({"rules": "no_colision"}, "did you mean 'no_collision'"),
        ({"traffic": "hesitent"}, "unknown traffic 'hesitent', .* did you mean 'hesitant'"),
        ({"autopilot": 3}, "an autopilot must be a class or a callable that makes one, got 3"),
    ],
)
def test_wrong_argument_is_refused_when_the_test_is_defined(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(rvads.errors.ScenarioError, match=message):
        rvads.critical(**{"junction": "stop4", **arguments})


def test_mark_is_the_entry_point_of_the_package() -> None:
    assert rvads.critical is load("marks", "critical")


def test_class_is_refused() -> None:
    with pytest.raises(
        rvads.errors.ScenarioError, match=r"@rvads\.critical makes a test of a function or method, got <class .*dict.*>"
    ):
        rvads.critical("stop4")(dict)  # type: ignore[arg-type]


def test_map_is_looked_for_beside_the_test_file(pytester: pytest.Pytester) -> None:
    folder = pytester.mkdir("rules")
    shutil.copy(path_of("stop3"), pytester.path / "mine.xodr")
    (folder / "test_gaps.py").write_text(
        "import pytest_rvads as rvads\n\n@rvads.critical('1', map='../mine.xodr', seats=[0])\ndef test_gaps(): ...\n", "utf-8"
    )
    result = pytester.runpytest("rules", "--collect-only", "-q")
    result.stdout.fnmatch_lines(["rules/test_gaps.py::test_gaps[[]mine.1-s0-0to1-meets-2to1]"])


def boldly_irrational(lead: int) -> tuple[bool, Mapping[str, Status]]:
    """Return verdicts that break a rule at starts 0.3 s less critical than the critical start, so that a search has to shrink."""
    return lead >= 0, {"no_collision": Status.FAIL if lead >= 30 else Status.PASS, "progress": Status.NA}


@pytest.mark.parametrize("answer", [passing, boldly_irrational])
@pytest.mark.parametrize("cfg", ["critical", "rest"])
def test_item_leaves_a_record_with_the_arrivals_of_all_simulated_starts(
    pytester: pytest.Pytester, make: Make, reference: None, answer: Answer, cfg: str
) -> None:
    pytester.makepyfile(TEST.format(arguments='"stop4", seats=[0]'))
    status, chosen = "PASS" if answer is passing else "FAIL", "rest" if cfg == "rest" else "not rest"
    with judged_by(answer, make) as leads:
        result = pytester.runpytest("-k", f"0to1-meets-2to1 and {chosen}", "--rvads-report=report.json")
    report = json.loads(Path("report.json").read_text("utf-8"))
    (record,) = report["records"]
    assert (record["type"], record["status"], record["outcome"] == "failed") == ("simulated", status, status == "FAIL")
    assert (record["junction"], record["seat"], record["traffic"], record["cfg"]) == ("stop4", 0, "reference", cfg)
    assert (record["driver"], record["simulator"]) == ("pytest_rvads.drivers.reference.Reference", usual().name)
    shown = from_id(record["run"])
    assert (shown.subject, shown.directions) == (0, (1, 0, 3, 0))
    assert {verdict["rule"] for verdict in record["verdicts"]} == set(answer(0)[1])
    # The other vehicle enters the entrance zone at 0.65 s, the subject at 0.40 s if it goes, and at 0.90 s if it waits.
    tried = Counter(difference for own, other, difference in record["arrivals"]["tried"])
    assert tried == {key: n for key, n in ((0.25, sum(n >= 0 for n in {*leads})), (-0.25, sum(n < 0 for n in {*leads}))) if n}
    assert ["stop4", "0103", cfg, "test_gaps", 0, "reference"] in report["planned"]
    result.stdout.fnmatch_lines(["stop4 among reference traffic*", "*arrivals: 1 of * pairs of conflicting movements met, *"])


def test_moving_starts_and_starts_on_red_are_different_cells(pytester: pytest.Pytester, make: Make, reference: None) -> None:
    pytester.makepyfile(TEST.format(arguments='"light4", seats=[0]'))
    with judged_by(passing, make):
        pytester.runpytest("-k", "0to1-meets-3to1", "--rvads-report=report.json")
    report = json.loads(Path("report.json").read_text("utf-8"))
    assert sorted(record["cfg"] for record in report["records"]) == ["critical", "red", "rest"]


def test_item_with_an_error_of_the_driver_leaves_a_record_with_the_reason(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, reference: None
) -> None:
    def divides_by_zero(*_: object) -> None:
        raise rvads.errors.RunError("the driver divides by zero")

    monkeypatch.setattr(Setting, "judged", divides_by_zero)
    pytester.makepyfile(TEST.format(arguments='"stop4", seats=[0]'))
    pytester.runpytest("-k", "0to1-meets-2to1 and not rest", "--rvads-report=report.json").assert_outcomes(
        failed=1, deselected=27
    )
    (record,) = json.loads(Path("report.json").read_text("utf-8"))["records"]
    assert record["status"] == "ERROR"
    assert record["message"].endswith("the driver divides by zero")


def test_mark_of_a_known_deficiency_is_refused_at_critical_starts(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(TEST.format(arguments='"stop4"').replace("@rvads.crit", "@rvads.known('I1', seat=0)\n@rvads.crit"))
    result = pytester.runpytest("--collect-only", "-q")
    result.stderr.fnmatch_lines(["*@rvads.known('I1', seat=(0,)) matches no cell of any of its tests"])

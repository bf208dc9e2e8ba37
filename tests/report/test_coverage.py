"""Coverage of cells and merging of shards, from records written by hand."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import permutations
from typing import Any

import pytest
from msgspec import structs

from pytest_rvads.cli.report_commands import merge
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.counting import counts_of
from pytest_rvads.report.figures import Coverage, cell_coverage, dropped, shortfall
from pytest_rvads.report.record import AgentRecord, Record, conclude, planned_record
from pytest_rvads.report.rollup import junction_lines
from pytest_rvads.report.session_report import Extent, Report
from pytest_rvads.support.errors import RvadsError


def at_junctions(
    records: Iterable[Record], totals: dict[int, tuple[int, int]], extents: dict[str, Extent] | None = None
) -> list[str]:
    counts = counts_of(Report(tuple(records), totals, extents=extents or {}))
    return [next(junction_lines(counts, site)) for site in counts.first]


def measure(report: Report) -> Coverage:
    return cell_coverage(counts_of(report))


def record(cls: int, rule: str, status: str, *, row: int = 0, hash: str = "aa") -> Record:
    keys = {"junction": "stop4", "cls": cls, "scenario": "1111", "cfg": "C", "rotation": row, "rule": rule}
    made = planned_record(f"t.py::test[{cls}-r{row}-{rule}]", 3, "test", keys, 4)
    if status == "NOT RUN":
        return made
    outcome = {"PASS": "passed", "NA": "skipped", "UNSURE": "skipped"}.get(status, "failed")
    error = Outcome.ERROR if status == "ERROR" else None
    verdicts = [] if error else [Verdict("", Status(status), "", violated="c")]
    return conclude(structs.replace(made, hash=hash), verdicts, "call", outcome, error=error)


PLANNED = tuple(("stop4", cls, "C", rule, None, None) for cls in (1, 2) for rule in ("p1", "p2"))


def report(*records: Record, planned: Any = PLANNED, **more: Any) -> Report:
    return Report(tuple(records), {4: (24, 81)}, planned, more.pop("versions", {"numpy": "2.0"}), **more)


def test_judged_verdict_exercises_its_cell() -> None:
    found = measure(report(record(1, "p1", "PASS"), record(1, "p2", "FAIL"), record(2, "p1", "NA"), record(2, "p2", "OPEN")))
    assert (found.planned, found.exercised, found.idle) == (4, 3, {"NA": 1})
    assert str(found) == "3/4 cells exercised (75.0 %): 1 NA"


def test_unexercised_cells_have_a_reason() -> None:
    found = measure(report(record(1, "p1", "ERROR"), record(1, "p2", "NOT RUN"), record(2, "p1", "NA")))
    assert found.exercised == 0
    assert found.idle == {"error": 1, "NA": 1, "not run": 1, "not selected": 1}


def test_unsure_verdict_exercises_no_cell() -> None:
    unsure = report(record(1, "p1", "UNSURE"), planned=())
    assert str(measure(unsure)) == "0/1 cells exercised (0.0 %): 1 unsure"
    assert merge([("one", unsure), ("two", unsure)]).exitstatus == 5, "nothing was judged"


@pytest.mark.parametrize("statuses", list(permutations(("PASS", "NA", "ERROR"))))
def test_cell_is_exercised_by_any_of_its_records_whichever_comes_last(statuses: tuple[str, ...]) -> None:
    records = [record(1, "p1", status, row=row) for row, status in enumerate(statuses)]
    assert str(measure(report(*records, planned=PLANNED[:1]))) == "1/1 cells exercised (100.0 %)"


def recorded(name: str, rule: str, status: str) -> Record:
    """A record of what nobody simulated, which has no class."""
    made = planned_record(f"t.py::test[{name}-{rule}]", 3, "test", {"junction": "stop4", "recording": name, "rule": rule}, 4)
    outcome = {"PASS": "passed", "NA": "skipped"}.get(status, "failed")
    return conclude(structs.replace(made, hash=name), [Verdict("", Status(status), "")], "call", outcome)


def test_recordings_have_cells_of_their_own_and_no_classes() -> None:
    records = [recorded("mon", "p1", "PASS"), recorded("mon", "p2", "NA"), recorded("tue", "p1", "FAIL"), record(1, "p1", "PASS")]
    assert str(measure(report(*records, planned=()))) == "3/4 cells exercised (75.0 %): 1 NA"
    assert at_junctions(records, {4: (24, 81)}) == [
        "stop4 as recorded: 2 runs, 3 verdicts: 1 pass, 1 fail, 1 NA  (never applicable: p2)",
        "stop4: 1/24 classes, 1/81 scenarios, 1 run, 1 verdict: 1 pass",
    ]


def test_one_row_of_a_class_exercises_its_cell() -> None:
    assert measure(report(record(1, "p1", "NA"), record(1, "p1", "PASS", row=1), planned=PLANNED[:1])).percent == 100


def test_provoked_verdict_exercises_no_cell() -> None:
    def among(traffic: str, seat: int, status: str, asked: bool) -> Record:
        made = record(1, "p1", "PASS")
        verdicts = [Verdict("", Status(status), "", provoked=status == "FAIL", asked=asked)]
        return structs.replace(conclude(made, verdicts, "call", "passed"), seat=seat, traffic=traffic)

    seen = [among("hesitant", 0, "FAIL", False), among("hesitant", 1, "FAIL", True), among("stopped", 1, "PASS", True)]
    assert [r.status for r in seen] == ["PROVOKED", "PROVOKED", "PASS"]
    assert str(measure(report(*seen, planned=()))) == "2/3 cells exercised (66.6 %): 1 provoked", "a cell per seat and traffic"


def test_the_share_is_rounded_down_and_the_gate_is_exact() -> None:
    planned = tuple(("stop4", cls, "C", "p1", None, None) for cls in range(3000))
    nearly = report(*(record(cls, "p1", "PASS") for cls in range(2999)), planned=planned)
    assert "(99.9 %)" in str(measure(nearly))
    assert shortfall(nearly, 100).startswith("coverage is below 100 %: 2999/3000")
    assert not shortfall(nearly, 99.9)
    assert shortfall(report(planned=()), 1), "nothing planned covers nothing"


def test_three_shards_add_up() -> None:
    shards = [
        ("a.json", report(record(1, "p1", "PASS"), record(1, "p2", "NOT RUN"))),
        ("b.json", report(record(1, "p2", "PASS"))),
        ("c.json", report(record(2, "p1", "NA"), record(2, "p2", "NA"), exitstatus=5)),
    ]
    whole = merge(shards)
    assert [(r.nodeid, r.status) for r in whole.records] == [
        ("t.py::test[1-r0-p1]", "PASS"),
        ("t.py::test[1-r0-p2]", "PASS"),
        ("t.py::test[2-r0-p1]", "NA"),
        ("t.py::test[2-r0-p2]", "NA"),
    ]
    assert (measure(whole).exercised, whole.exitstatus, whole.notes) == (2, 0, ())
    assert merge(list(reversed(shards))) == whole, "the order of shards does not matter"


@pytest.mark.parametrize(
    ("one", "other", "says"),
    [
        (record(1, "p1", "PASS"), record(1, "p1", "FAIL"), "t.py::test[1-r0-p1] is PASS in a and FAIL in b"),
        (record(1, "p1", "PASS"), record(1, "p1", "PASS", hash="bb"), "is PASS in both a and b, but of different runs"),
    ],
)
def test_contradictions_are_said_and_are_no_success(one: Any, other: Any, says: str) -> None:
    whole = merge([("a", report(one)), ("b", report(other))])
    assert says in whole.notes[0]
    assert whole.exitstatus == 1
    assert [found.status for found in whole.records] == [other.status], "the worse verdict counts"


STRANGERS = {
    "project": ({}, {}, {"project": "a1"}, {"project": "b2"}, "they differ in the project"),
    "map": ({"place": "a1"}, {"place": "b2"}, {}, {}, "they differ in the map of stop4 in t.py::test"),
    "formula": ({"formula": "a1"}, {"formula": "b2"}, {}, {}, "they differ in the formula of p1"),
    "code": ({"driver": "P", "source": "a1"}, {"driver": "P", "source": "b2"}, {}, {}, "they differ in the code of P in t.py"),
}


@pytest.mark.parametrize(("one", "other", "here", "there", "says"), STRANGERS.values(), ids=STRANGERS)
def test_reports_of_different_sessions_are_not_merged(one: Any, other: Any, here: Any, there: Any, says: str) -> None:
    first, second = structs.replace(record(1, "p1", "PASS"), **one), structs.replace(record(2, "p1", "PASS"), **other)
    with pytest.raises(RvadsError, match=f"^a and b are no parts of one session: {says}"):
        merge([("a", report(first, **here)), ("b", report(second, **there))])


def test_tests_of_one_session_may_have_maps_and_drivers_of_their_own() -> None:
    first = structs.replace(record(1, "p1", "PASS"), place="a1", driver="P", source="a1")
    second = structs.replace(record(2, "p1", "PASS"), place="b2", driver="P", source="b2", nodeid="other.py::test[2-r0-p1]")
    assert merge([("a", report(first)), ("b", report(second))]).exitstatus == 0


def test_report_without_items_is_not_merged() -> None:
    with pytest.raises(RvadsError, match=r"^b has no items, so it is no part of a session"):
        merge([("a", report(record(1, "p1", "PASS"))), ("b", report())])


def test_merge_notes_different_versions() -> None:
    made = record(1, "p1", "PASS")
    one, other = (report(made, versions={"numpy": version, "python": "3.11"}) for version in ("2.0", "2.1"))
    whole = merge([("a", one), ("b", other)])
    assert whole.notes == ("versions differ: numpy 2.0 in a, 2.1 in b",)
    assert whole.versions == {"numpy": "2.0, 2.1", "python": "3.11"}


def test_merged_exit_status_equals_that_of_one_session() -> None:
    good, bad, nothing = report(record(1, "p1", "PASS")), report(record(1, "p2", "FAIL")), report(record(2, "p1", "NA"))
    assert merge([("a", good)]).exitstatus == 0
    assert merge([("a", good), ("b", bad)]).exitstatus == 1
    assert merge([("a", good), ("b", replace(bad, exitstatus=2, notes=("stopped",)))]).exitstatus == 2
    assert merge([("a", good), ("b", replace(bad, exitstatus=2, notes=("stopped",)))]).notes == ("b: stopped",)
    assert merge([("a", nothing)]).exitstatus == 5
    none = replace(nothing, exitstatus=5)
    assert [merge([("a", none), ("b", other)]).exitstatus for other in (none, good, bad)] == [5, 0, 1]


def among(scenario: str, cls: int, orbit: str, *moves: tuple[tuple[int, int], tuple[int, int]]) -> Record:
    """A run of a scenario with a vehicle on each of some movements: arm and lane it comes from and goes to."""
    agents = tuple(AgentRecord(name=f"a{n}", kind="car", entrance=a, exit=b) for n, (a, b) in enumerate(moves))
    return structs.replace(record(cls, "p1", "PASS", hash=scenario), scenario=scenario, orbit=orbit, agents=agents)


RIGHT, LEFT, ACROSS = ((0, 0), (1, 0)), ((0, 1), (3, 0)), ((2, 0), (1, 0))
EXTENT = Extent(
    turns=2,
    classes={"arms": (10, 18, 9)},
    partial={"arms": 30},
    pairs=((RIGHT, LEFT), (RIGHT, ACROSS), (LEFT, ACROSS)),
    conflicts=((RIGHT, ACROSS),),
)


def test_a_junction_with_lanes_is_covered_in_classes_and_pairs() -> None:
    runs = [among("10_10", 1, "", RIGHT, ACROSS), among("03_00", 0, "00_03", LEFT)]
    (line,) = at_junctions(runs, {4: (24, 81)}, {"stop4": EXTENT})
    assert line.startswith(
        "stop4: 1/10 classes, 1/18 scenarios, 2/30 classes with partial ones, "
        "1/2 pairs of movements (and 1 of one arm, only with occupancy='lanes'), 1/1 conflicting pairs, 2 runs, 2 verdicts"
    )
    both = structs.replace(EXTENT, classes={**EXTENT.classes, "lanes": (3, 4, 4)})
    (line,) = at_junctions([*runs, among("13_10", 1, "10_13", RIGHT, LEFT, ACROSS)], {}, {"stop4": both})
    assert "1/10 classes with a vehicle per arm, 1/18 scenarios with a vehicle per arm, 1/3 classes with one per lane" in line
    assert "3/3 pairs of movements, 1/1 conflicting pairs, 3 runs" in line


def test_seats_of_rotated_scenarios_are_the_same_class() -> None:
    """Row 2 of two lanes on one arm and none on the next: half a turn takes 12_3 to 3_12 read on from there."""
    one, other = (structs.replace(among(s, 1, ""), seat=seat) for s, seat in (("10_02", 0), ("02_10", 2)))
    (line,) = at_junctions([one, other], {}, {"stop4": structs.replace(EXTENT, pairs=(), conflicts=(), partial={})})
    assert line.startswith("stop4: 1/10 classes, 1/9 classes with a subject, 2/18 scenarios, 2 runs")


def test_partial_classes_are_cells_of_their_own() -> None:
    runs = report(among("0101", 0, "0101"), among("0102", 0, "0102"), planned=())
    assert measure(runs).planned == 2


def test_left_out_points_and_scenarios_are_reported() -> None:
    lines = dropped(report(unfit={"t.py::a": 1}, left_out={"t.py::b": 2}))
    assert lines == [
        "2 points beyond v(d)max left out: 2 of t.py::b",
        "1 scenario in which a vehicle has no room where it starts left out: 1 of t.py::a",
    ]


def test_merge_joins_extents_and_left_out_points() -> None:
    lanes = Extent(turns=2, classes={"lanes": (3, 4, 4)})
    made = record(1, "p1", "PASS")
    whole = merge([("a", report(made, extents={"x": EXTENT}, unfit={"t": 1})), ("b", report(made, extents={"x": lanes}))])
    assert whole.extents == {"x": structs.replace(EXTENT, classes={**EXTENT.classes, **lanes.classes})}
    assert whole.unfit == {"t": 1}

"""What changed since a baseline, from records written by hand."""

from fnmatch import fnmatchcase
from typing import Any

import pytest
from msgspec.structs import replace

from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.report.files import markdown
from pytest_rvads.report.record import conclude, planned_record
from pytest_rvads.report.session_report import Comparison, Report, compare, with_baseline
from pytest_rvads.report.terminal import summary
from pytest_rvads.runs.measured import Kpis


def record(
    name: str, status: str, *, known: str | None = None, margin: float | None = None, rule: str = "p1", **kpis: Any
) -> Any:
    keys = {"junction": "stop4", "cls": 1, "scenario": "1111", "cfg": "C", "rotation": 0, "rule": rule}
    made = planned_record(name, 3, "test", keys, 4)
    if status == "NOT RUN":
        return made
    outcome = "skipped" if status in ("NA", "UNSURE") or known else "passed" if status == "PASS" else "failed"
    given = Status(status)
    verdicts = [Verdict("", given, "", violated="both in", instances=(InstanceVerdict((), given, margin=margin),))]
    made = replace(made, kpis=Kpis(**kpis))
    return conclude(made, verdicts, "call", outcome, known=known, text="p1 at t=1.00 s: both in")


def changes(before: list[Any], now: list[Any], gone: bool = False) -> Comparison:
    return compare(Report(tuple(now)), Report(tuple(before)), "old.json", lambda _: gone)


@pytest.mark.parametrize(
    ("before", "now", "kind"),
    [
        ("PASS", "FAIL", "NEW"),
        ("NA", "OPEN", "NEW"),
        (None, "FAIL", "NEW"),
        ("FAIL", "FAIL", "UNCHANGED"),
        ("FAIL", "PASS", "FIXED"),
        ("FAIL", "NA", "LOST"),
        ("PASS", "NA", "LOST"),
        ("PASS", "PASS", "UNCHANGED"),
        ("NA", "NA", "UNCHANGED"),
        ("NA", "PASS", "ADDED"),
        (None, "PASS", "ADDED"),
        (None, "NA", "ADDED"),
        ("PASS", "UNSURE", "LOST"),
        ("FAIL", "UNSURE", "LOST"),
        ("NA", "UNSURE", "UNCHANGED"),
        ("UNSURE", "UNSURE", "UNCHANGED"),
        ("UNSURE", "PASS", "ADDED"),
        ("UNSURE", "FAIL", "NEW"),
        ("PASS", "NOT RUN", "NOT RUN"),
        ("FAIL", "NOT RUN", "NOT RUN"),
    ],
)
def test_kinds(before: str | None, now: str, kind: str) -> None:
    found = changes([record("t", before)] if before else [], [record("t", now)])
    assert [c.kind for c in found.changes] == [kind]


def test_a_pass_that_became_unsure_is_told() -> None:
    (change,) = changes([record("t", "PASS")], [record("t", "UNSURE")]).changes
    assert change.text == "was PASS, is UNSURE"


def test_known_failures() -> None:
    known = record("t", "FAIL", known="I3: order")
    assert [c.kind for c in changes([known], [known]).changes] == ["UNCHANGED"]
    assert [c.kind for c in changes([known], [record("t", "PASS")]).changes] == ["FIXED"]
    assert [c.kind for c in changes([known], [record("t", "FAIL")]).changes] == ["NEW"]
    assert [c.kind for c in changes([record("t", "PASS")], [known]).changes] == ["KNOWN"]


def test_a_margin_that_fell_is_eroded() -> None:
    # A margin of -2 s: the vehicle waited two seconds longer than it had to.
    before = record("t", "PASS", margin=-2.0, pet=3.0)
    assert changes([before], [record("t", "PASS", margin=-1.6, pet=2.6)]).count("UNCHANGED") == 1
    (change,) = changes([before], [record("t", "PASS", margin=-1.4, pet=2.6)]).changes
    assert (change.kind, change.text) == ("ERODED", "margin of p1 2.00 -> 1.40 s")
    (change,) = changes([before], [record("t", "PASS", margin=-2.5, pet=1.0)]).changes
    assert change.text == "pet 3.00 -> 1.00 s"
    assert changes([before], [record("t", "FAIL", margin=1.0, pet=-1.0)]).count("NEW") == 1, "worse than eroded"


@pytest.mark.parametrize(
    ("before", "now", "kind"),
    [
        ({"ttc": 900.0}, {"ttc": 834.0}, "UNCHANGED"),
        ({"ttc": 834.0}, {"ttc": 4.0}, "UNCHANGED"),
        ({"ttc": 4.5}, {"ttc": 3.9}, "ERODED"),
        ({"pet": 20.0}, {"pet": 5.0}, "UNCHANGED"),
        ({"pet": 20.0}, {"pet": 4.9}, "ERODED"),
        ({"margin": -30.0}, {"margin": -5.0}, "UNCHANGED"),
        ({"margin": -30.0}, {"margin": -4.9}, "ERODED"),
    ],
)
def test_a_margin_above_its_threshold_has_not_eroded(before: dict[str, Any], now: dict[str, Any], kind: str) -> None:
    (change,) = changes([record("t", "PASS", **before)], [record("t", "PASS", **now)]).changes
    assert change.kind == kind


def run_of(rules: int, run: str, *, wrong: str = "", **margins: Any) -> list[Any]:
    """The records of one run, a rule each."""
    names = [f"p{number}" for number in range(1, rules + 1)]
    made = [record(f"t[{run}-{name}]", "FAIL" if name == wrong else "PASS", rule=name, **margins) for name in names]
    return [replace(one, hash=f"{run} {sorted(margins.items())}") for one in made]


def test_erosion_is_told_once_per_run() -> None:
    before = run_of(10, "a", ttc=3.0) + run_of(10, "b", ttc=3.0)
    now = run_of(10, "a", ttc=1.0) + run_of(10, "b", ttc=2.0)
    found = changes(before, now)
    assert found.headline == "against old.json: 2 ERODED, 18 UNCHANGED"
    assert list(found.lines()) == [
        "ERODED  t[a-p1]  ttc 3.00 -> 1.00 s, in 10 items of its run",
        "ERODED  t[b-p1]  ttc 3.00 -> 2.00 s, in 10 items of its run",
    ]
    kinds = [one.change for one in with_baseline(Report(tuple(now)), found).records]
    assert kinds == ["ERODED", *["UNCHANGED"] * 9] * 2, "records say what the changes say"


def test_rules_of_a_run_tell_their_margins_together() -> None:
    found = changes(run_of(7, "a", margin=-3.0, pet=4.0), run_of(7, "a", margin=-1.0, pet=2.0))
    (change,) = (one for one in found.changes if one.kind == "ERODED")
    margins = ", ".join(f"margin of p{number} 3.00 -> 1.00 s" for number in range(1, 8))
    assert change.text == f"pet 4.00 -> 2.00 s, {margins}, in 7 items of its run"


def test_a_run_in_which_something_fails_is_new_and_not_eroded() -> None:
    before, now = run_of(3, "a", ttc=3.0), run_of(3, "a", wrong="p3", ttc=1.0)
    assert changes(before, now).headline == "against old.json: 1 NEW, 2 UNCHANGED"
    again = changes(run_of(3, "a", wrong="p1", ttc=3.0), run_of(3, "a", wrong="p1", ttc=1.0))
    assert [one.kind for one in again.changes] == ["UNCHANGED", "ERODED", "UNCHANGED"], "it failed before, too"


@pytest.mark.parametrize(
    ("before", "now", "kind", "style"),
    [
        (record("t", "PASS"), record("t", "FAIL"), "NEW", "1;31"),
        (record("t", "FAIL"), record("t", "PASS"), "FIXED", "32"),
        (record("t", "PASS"), record("t", "NA"), "LOST", "33"),
        (record("t", "PASS", margin=-2.0), record("t", "PASS", margin=-1.0), "ERODED", "33"),
    ],
)
def test_the_terminal_colours_what_changed(before: Any, now: Any, kind: str, style: str) -> None:
    report = with_baseline(Report((now,), {4: (24, 81)}), changes([before], [now]))
    assert f"\x1b[{style}m  {kind}" in summary(report, colour=True, width=100, unicode=True)


def test_empty_comparison_says_nothing_to_compare() -> None:
    assert changes([], []).headline == "against old.json: nothing to compare"


def test_items_without_a_record_are_lost_or_outside() -> None:
    old = [record("a", "PASS"), record("b", "NA")]
    assert changes(old, []).count("OUTSIDE") == 2
    lost = changes(old, [], gone=True)
    assert [(c.kind, c.nodeid, c.text) for c in lost.changes] == [("LOST", "a", "was PASS, does not exist any more")]


def test_summary_and_report_tell_what_changed_before_the_causes() -> None:
    old = [replace(record(f"t{i}", "PASS"), simulator="bullet") for i in range(12)]
    now = [replace(record(f"t{i}", "FAIL"), simulator="mine") for i in range(12)] + [record("u", "PASS")]
    base = Report(tuple(old), {4: (24, 81)}, versions={"numpy": "1.0", "python": "3.11"})
    report = Report(tuple(now), {4: (24, 81)}, versions={"numpy": "2.0", "python": "3.11"})
    report = with_baseline(report, compare(report, base, "old.json", lambda _: False))
    text = summary(report, colour=False, width=100, unicode=False).splitlines()
    text = text[text.index("against old.json: 12 NEW, 1 ADDED") :]
    assert text[:4] == [
        "against old.json: 12 NEW, 1 ADDED",
        "  numpy was 1.0 and is 2.0",
        "  the simulator was bullet and is mine",
        "  NEW     t0  p1 at t=1.00 s: both in",
    ]
    assert text[13:15] == ["  NEW     ... and 2 more", '          first: pytest "t0"']
    assert markdown(report).index("against old.json") < markdown(report).index("Causes")
    assert markdown(report).count("- NEW     ") == 12, "a file has room for all"
    assert [r.change for r in report.records] == ["NEW"] * 12 + ["ADDED"]


OTHERS = {
    "driver": (
        {"driver": "mine.Old"},
        {"driver": "mine.New"},
        "1 item driven by mine.Old then and by mine.New now: not compared, which rvads report compare does all the same",
    ),
    "map": ({"place": "a1"}, {"place": "b2"}, "1 item at a junction that is not the same any more: not compared, which *"),
    "formula": ({"formula": "a1"}, {"formula": "b2"}, "1 item by a rule p1 that is not the same any more: not compared, which *"),
    "rule": ({"rule": "p2"}, {}, "1 item by a rule p1 that is not the same any more: not compared, which *"),
}


@pytest.mark.parametrize(("before", "now", "says"), OTHERS.values(), ids=OTHERS)
def test_baseline_of_another_driver_map_or_formula_is_told_and_lets_nothing_pass(before: Any, now: Any, says: str) -> None:
    old, new = replace(record("t", "FAIL"), **before), replace(record("t", "FAIL"), **now)
    found = changes([old], [new])
    assert [change.kind for change in found.changes] == ["NEW"]
    assert len(found.versions) == 1
    assert fnmatchcase(found.versions[0], says)
    assert [change.kind for change in changes([old], [replace(record("t", "PASS"), **now)]).changes] == ["LOST"]
    asked = compare(Report((new,)), Report((old,)), "old.json", lambda _: False, same=False)
    assert [change.kind for change in asked.changes] == ["UNCHANGED"]
    assert asked.versions[0].endswith(": compared all the same")


def test_baseline_of_which_driver_and_formula_are_not_known_is_compared() -> None:
    """Reports of earlier versions hold no formulas, and nobody drives what was recorded."""
    found = changes([record("t", "FAIL")], [replace(record("t", "FAIL"), driver="mine.Pilot", formula="a1")])
    assert ([change.kind for change in found.changes], found.versions) == (["UNCHANGED"], ())

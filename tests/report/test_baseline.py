"""What changed since a baseline, from records written by hand."""

from typing import Any

import pytest
from msgspec.structs import replace

from pytest_rvads.report.baseline import compare, with_baseline
from pytest_rvads.report.markdown import markdown
from pytest_rvads.report.record import Indicators, conclude, planned_record
from pytest_rvads.report.session_report import Comparison, Report
from pytest_rvads.report.terminal import summary


def record(name: str, status: str, *, known: str | None = None, margin: float | None = None, pet: float | None = None) -> Any:
    keys = {"junction": "stop4", "cls": 1, "scenario": "1111", "cfg": "C", "rotation": 0, "rule": "p1"}
    made = planned_record(name, 3, "test", keys, 4)
    if status == "NOT RUN":
        return made
    outcome = "skipped" if status in ("NA", "UNSURE") or known else "passed" if status == "PASS" else "failed"
    verdicts = [{"status": status, "cause": "both in", "instances": [{"margin": margin}]}]
    made = replace(made, kpis=Indicators(pet=pet))
    return conclude(made, verdicts, "call", outcome, known=known, text="p1 at t=1.00 s: both in")


def changes(before: list[Any], now: list[Any], gone: bool = False) -> Comparison:
    return compare(Report(tuple(now)), Report(tuple(before)), "old.json", 0.5, lambda _: gone)


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
    assert (change.kind, change.text) == ("ERODED", "margin 2.00 -> 1.40 s")
    (change,) = changes([before], [record("t", "PASS", margin=-2.5, pet=1.0)]).changes
    assert change.text == "pet 3.00 -> 1.00 s"
    assert changes([before], [record("t", "FAIL", margin=1.0, pet=-1.0)]).count("NEW") == 1, "worse than eroded"


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


def test_where_there_is_nothing_to_compare_it_says_so() -> None:
    assert changes([], []).headline == "against old.json: nothing to compare"


def test_what_the_session_has_no_record_of() -> None:
    old = [record("a", "PASS"), record("b", "NA")]
    assert changes(old, []).count("OUTSIDE") == 2
    lost = changes(old, [], gone=True)
    assert [(c.kind, c.nodeid, c.text) for c in lost.changes] == [("LOST", "a", "was PASS, does not exist any more")]


def test_summary_and_report_start_with_what_changed() -> None:
    old = [replace(record(f"t{i}", "PASS"), simulator="bullet") for i in range(12)]
    now = [replace(record(f"t{i}", "FAIL"), simulator="mine") for i in range(12)] + [record("u", "PASS")]
    base = Report(tuple(old), {4: (24, 81)}, versions={"numpy": "1.0", "python": "3.11"})
    report = Report(tuple(now), {4: (24, 81)}, versions={"numpy": "2.0", "python": "3.11"})
    report = with_baseline(report, compare(report, base, "old.json", 0.5, lambda _: False))
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

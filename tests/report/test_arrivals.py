"""Orders of arrival in the summary, from records written by hand."""

import pytest
from msgspec import structs

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.report.counting import counts_of
from pytest_rvads.report.record import Record, conclude, planned_record
from pytest_rvads.report.rollup import junction_lines
from pytest_rvads.report.session_report import Report
from pytest_rvads.runs.measured import Kpis, VehicleKpis


def run(number: int, subject: str | None, pet: float | None, **arrivals: float | None) -> Record:
    """An item whose run has vehicles that arrived at these times [s]."""
    keys = {"junction": "stop4", "cls": 1, "scenario": "1111", "cfg": "S21", "rotation": 0, "seat": 0, "rule": "progress"}
    start = planned_record(f"t.py::test[{number}]", 3, "test", keys, 4)
    kpis = Kpis(tuple(VehicleKpis(agent, time) for agent, time in arrivals.items()), pet=pet)
    return conclude(
        structs.replace(start, hash=f"h{number}", kpis=kpis), [Verdict("", Status.PASS, "", subject=subject)], "call", "passed"
    )


def told(*records: Record) -> list[str]:
    counts = counts_of(Report(records))
    (site,) = counts.first
    return list(junction_lines(counts, site))[1:]


def test_simultaneous_arrivals_are_counted_of_all() -> None:
    runs = [run(k, "a0", 1.0, a0=5.0, a1=5.0 + gap, a2=5.0) for k, gap in enumerate((0.0, 0.5, -0.5))]
    assert told(*runs, *runs) == ["stop4: the subject arrived together with others in 3 of 3 runs"], "items of one run count once"


def test_orders_of_arrival_are_told_with_their_gaps() -> None:
    runs = (
        run(1, "a0", 1.9, a0=5.0, a1=5.2, a2=9.0),
        run(2, "a1", 1.9, a0=3.5, a1=5.0, a2=3.0),
        run(3, "a0", 1.9, a0=5.0, a1=2.0, a2=None),
        run(4, "a0", 1.9, a0=5.0, a1=6.5, a2=9.0),
        run(5, "a0", None, a0=5.0),
    )
    orders = "together with others in 1 of 5 runs, after others in 2 (by 1.5 to 3.0 s), before others in 1 (by 1.5 s), alone in 1"
    assert told(*runs) == [f"stop4: the subject arrived {orders}"]


@pytest.mark.parametrize(("pet", "apart"), [(1.9, 0), (-3.0, 0), (2.0, 1), (None, 1)])
def test_runs_without_a_meeting_on_a_shared_stretch_are_counted(pet: float | None, apart: int) -> None:
    (line,) = told(run(1, "a0", pet, a0=5.0, a1=5.0))
    assert line.endswith("; in 1 run no vehicles were within 2 s on a shared stretch") == bool(apart)


@pytest.mark.parametrize("subject", [None, "a7"])
def test_arrivals_need_a_subject_that_arrived(subject: str | None) -> None:
    assert told(run(1, subject, 1.0, a0=5.0, a1=5.0)) == []

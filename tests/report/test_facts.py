"""What stands beside a replay, told from the record of its item."""

from typing import Any

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.report.failures import facts
from pytest_rvads.report.record import Record, conclude, planned_record

KEYS: dict[str, Any] = {
    "junction": "stop4",
    "cls": 7,
    "scenario": "1133",
    "cfg": "C",
    "rotation": 0,
    "rule": "full_stop",
    "driver": "a.Racer",
}


def failed(**more: Any) -> Record:
    record = planned_record("test_it.py::test_it[x]", 1, "test_it", {**KEYS, "simulator": "bullet", **more}, 4, ("REQ-1",))
    return conclude(record, [Verdict("full_stop", Status.FAIL, "", title="full stop", subject="a0")], "call", "failed")


def test_facts_of_a_failure_are_ordered() -> None:
    assert facts(failed(source="a.py 3fa29c01"), "from here", "pytest x") == (
        ("scenario", "from here"),
        ("driven by", "a.Racer (a.py 3fa29c01)"),
        ("simulated by", "bullet"),
        ("rule", "full_stop: full stop"),
        ("requirements", "REQ-1"),
        ("rerun", "pytest x"),
    )


def test_beside_a_vehicle_under_test_the_traffic_is_told() -> None:
    told = dict(facts(failed(seat=0, traffic="hesitant"), "", ""))
    assert told["driven by"] == "a.Racer, a0 alone; the others by hesitant"
    assert "scenario" not in told
    assert "rerun" not in told


def test_of_a_recorded_run_nothing_drives() -> None:
    start = planned_record("a", 1, "a", {"junction": "stop4", "recording": "tue", "rule": "full_stop"}, 4, ("REQ-1",))
    record = conclude(start, [Verdict("full_stop", Status.FAIL, "", title="full stop", subject="a0")], "call", "failed")
    told = dict(facts(record, "tue.npz", ""))
    assert told == {"recorded": "tue.npz", "rule": "full_stop: full stop", "requirements": "REQ-1"}


def test_a_rule_without_a_verdict_or_title_is_its_name() -> None:
    record = planned_record("a", 1, "a", KEYS, 4)
    assert dict(facts(record, "", ""))["rule"] == "full_stop"
    assert Verdict("mine", Status.FAIL, "").title == ""

"""Reports as JUnit XML."""

from xml.etree import ElementTree

import pytest
from msgspec import structs

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.files import junit
from pytest_rvads.report.record import Record, conclude, planned_record
from pytest_rvads.report.session_report import Report


def record(name: str, status: Status, outcome: str, text: str = "", known: str | None = None) -> Record:
    keys = {"junction": "stop4", "cls": 7, "scenario": "1133", "cfg": "C", "rotation": 0, "rule": "p1"}
    start = planned_record(name, 3, "test", keys, 4)
    return conclude(start, [Verdict("p1", status, text)], "call", outcome, text=text, known=known)


def test_every_item_is_a_case_with_its_end_and_properties() -> None:
    broken = structs.replace(record("t.py::test[e]", Status.FAIL, "failed", "no gap"), status=Outcome.ERROR)
    records = (
        record("dir/t.py::test[a]", Status.PASS, "passed"),
        record("dir/t.py::test[b]", Status.FAIL, "failed", "p1 at t=1.00 s: \x1b[31m<both>\x00 in & out"),
        record("t.py::test[c]", Status.NA, "skipped", "p1 NA"),
        record("t.py::test[d]", Status.FAIL, "skipped", "p1", known="I3: order"),
        broken,
        planned_record("stop4-class07-p1", 0, "", {"junction": "stop4", "rule": "p1"}, 4),
    )
    (suite,) = ElementTree.fromstring("".join(junit(Report(records))).encode())
    cases = list(suite.iter("testcase"))
    assert [(case.get("classname"), case.get("name")) for case in cases] == [
        ("stop4", "dir/t.py::test[a]"),
        ("stop4", "dir/t.py::test[b]"),
        ("stop4", "t.py::test[c]"),
        ("stop4", "t.py::test[d]"),
        ("stop4", "t.py::test[e]"),
        ("stop4", "stop4-class07-p1"),
    ]
    ends = [[(end.tag, end.get("message")) for end in case if end.tag != "properties"] for case in cases]
    assert ends[1][0][1] is not None
    assert ends[1][0][1].startswith("p1 at t=1.00 s: ")
    assert ends[1][0][1].endswith(" in & out")
    assert [[tag for tag, _ in end] for end in ends] == [[], ["failure"], ["skipped"], ["skipped"], ["error"], ["skipped"]]
    assert [end[0][1] for end in (ends[2], ends[3], ends[4], ends[5])] == ["p1 NA", "I3: order", "no gap", "NOT RUN"]
    told = {one.get("name"): one.get("value") for one in cases[0].iter("property")}
    assert told.items() >= {"junction": "stop4", "class": "7", "rule": "p1", "verdict": "PASS"}.items()


@pytest.mark.parametrize("text", ["\x00", "\ud800", "]]>", "\ufffe"])
def test_texts_that_xml_can_not_hold_are_escaped(text: str) -> None:
    ElementTree.fromstring("".join(junit(Report((record("t.py::t", Status.FAIL, "failed", text),)))).encode("utf-8"))

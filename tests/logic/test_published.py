"""What others published: verdicts of the paper's recorded runs, sizes of monitors."""

import json
from pathlib import Path

import pytest

from pytest_rvads.logic.check import check
from pytest_rvads.logic.ltl.ltl3 import synthesize
from pytest_rvads.logic.ltl.parser import parse_ltl
from pytest_rvads.runs.readers import read_recorded

RULES = {
    "one-car-in-junction": "p1",
    "right-of-priority": "p2",
    "fifo-priority": "p3",
    "traffic-light": "p4",
    "right-turn-priority": "p5",
    "opposite-turn-priority": "p6",
}
STATUS = {"True": "PASS", "False": "FAIL", "None": "NA"}
FILES = {"4-way-stop": 60, "4-way-light": 60, "t-way-stop": 99, "t-way-light": 93}


@pytest.mark.parametrize("itinerary", [True, False], ids=["static-direction", "temporal-take"])
@pytest.mark.parametrize("name", FILES)
def test_recorded_runs_get_their_published_verdicts(shared: Path, name: str, itinerary: bool) -> None:
    wrong, count = [], 0
    for run in read_recorded(shared / "runs" / f"{name}.json"):
        for published, wanted in run.provenance["verdicts"].items():
            got = check(run, RULES[published], itinerary=itinerary)
            count += 1
            if got.status != STATUS[wanted]:
                wrong.append((run.label, got.message, wanted))
    assert not wrong
    assert count == FILES[name], "every rule of every run was judged"


@pytest.mark.parametrize(("file", "count"), [("dwyer55", 55), ("published_sizes", 95)])
def test_monitors_have_the_published_sizes(shared: Path, file: str, count: int) -> None:
    entries = json.loads((shared / "monitors" / f"{file}.json").read_text())
    got = {e["formula"]: synthesize(parse_ltl(e["formula"])).states for e in entries}
    assert {e["formula"]: e["states"] for e in entries} == got
    assert len(entries) == count

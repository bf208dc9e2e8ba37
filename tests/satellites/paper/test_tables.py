"""The paper's two tables: as published for the classes they were fitted on, and as the text says for the others."""

import ast
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import pytest_rvads
from pytest_rvads.satellites.paper.tables import (
    FITTED,
    LIGHT,
    ROWS,
    STOP,
    TABLES,
    WAIT,
    Entry,
    Key,
    Setup,
    agreement,
    compute,
    crossing_wait,
    draw_range,
    entries,
    judge,
    nested,
    null_models,
    outcome,
    published,
    run_entry,
)

ENTRIES = [entry for table in TABLES for entry in entries(table)]
KEYS = [entry.key(rule) for entry in ENTRIES for rule in entry.table.rules]


def taken(entry: Entry) -> bool:
    """Say whether a run is in the part: of each class and configuration a row, in turn, and with stop signs row 3 as well.

    In row 3 p1 is said to pass where it fails in the others, so both verdicts of C, D and E are there. `slow` has all runs.
    """
    turn = (entry.table.configurations.index(entry.configuration) + 1) % ROWS
    return entry.row == turn or (entry.table is STOP and entry.row == 2)


@pytest.fixture(scope="module")
def part() -> dict[Key, str]:
    return {entry.key(rule): verdict for entry in filter(taken, ENTRIES) for rule, verdict in judge((entry, Setup())).items()}


@pytest.fixture(scope="module")
def verdicts() -> dict[Key, str]:
    return compute(executor=1)


# With stop signs nine runs (five rows in turn, and four times row 3 as well), with lights five, of three rules each. The paper
# does not say what p1 is in D and E of class 2, two rows each.
@pytest.mark.extended
@pytest.mark.parametrize(("numbers", "cells"), [(FITTED, (9 + 5) * 3), ((2, 4), (9 + 5) * 3 - 4)])
def test_part_of_every_class_and_configuration_is_as_published(
    part: dict[Key, str], numbers: tuple[int, ...], cells: int
) -> None:
    expected = {key: value for key, value in published(numbers).items() if key in part}
    assert {key: (part[key], value) for key, value in expected.items() if part[key] != value} == {}
    assert len(expected) == cells


@pytest.mark.slow
def test_cells_of_classes_1_and_3_are_as_published(verdicts: dict[Key, str]) -> None:
    wrong = {key: (verdicts[key], value) for key, value in published(FITTED).items() if verdicts[key] != value}
    assert not wrong
    assert agreement(verdicts, FITTED) == (120, 120)


@pytest.mark.slow
def test_classes_2_and_4_are_as_the_text_of_the_paper_says(verdicts: dict[Key, str]) -> None:
    assert agreement(verdicts, (2, 4)) == (112, 112), "nothing was fitted on these classes but the draw of J"


@pytest.mark.slow
def test_every_cell_is_computed(verdicts: dict[Key, str]) -> None:
    assert list(verdicts) == KEYS
    assert len(verdicts) == 240
    assert set(verdicts.values()) == {"PASS", "FAIL", "NA"}


def test_json_is_nested_by_table_class_and_row() -> None:
    shape = json.loads(json.dumps(nested(dict.fromkeys(KEYS, "PASS"))))
    assert [list(shape), list(shape["stop4"]), list(shape["light4"])] == [
        ["stop4", "light4"],
        ["class1", "class2"],
        ["class3", "class4"],
    ]
    rows = shape["stop4"]["class1"]
    assert [rows[row]["directions"] for row in ("row1", "row2", "row3", "row4")] == ["2111", "1211", "1121", "1112"]
    assert [shape["light4"]["class4"][row]["directions"] for row in ("row1", "row2", "row3", "row4")] == [
        "2121",
        "1212",
        "2121",
        "1212",
    ]
    assert list(rows["row1"]) == ["directions", "A", "B", "C", "D", "E"]
    assert list(rows["row1"]["A"]) == ["p1", "p2", "p3"]
    assert list(shape["light4"]["class3"]["row2"]["J"]) == ["p4", "p5", "p6"]


def test_published_tables_match_the_recordings(shared: Path) -> None:
    # An independent copy: the verdicts that the authors stored with their runs.
    names = {"one-car-in-junction": "p1", "right-of-priority": "p2", "fifo-priority": "p3"}
    names |= {"traffic-light": "p4", "right-turn-priority": "p5", "opposite-turn-priority": "p6"}
    words = {"True": "PASS", "False": "FAIL", "None": "NA"}
    letters = {"0.01,0.01,0.01,0.01": "AF", "0.3,0.3,0.3,0.3": "BG", "0.3,0.3,20,20": "EE", "20,0.3,20,0.3": "JJ"}
    says = published(FITTED)
    seen = 0
    for file, number, index in (("4-way-stop", 1, 0), ("4-way-light", 3, 1)):
        for run in json.loads((shared / "runs" / f"{file}.json").read_text())["runs"]:
            distances, speeds, row = run["name"].rsplit("_", 3)[1:]
            letter = ("DI" if speeds.startswith("10") else "CH") if distances == "20,20,20,20" else letters[distances]
            for rule, value in run["verdicts"].items():
                assert says[number, int(row[2:]), letter[index], names[rule]] == words[value]
                seen += 1
    assert seen == 120


def test_draw_of_the_tables_follows_from_a_dry_run() -> None:
    assert crossing_wait() == WAIT


@pytest.mark.parametrize(("offset", "expected"), [(-0.03, "FAIL"), (0.04, "FAIL"), (-0.2, "NA"), (0.2, "PASS")])
def test_j_fails_only_within_a_window_of_draws(offset: float, expected: str) -> None:
    verdicts = outcome(run_entry(Entry(LIGHT, 4, 1, "J"), Setup(wait=round(WAIT + offset, 2))), ("p5",))
    assert verdicts == {"p5": expected}


def test_vehicles_that_face_red_draw() -> None:
    assert draw_range(Entry(STOP, 1, 0, "A")) is None
    assert draw_range(Entry(LIGHT, 3, 2, "F")) == (1.0, 2.0), "left turns that face red"
    assert draw_range(Entry(LIGHT, 4, 1, "J")) == (0.0, 4.0), "right turns that face red"


def test_null_model_by_rule_and_configuration_gets_117_cells() -> None:
    # Counted by hand: all cells of a rule and configuration are equal, except row 3 of p1 in C, D and E.
    assert null_models()["by rule and configuration"] == 120 - 3
    assert null_models()["by rule, configuration and row"] == 120


@pytest.mark.extended
def test_verdicts_are_the_same_in_other_processes(part: dict[Key, str]) -> None:
    few = replace(STOP, configurations="CE")
    computed = compute(tables=(few,), numbers=(1,), executor=2)
    assert list(computed) == [key for key in KEYS if key[0] == 1 and key[2] in "CE"]
    both = computed.keys() & part.keys()
    assert {key: computed[key] for key in both} == {key: part[key] for key in both}
    assert len(both) == (2 + 2) * 3, "of C rows 3 and 4, of E rows 2 and 3"


@pytest.mark.slow
def test_halving_the_step_changes_no_verdict(verdicts: dict[Key, str], tmp_path: Path) -> None:
    package = Path(pytest_rvads.__file__).parent
    shutil.copytree(package, tmp_path / "pytest_rvads", ignore=shutil.ignore_patterns("__pycache__"))
    run = tmp_path / "pytest_rvads" / "runs" / "run.py"
    source = run.read_text()
    assert source.count("\nDT = 0.01\n") == 1
    run.write_text(source.replace("\nDT = 0.01\n", "\nDT = 0.005\n"))
    code = "from pytest_rvads.satellites.paper.tables import compute; print(repr(compute(executor=1)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert ast.literal_eval(done.stdout) == verdicts

"""Variants in the matrix, from records written by hand."""

from collections.abc import Iterable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.matrix import Matrices, Matrix, member_of
from pytest_rvads.report.record import Record, conclude, planned_record, properties
from pytest_rvads.report.session_report import Report, cell_of
from pytest_rvads.report.terminal import summary
from pytest_rvads.satellites.pages.page import page


def record(variant: str, cls: int, cfg: str = "C", rule: str = "p1", status: str = "PASS") -> Record:
    keys = {"junction": "stop4", "cls": cls, "scenario": "1111", "cfg": cfg, "rotation": 0, "rule": rule, "variant": variant}
    made = planned_record(f"t.py::test[{variant}-stop4-class{cls:02d}-as1111-cfg{cfg}-{rule}]", 3, "test", keys, 4)
    outcome = "failed" if status in ("FAIL", "OPEN") else "skipped" if status == "NA" else "passed"
    return conclude(made, [Verdict("", Status(status), "")], "call", outcome, text=f"{status} told")


def matrix(records: Iterable[Record]) -> Matrix:
    matrices = Matrices()
    for one in records:
        matrices.add(one)
    (found,) = matrices.matrices()
    return found


VARIANTS = st.sampled_from(["", "v1", "v2", "v10", "a, b", "v1  01", "1", "01"]) | st.text(max_size=8)
PLACES = st.tuples(VARIANTS, st.integers(1, 30), st.sampled_from("BCE"), st.sampled_from(["p1", "p2"]))


@pytest.mark.extended
@given(st.dictionaries(PLACES, st.sampled_from(["PASS", "FAIL", "OPEN", "NA"]), min_size=1, max_size=40))
def test_every_verdict_can_be_read_back(verdicts: dict[tuple[str, int, str, str], str]) -> None:
    found = matrix(record(*place, status) for place, status in verdicts.items())
    read: dict[tuple[str, int | str, str, str], str] = {}
    for variant, members, (_, entries) in zip(found.variants, found.members, found.rows, strict=True):
        for member in members:
            cells = zip(found.columns, entries, strict=True)
            read |= {(variant, member, cfg, rule): entry.text for (cfg, rule), entry in cells if entry.text}
    assert read == {
        (variant, member_of(record(variant, cls)), cfg, rule): Outcome(status).cell
        for (variant, cls, cfg, rule), status in verdicts.items()
    }
    seen = list(found.variants)
    assert seen == [variant for variant in dict.fromkeys(seen) for _ in range(seen.count(variant))], "rows of one lie together"
    assert len({(variant, entries) for variant, (_, entries) in zip(seen, found.rows, strict=True)}) == len(found.rows)


def test_rows_of_one_version_are_merged() -> None:
    found = matrix(record(variant, cls) for variant in ("v10", "v9") for cls in (1, 2, 4))
    assert [label for label, _ in found.rows] == ["v9  01-02, 04", "v10  01-02, 04"]
    assert found.members == (("v9 1", "v9 2", "v9 4"), ("v10 1", "v10 2", "v10 4"))
    assert found.corner == "variant, class"


def test_without_variants_a_row_is_that_of_a_class() -> None:
    found = matrix(record("", cls) for cls in (1, 2))
    assert (found.corner, found.variants, found.members) == ("class", ("",), ((1, 2),))
    assert found.rows[0][0] == "01-02"


def test_a_short_matrix_keeps_the_versions_that_fail_and_all_of_a_name() -> None:
    records = [record(f"a, b, {n}", cls, status="FAIL" if n == 30 else "PASS") for n in range(31) for cls in range(1, 60, 2)]
    found = matrix(records).shortened(5)
    assert found.variants[-1] == "a, b, 30"
    label = found.rows[-1][0]
    assert label.startswith("a, b, 30  01, 03, ")
    assert label.endswith(" and 20 more")


def test_recordings_have_variants_too() -> None:
    keys = {"junction": "stop4", "recording": "drive17", "rule": "p1"}
    rows = [
        conclude(planned_record(f"t.py::test[drive17-p1-{name}]", 3, "test", {**keys, "variant": name}, 4), [], "call", "passed")
        for name in ("strict", "loose")
    ]
    found = matrix(rows)
    assert [label for label, _ in found.rows] == ["loose  drive17", "strict  drive17"]
    assert found.corner == "variant, recording"


@pytest.mark.parametrize("width", [60, 80, 120])
def test_a_terminal_names_every_version(width: int) -> None:
    report = Report(tuple(record(f"v{n}", 1, status="FAIL" if n == 3 else "PASS") for n in range(1, 5)))
    lines = summary(report, colour=False, width=width, unicode=True).splitlines()
    told = {line.split()[0]: line.split()[-1] for line in lines if line.strip().startswith("v") and "  01" in line}
    assert told == {"v1": "pass", "v2": "pass", "v3": "FAIL", "v4": "pass"}


def test_a_page_finds_the_items_of_a_row() -> None:
    content = page(Report((record("v1", 1), record("v2", 1, status="FAIL"))), Path())
    assert content.count('"v1 1"') == content.count('"v2 1"') == 2, "an item and a row"


def test_coverage_cell_is_independent_of_the_variant() -> None:
    """Like two tests of one situation, two versions exercise one cell."""
    assert cell_of(record("v1", 1)) == cell_of(record("v2", 1))


def test_properties_name_the_variant() -> None:
    assert ("variant", "v1") in properties(record("v1", 1))
    assert "variant" not in dict(properties(record("", 1)))

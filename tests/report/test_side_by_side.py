"""Two sessions side by side, from records written by hand."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from msgspec import structs

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.report.record import Record, conclude, planned_record
from pytest_rvads.report.session_report import Report, cell_of
from pytest_rvads.report.side_by_side import SideBySide, save, sections, side_by_side, text
from pytest_rvads.runs.measured import Kpis
from pytest_rvads.support.errors import RvadsError

HOSTILE = "<script>alert(1)</script> | `x` [a](javascript:1) \x1b[31m @all\n# head"
BAD = ("FAIL", "OPEN")


def record(
    cls: int, status: str, *, cfg: str = "C", rule: str = "p1", variant: str = "", cause: str = "both in", pet: float = 1.0
) -> Record:
    keys = {"junction": "stop4", "cls": cls, "scenario": "1111", "cfg": cfg, "rotation": 0, "rule": rule, "variant": variant}
    made = planned_record(f"t.py::test[{variant}-stop4-class{cls:02d}-as1111-cfg{cfg}-{rule}]", 3, "test", keys, 4)
    made = structs.replace(made, driver="mine.Pilot", source="pilots.py 12ab34cd", kpis=Kpis(pet=pet))
    made = structs.replace(made, hash=f"{variant} {cls} {cfg}")
    if status == "NOT RUN":
        return made
    outcome = "failed" if status in BAD else "skipped" if status == "NA" else "passed"
    return conclude(made, [Verdict("", Status(status), "", violated=cause)], "call", outcome, text=f"{rule}: {cause}")


def report(*records: Record, **fields: Any) -> Report:
    return Report(records, {4: (24, 81)}, tuple(dict.fromkeys(map(cell_of, records))), **fields)


def beside(a: Report, b: Report) -> SideBySide:
    return side_by_side([("old.json", a), ("new.json", b)])


def told(found: SideBySide, most: int | None = None) -> dict[str, tuple[str, ...]]:
    return {section.title: section.lines for section in sections(found, most)}


def test_side_by_side_shows_differing_cells_only() -> None:
    a = report(*(record(cls, "PASS", cfg=cfg) for cls in (1, 2, 3) for cfg in "CE"), record(1, "NA", rule="p2"))
    b = report(
        *(record(cls, "FAIL" if cls > 1 else "PASS", cfg=cfg) for cls in (1, 2, 3) for cfg in "CE"), record(1, "NA", rule="p2")
    )
    found = told(beside(a, b))
    assert found["what changed from A to B"] == ("against A: 4 NEW, 3 UNCHANGED",)
    assert found["stop4   t.py::test: 4 of 7 cells differ"] == ("class 02-03, p1: pass -> FAIL (C, E)",)
    assert found["verdicts per rule"] == ("p1: 6 pass -> 2 pass, 4 fail", "p2: 1 NA in both")
    (table,) = (section for section in sections(beside(a, b)) if "differ" in section.title)
    assert (table.columns, table.rows) == (
        ("class", "C p1", "E p1"),
        ((("02-03", ""), ("pass -> FAIL", "bad"), ("pass -> FAIL", "bad")),),
    )


def test_the_head_tells_both_sessions() -> None:
    a = report(record(1, "PASS"), began="2026-01-01T10:00:00+00:00", command="pytest -q", versions={"numpy": "1.0"})
    b = report(record(1, "FAIL"), exitstatus=1, began="2026-01-02T10:00:00+00:00", versions={"numpy": "2.0"}, notes=("doubtful",))
    found = told(beside(a, b))
    assert {"began 2026-01-01T10:00:00+00:00", "command: pytest -q", "exit status 0"} <= set(found["A: old.json"])
    assert found["B: new.json"][0] == "note: doubtful"
    assert "exit status 1" in found["B: new.json"]
    for letter in ("A: old.json", "B: new.json"):
        assert any("mine.Pilot" in line and "pilots.py 12ab34cd" in line for line in found[letter])
    assert found["versions that differ"] == ("numpy was 1.0 and is 2.0",)


def test_changes_are_listed_by_kind() -> None:
    a = report(record(1, "PASS"), record(2, "FAIL"), record(3, "PASS", pet=3.0), record(4, "PASS"), record(5, "PASS"))
    b = report(record(1, "FAIL"), record(2, "PASS"), record(3, "PASS"), record(4, "NA"), record(6, "PASS"))
    found = beside(a, b)
    listed = {title: [line.split()[0] for line in lines] for title, lines in told(found).items() if "item" in title}
    assert listed == {
        "NEW: 1 item": ["t.py::test[-stop4-class01-as1111-cfgC-p1]"],
        "FIXED: 1 item": ["t.py::test[-stop4-class02-as1111-cfgC-p1]"],
        "ERODED: 1 item": ["t.py::test[-stop4-class03-as1111-cfgC-p1]"],
        "LOST: 2 items": [f"t.py::test[-stop4-class0{cls}-as1111-cfgC-p1]" for cls in (4, 5)],
    }
    (lines,) = (lines for title, lines in told(found).items() if "differ" in title)
    assert set(lines) == {
        "class 01, p1: pass -> FAIL (C)",
        "class 02, p1: FAIL -> pass (C)",
        "class 04, p1: pass -> NA (C)",
        "class 05, p1: pass -> absent (C)",
        "class 06, p1: absent -> pass (C)",
    }, "a margin is no verdict, and class 03 has the same one"


def test_equal_sessions_differ_in_nothing() -> None:
    one, other = report(record(1, "PASS"), record(2, "FAIL")), report(record(1, "PASS"), record(2, "FAIL"))
    assert told(beside(one, other))["what changed from A to B"] == ("no verdict of the 2 items that both have differs",)
    assert not [title for title in told(beside(one, other)) if "cells" in title or "item" in title]
    dated = report(record(1, "PASS"), began="2026-01-01T10:00:00+00:00")
    assert told(beside(dated, dated))["what changed from A to B"][0].endswith("they are reports of one session")
    part = report(record(1, "PASS"))
    (said,) = told(beside(report(record(1, "PASS"), record(1, "PASS", variant="v9")), part))["what changed from A to B"]
    assert said == "against A: 1 UNCHANGED, 1 OUTSIDE", "the situation is still asked about"


def test_rows_of_a_class_that_swap_their_verdicts_differ() -> None:
    """Of two rotations another one fails: both cells read 1/2 fail, and they are not the same."""

    def row(number: int, status: str) -> Record:
        one = record(1, status)
        return structs.replace(one, rotation=number, nodeid=f"{one.nodeid}.r{number}")

    found = beside(report(row(0, "FAIL"), row(1, "PASS")), report(row(0, "PASS"), row(1, "FAIL")))
    assert told(found)["stop4   t.py::test: 1 of 1 cells differs"] == ("class 01, p1: 1/2 fail -> 1/2 fail (C)",)


def test_versions_have_rows_of_their_own() -> None:
    a = report(*(record(cls, "PASS", variant=name) for cls in (1, 2) for name in ("v1", "v2")))
    b = report(*(record(cls, "OPEN" if name == "v2" else "PASS", variant=name) for cls in (1, 2) for name in ("v1", "v2")))
    assert told(beside(a, b))["stop4   t.py::test: 2 of 4 cells differ"] == ("v2, class 01-02, p1: pass -> OPEN (C)",)


def test_side_by_side_matches_causes_by_text() -> None:
    a = report(record(1, "FAIL"), record(2, "FAIL", cause="gone"), record(3, "FAIL", cause="late by 3.5 s"))
    b = report(record(1, "FAIL"), record(2, "FAIL", cause="here"), record(3, "FAIL", cause="late by 7 s"), record(4, "FAIL"))
    said = told(beside(a, b))["causes of failures"]
    assert [line.partition(" (first")[0] for line in said] == [
        "only in B: 1 x p1: here",
        "only in A: 1 x p1: gone",
        "in both: 1 -> 2 x p1: both in",
        "in both: 1 -> 1 x p1: late by 7 s",
    ]


def test_sessions_of_other_tests_can_not_be_compared() -> None:
    other = structs.replace(record(1, "PASS"), nodeid="other.py::test[x]")
    with pytest.raises(RvadsError, match=r"old.json \(1 item\) and new.json \(1 item\) have no item in common.*same tests"):
        beside(report(record(1, "PASS")), report(other))
    with pytest.raises(RvadsError, match=r"0 items"):
        beside(report(), report())


def test_too_many_differences_become_a_list() -> None:
    many = [record(cls, "PASS", cfg=f"c{cls}") for cls in range(1, 300)]
    found = beside(report(*many), report(*many[1:], record(1, "FAIL", cfg="c1")))
    assert told(found)["verdicts"] == ("too many for tables: the changes name the items",)
    assert len(told(found)["NEW: 1 item"]) == 1


def hostile() -> SideBySide:
    a = report(record(1, "PASS", variant=HOSTILE), began=HOSTILE, command=HOSTILE, versions={HOSTILE: "1"}, notes=(HOSTILE,))
    made = structs.replace(record(1, "FAIL", variant=HOSTILE, cause=HOSTILE), driver=HOSTILE)
    return side_by_side([(HOSTILE, a), (HOSTILE, report(made, versions={HOSTILE: "2"}))])


def test_pages_and_tables_escape_markup(tmp_path: Path) -> None:
    for ending in ("html", "md", "json"):
        save(tmp_path / f"out.{ending}", hostile())
    page, markdown, content = ((tmp_path / f"out.{ending}").read_text(encoding="utf-8") for ending in ("html", "md", "json"))
    assert "<script>alert" not in page
    assert "\x1b" not in page + markdown
    drawn = MarkdownIt("commonmark", {"html": True}).enable("table").render(markdown)
    assert not re.search(r"<script|<a |javascript:1\"", drawn)
    heads = [len(re.findall("<t[hd]", row)) for row in re.findall("<tr>.*?</tr>", drawn, re.DOTALL)]
    assert heads == [2, 2, 3, 3, 6, 6], "every row has the cells of its table"
    assert json.loads(content)["sides"][0]["name"] == HOSTILE


@pytest.mark.parametrize("width", [60, 80, 100, 120])
def test_a_terminal_shows_every_line_within_its_width(width: int) -> None:
    for line in text(hostile(), width).splitlines():
        assert line.isprintable()
        assert len(line) <= width or len(line.split()) == 1, "only a word that can't be broken is longer"


def test_a_terminal_counts_what_is_too_long() -> None:
    a, b = (report(*(record(cls, status, rule=f"p{cls}") for cls in range(1, 60))) for status in ("PASS", "FAIL"))
    lines = text(beside(a, b), 80).splitlines()
    assert len(lines) < 150
    assert lines.count("  ... and 49 more") == 3, "of the table, of what is new, of the rules"
    assert "NEW: 59 items" in lines
    assert lines[-1] == "what is left out here stands in files: -o FILE.html, FILE.md or FILE.json"
    assert len(list(told(beside(a, b))["verdicts per rule"])) == 59, "files hold them all"


def test_json_is_for_programs(tmp_path: Path) -> None:
    a = report(record(1, "PASS", variant="v1"), record(2, "PASS", variant="v1"))
    save(tmp_path / "out.json", beside(a, report(record(1, "FAIL", variant="v1"), record(2, "PASS", variant="v1"))))
    found = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert (found["format"], found["version"], found["common"]) == ("rvads-comparison", 1, 2)
    assert [(change["kind"], change["text"]) for change in found["changes"]] == [("NEW", "p1: both in")]
    assert found["tables"] == [
        {
            "title": "stop4   t.py::test",
            "junction": "stop4",
            "corner": "variant, class",
            "columns": [["C", "p1"]],
            "rows": [
                {"label": "v1  01", "variant": "v1", "cells": ["pass -> FAIL"]},
                {"label": "v1  02", "variant": "v1", "cells": ["="]},
            ],
        }
    ]
    assert found["rules"] == [{"rule": "p1", "verdicts": [{"PASS": 2}, {"FAIL": 1, "PASS": 1}]}]
    assert [(cause["where"], cause["counts"]) for cause in found["causes"]] == [("only in B", [0, 1])]


def test_unknown_ending_of_a_comparison_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RvadsError, match=r"a report is a \.json, .*, \.xml file, got '.*out\.txt'"):
        save(tmp_path / "out.txt", hostile())


@given(
    st.dictionaries(
        st.tuples(st.sampled_from(["", "v1", "v2"]), st.integers(1, 12), st.sampled_from("CE"), st.sampled_from(["p1", "p2"])),
        st.tuples(*2 * [st.sampled_from(["PASS", "FAIL", "OPEN", "NA", None])]),
        min_size=1,
        max_size=30,
    )
)
def test_every_difference_can_be_read_back(statuses: dict[tuple[str, int, str, str], tuple[str | None, str | None]]) -> None:
    both = {("v0", 1, "C", "p1"): ("PASS", "PASS"), **statuses}

    def side(number: int) -> Report:
        of = {place: found[number] for place, found in both.items()}
        return report(*(record(cls, s, cfg=cfg, rule=rule, variant=v) for (v, cls, cfg, rule), s in of.items() if s))

    (matrix,) = beside(side(0), side(1)).matrices or ()
    read: dict[tuple[str, str, str, str], str] = {}
    for variant, members, (_, entries) in zip(matrix.variants, matrix.members, matrix.rows, strict=True):
        for (cfg, rule), entry in zip(matrix.columns, entries, strict=True):
            read |= {(variant, str(member).rpartition(" ")[2], cfg, rule): entry.text for member in members}
    words = {None: "absent", "PASS": "pass", "FAIL": "FAIL", "OPEN": "OPEN", "NA": "NA"}
    for (variant, cls, cfg, rule), (was, now) in both.items():
        wanted = f"{words[was]} -> {words[now]}" if was != now else "=" if was else ""
        assert read.get((variant, str(cls), cfg, rule), "") == wanted

"""The summary in the terminal: nothing is cut at any width, tables together keep to a screen, and causes come last."""

import re
from collections import Counter
from collections.abc import Sequence

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace
from rich.cells import cell_len

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record, conclude, planned_record
from pytest_rvads.report.session_report import Change, Comparison, Report
from pytest_rvads.report.terminal import Cell, Column, Summary, blocks, summarise, summary, wrapped

WIDTHS = 40, 60, 80, 100, 120
WORDS = st.text("abc_XÄ1-.車", min_size=1, max_size=30).filter(lambda word: cell_len(word) <= 30)
LABELS = st.lists(WORDS, min_size=1, max_size=12).map(", ".join)
VERDICTS = st.sampled_from([outcome.cell for outcome in Outcome] + ["", "1/81 unavoidable, 2/81 xfail order of creation"])


@st.composite
def tables(draw: st.DrawFn) -> tuple[list[str], list[Column]]:
    """Names of rows, and columns in groups."""
    labels = draw(st.lists(LABELS, min_size=1, max_size=6))
    columns = []
    for group in draw(st.lists(WORDS, min_size=1, max_size=4)):
        for rule in draw(st.lists(WORDS, min_size=1, max_size=6)):
            # What has no verdict in any row is no column of a matrix.
            cells = draw(st.lists(VERDICTS, min_size=len(labels), max_size=len(labels)).filter(any))
            columns.append(Column((group, rule), tuple(map(Cell, cells)), draw(st.booleans()), (group,)))
    return labels, columns


def words(texts: Sequence[str]) -> Counter[str]:
    return Counter(word.strip(",:;") for text in texts for word in text.split())


@given(tables(), st.sampled_from(WIDTHS))
@example((["01-24"], [Column(("C", "p1"), (Cell("unavoidable"),))]), 40)
def test_no_word_of_a_table_is_cut_and_no_line_is_wider_than_the_terminal(
    table: tuple[list[str], list[Column]], width: int
) -> None:
    labels, columns = table
    found = blocks("class", labels, columns, width)
    assert [i for block in found for i in block.columns] == list(range(len(columns))), "each once, in their order"
    for block in found:
        lines = [line.plain for line in block.lines]
        assert max(map(cell_len, lines)) <= width
        cells = [cell.text for i in block.columns for cell in columns[i].cells]
        wanted = words(labels) + words([columns[i].heads[-1] for i in block.columns]) + words(cells)
        assert not wanted - words(lines), "of every block all names of rows"


@given(st.text("ab ", max_size=60), st.integers(4, 20), st.integers(0, 2))
def test_wrapping_keeps_all_letters_and_breaks_words_only_where_they_are_longer_than_a_line(
    text: str, width: int, indent: int
) -> None:
    lines = wrapped(text, width, indent)
    assert max(map(len, lines)) <= width
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
    if all(len(word) <= width - indent for word in text.split()):
        assert " ".join(lines).split() == text.split()


def test_a_number_stays_with_its_unit() -> None:
    text = "stop4: waiting 7.64 s (a2), braking 3.66 m/s^2, 97 NA"
    for width in range(12, 60):
        broken = " ".join(f"<{line.strip()}>" for line in wrapped(text, width))
        assert all(value in broken for value in ("7.64 s", "3.66 m/s^2", "97 NA")), broken
    assert wrapped("at 5 stop4", 5) == ["at 5", "stop4"], "a unit is a whole word"


def test_a_table_reads_as_it_is_drawn() -> None:
    columns = [
        Column(("C", "full_stop"), (Cell("pass"), Cell("1/2 unavoidable, 1/2 xfail I3")), group="C"),
        Column(("C", "p1"), (Cell("FAIL"), Cell("NA")), group="C"),
        Column(("E", "p1"), (Cell("NA"), Cell()), group="E"),
    ]

    def drawn(width: int) -> list[str]:
        return [line.plain for block in blocks("class", ["01, 03, 07-24", "02"], columns, width) for line in block.lines]

    assert drawn(60) == [
        "                 C                             E",
        " class           full_stop              p1     p1",
        "-------------------------------------------------",
        " 01, 03, 07-24   pass                   FAIL   NA",
        " 02              1/2 unavoidable, 1/2   NA",
        "                 xfail I3",
    ]
    assert drawn(30) == [
        "          C",
        " class    full_stop",
        "------------------------------",
        " 01, 03,  pass",
        "   07-24",
        " 02       1/2 unavoidable, 1/2",
        "          xfail I3",
        "          C     E",
        " class    p1    p1",
        "------------------",
        " 01, 03,  FAIL  NA",
        "   07-24",
        " 02       NA",
    ]


def record(number: int, rule: str, status: str, test: str = "test", **more: object) -> Record:
    keys = {
        "junction": "stop4",
        "cls": number,
        "scenario": "1111",
        "cfg": "C",
        "rotation": 0,
        "rule": rule,
        "driver": "mine.Pilot",
    }
    start = planned_record(f"t.py::{test}[class{number:02d}-{rule}]", 3, test, keys, 4)
    verdict = replace(Verdict(rule, Status(status), "", violated=f"{rule} was broken", time=1.0), **more)
    over = conclude(start, [verdict], "call", "failed" if status in ("FAIL", "OPEN") else "passed")
    return replace(over, run=f"class{number:02d}", hash=f"{test} {number}")


def told(report: Report, width: int = 80, *, full: bool = False, head: bool = False) -> Summary:
    return summarise(report, colour=False, width=width, unicode=False, full=full, more="ask for more", head=head)


@pytest.mark.parametrize("width", WIDTHS)
def test_all_tables_together_keep_to_a_screen(width: int) -> None:
    """Twelve tests, each with twenty rows that differ and twelve rules: many blocks where it is narrow."""
    records = [
        record(cls, f"a_rule_called_{bit:02d}", "PASS" if (cls * 37) >> (bit % 6) & 1 else "NA", f"test_{test:02d}")
        for test in range(12)
        for cls in range(1, 21)
        for bit in range(12)
    ]
    text = told(Report(tuple(records)), width).verdicts
    assert len([line for line in text.splitlines() if re.match(" |-|stop4   ", line)]) < 60
    assert len(text.splitlines()) < 70
    assert re.search(r"^\.\.\. and \d+ more tables: ask for more$", text, re.MULTILINE)
    whole = told(Report(tuple(records)), width, full=True).verdicts
    assert {f"test_{n:02d}" for n in range(12)} <= {*re.findall(r"test_\d\d", whole)}


def test_labels_of_any_length_are_whole_in_every_block() -> None:
    """Rows may say which variant of a controller they are about."""
    columns = [Column(("C", f"a_rule_called_{n}"), (Cell("unavoidable"), Cell("NA"))) for n in range(6)]
    labels = ["a_version_of_a_controller   01-24", "another_version   01, 03, 05, 07, 09, 11, 13, 15, 17, 19 and 3 more"]
    for block in blocks("variant, class", labels, columns, 60):
        said = [line.plain for line in block.lines]
        assert not words(labels) - words(said)


def test_causes_come_last_with_their_first_items() -> None:
    report = Report((record(1, "p1", "FAIL"), record(2, "p1", "FAIL"), record(3, "p2", "OPEN"), record(4, "p2", "PASS")))
    found = told(report)
    assert ("x p1" in found.verdicts, "coverage: " in found.verdicts) == (False, True)
    assert found.causes.startswith("causes of failures\n     2 x p1: p1 was broken, in 2 runs\n")
    whole = summary(report, colour=False, width=80, unicode=False)
    assert whole.endswith(found.causes)


def test_provoked_and_unavoidable_causes_have_a_command() -> None:
    records = record(1, "p1", "FAIL", provoked=True), record(2, "p1", "FAIL", unavoidable=True)
    text = told(Report(records, again="pytest --rvads-map=a.xodr"), 40).causes
    assert [line for line in text.splitlines() if "first: " in line] == [
        '         first: pytest --rvads-map=a.xodr "t.py::test[class01-p1]"',
        '         first: pytest --rvads-map=a.xodr "t.py::test[class02-p1]"',
    ], "in one line, which terminals break and shells take"


def test_what_is_new_since_the_baseline_has_a_command_to_paste() -> None:
    changes = tuple(Change("NEW", f"t.py::test[{n}]", "p1 at t=1.00 s") for n in range(12))
    text = told(Report((record(1, "p1", "FAIL"),), comparison=Comparison("main.json", changes))).verdicts
    lines = text.splitlines()
    start = lines.index("  NEW     ... and 2 more")
    assert lines[start + 1] == '          first: pytest "t.py::test[0]"'


def test_the_head_tells_what_drove_and_totals_once() -> None:
    one = Report((record(1, "p1", "PASS"),), began="2026-01-01T12:00:00+00:00", command="pytest -q", exitstatus=1)
    assert told(one).verdicts.splitlines()[0] == "driven by mine.Pilot: 1 run", "the line of the junction has the totals"
    assert told(one).verdicts.count("1 verdict: 1 pass") == 1
    two = Report((record(1, "p1", "PASS"), replace(record(2, "p1", "FAIL"), junction="stop3")))
    assert told(two).verdicts.splitlines()[:2] == ["2 verdicts on 2 runs: 1 pass, 1 fail", "driven by mine.Pilot: 2 runs"]
    whole = told(one, head=True).verdicts.splitlines()[:4]
    assert whole == ["began 2026-01-01T12:00:00+00:00", "command: pytest -q", "1 verdict on 1 run: 1 pass", "exit status 1"]


def test_legend_explains_words_of_tables_once() -> None:
    text = told(Report((record(1, "p1", "PASS"),))).verdicts
    assert "did not apply" not in text
    text = told(Report((record(1, "p1", "PASS"), record(2, "p1", "NA"), record(3, "p1", "NA", "other")))).verdicts
    assert text.count("NA: the rule did not apply") == 1
    known = replace(record(4, "p1", "FAIL"), known="I3: order of creation", outcome="skipped")
    text = told(Report((known,))).verdicts
    assert "xfail: a failure that the tests expect" in text
    assert "known failures\n     1 x p1: I3: order of creation\n" in text, "what the short name in the table stands for"
    assert "first: " not in text, "nobody has to look into it"


@pytest.mark.parametrize("width", WIDTHS)
def test_figures_are_broken_at_spaces(width: int) -> None:
    report = Report((record(1, "p1", "NA", title="no two vehicles in the junction"), record(2, "p1", "PASS")), {4: (24, 81)})
    text = told(report, width).verdicts
    assert all(len(line) <= width for line in text.splitlines())
    said = " ".join(text.split())
    assert "stop4: 2/24 classes, 1/81 scenarios, 2 runs, 2 verdicts: 1 pass, 1 NA" in said
    assert "rules: p1 (no two vehicles in the junction)" in said


def test_a_cause_names_the_rule_in_words() -> None:
    stop = record(1, "p2", "FAIL", title="right-of-way"), record(2, "p1", "FAIL", title="")
    assert "1 x p2 (right-of-way): p2 was broken" in told(Report(stop)).causes
    same = record(1, "full_stop", "FAIL", title="full stop")
    assert "1 x full_stop: full_stop was broken" in told(Report((same,))).causes, "not twice"
    owed = record(1, "arrives", "OPEN", title="everybody gets in", violated="open: everybody gets in")
    assert "1 x arrives (everybody gets in): still owed at the end of the run: everybody" in told(Report((owed,)), 200).causes


def test_counts_of_one_are_singular() -> None:
    text = summary(Report((record(1, "p1", "FAIL"),), {4: (24, 81)}), colour=False, width=80, unicode=False, full=True)
    assert not re.findall(r"\b1 (?:\w+ )?(?:runs|verdicts|items|classes|junctions|failures|tables|rows|columns)\b", text)

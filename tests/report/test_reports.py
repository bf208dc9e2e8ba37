"""Matrices, causes and files, from records written by hand."""

import csv
import io
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from markdown_it import MarkdownIt
from msgspec.structs import replace

from pytest_rvads.cli.report_commands import merge
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.logic.rules.book import rulebook
from pytest_rvads.report import triage
from pytest_rvads.report.counting import counts_of
from pytest_rvads.report.figures import figures
from pytest_rvads.report.files import load, markdown, save, table
from pytest_rvads.report.matrix import Matrices, Matrix
from pytest_rvads.report.record import Record, conclude, planned_record, properties
from pytest_rvads.report.rollup import junction_lines
from pytest_rvads.report.session_report import Comparison, Report, cell_of, exit_status, steady
from pytest_rvads.report.terminal import summary
from pytest_rvads.report.triage import Cause
from pytest_rvads.runs.measured import Kpis
from pytest_rvads.satellites.pages.page import page
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import printable

TOTALS = {4: (24, 81)}


def filled(tally: Any, records: Iterable[Record]) -> Any:
    """Let a tally take records in."""
    for one in records:
        tally.add(one)
    return tally


def matrices(records: Iterable[Record]) -> list[Matrix]:
    return list(filled(Matrices(), records).matrices())


def causes(records: Iterable[Record]) -> list[Cause]:
    return list(filled(triage.causes(), records).causes())


def at_junctions(records: Iterable[Record], totals: dict[int, tuple[int, int]]) -> list[str]:
    counts = counts_of(Report(tuple(records), totals))
    return [next(junction_lines(counts, site)) for site in counts.first]


def extremes(records: Iterable[Record]) -> list[str]:
    return [line for line in figures(counts_of(Report(tuple(records))), short=False) if line.startswith(("nearest: ", "most: "))]


def record(
    cls: int, cfg: str, rule: str, status: str, *, known: str | None = None, scenario: str = "1111", cause: str = "both in"
) -> Record:
    keys = {
        "junction": "stop4",
        "cls": cls,
        "scenario": scenario,
        "cfg": cfg,
        "rotation": 0,
        "rule": rule,
        "driver": "mine.Pilot",
        "simulator": "mine",
    }
    made = planned_record(f"t.py::test[{cls}-{scenario}-{cfg}-{rule}]", 3, "test", keys, 4)
    outcome = "skipped" if status == "NA" or known else "passed" if status == "PASS" else "failed"
    unavoidable = status == "UNAVOIDABLE"
    verdicts = [Verdict("", Status.FAIL if unavoidable else Status(status), "", violated=cause, unavoidable=unavoidable)]
    made = replace(made, hash=f"{cls} {scenario} {cfg}")
    return conclude(made, verdicts, "call", outcome, known=known, text=f"{rule} at t=1.00 s")


RECORDS = [
    record(1, "C", "p1", "PASS"),
    record(1, "C", "p2", "NA"),
    record(2, "C", "p1", "FAIL", scenario="1112"),
    record(2, "C", "p1", "PASS", scenario="2111"),
    record(2, "C", "p2", "FAIL", known="I3: order of creation"),
    record(3, "C", "p1", "PASS"),
    record(3, "C", "p2", "NA"),
    record(4, "C", "p1", "OPEN", cause="waits"),
    record(4, "C", "p2", "FAIL", cause="waits"),
]
PLANNED = tuple(dict.fromkeys(map(cell_of, RECORDS)))
REPORT = Report(tuple(RECORDS), TOTALS, PLANNED, {"numpy": "2.0"}, 1, ("a note",))


def texts(matrix: Matrix) -> tuple[Any, ...]:
    return tuple((label, tuple(entry.text for entry in entries)) for label, entries in matrix.rows)


@pytest.mark.extended
def test_huge_matrix_becomes_sums() -> None:
    """Six thousand classes, each with a configuration of its own, would be 36 million entries."""
    records = tuple(record(number, f"c{number}", "p1", "PASS") for number in range(6000))
    (matrix,) = matrices(records)
    assert matrix.title.endswith("6,000 classes in 6,000 columns are too many for a table")
    assert texts(matrix) == ()
    report = Report(records, TOTALS)
    for form in (markdown(report), page(report, Path()), summary(report, colour=False, width=80, unicode=True)):
        assert "erdicts in sums" in form


def test_the_matrix_reads_like_a_table_of_the_paper() -> None:
    (matrix,) = matrices(RECORDS)
    assert matrix.columns == (("C", "p1"), ("C", "p2"))
    assert texts(matrix) == (("01, 03", ("pass", "NA")), ("02", ("1/2 fail", "xfail I3")), ("04", ("OPEN", "FAIL")))


@pytest.mark.parametrize("status", ["ERROR", "FLAKY", "FAIL", "NOT JUDGED", "OPEN"])
def test_a_cell_says_what_went_wrong_in_a_part_of_its_rows(status: str) -> None:
    rows = [
        record(1, "C", "p1", "PASS"),
        record(1, "C", "p1", "NA"),
        replace(record(1, "C", "p1", "FAIL"), status=Outcome(status)),
    ]
    assert texts(matrices(rows)[0]) == (("01", (f"1/3 {status.lower()}",)),)
    assert texts(matrices(rows[:2])[0]) == (("01", ("1/2 pass, 1/2 NA",)),)


def test_causes_group_unexpected_failures() -> None:
    """In the run of class 4, the violation of p2 comes before the obligation of p1, which is open at the end."""
    assert [(c.rule, c.text, c.count) for c in causes(RECORDS)] == [("p2, p1", "waits", 2), ("p1", "both in", 1)]
    many = [*RECORDS, record(5, "C", "p2", "FAIL", cause="waits")]
    assert causes(many)[0].count == 3, "the most frequent cause comes first"


def test_coverage_counts_what_was_exercised() -> None:
    (line,) = at_junctions(RECORDS, TOTALS)
    assert line.startswith("stop4: 4/24 classes, 3/81 scenarios, ")
    assert line.endswith("9 verdicts: 3 pass, 2 fail, 1 open, 1 known failure, 2 NA")
    (idle,) = at_junctions(RECORDS[:2], TOTALS)
    assert idle.endswith("(never applicable: p2)")


def test_an_item_that_never_ran_is_an_error_or_not_run() -> None:
    keys = {"junction": "stop4", "cls": 1, "scenario": "1111", "cfg": "C", "rotation": 0}
    broken, skipped = planned_record("a", 1, "t", keys, 4), planned_record("b", 2, "t", keys, 4)
    broken = conclude(broken, (), "setup", "failed", text="autopilot raised")
    skipped = conclude(skipped, (), "setup", "skipped")
    assert (broken.status, skipped.status) == ("ERROR", "NOT RUN")
    assert [(c.rule, c.text) for c in causes([broken, skipped])] == [("run", "autopilot raised")]


def test_several_verdicts_count_by_the_worst() -> None:
    made = record(1, "C", "p1", "PASS")
    four, two = ([Verdict("", Status(s), "") for s in given] for given in (("PASS", "NA", "FAIL", "OPEN"), ("NA", "PASS")))
    assert conclude(made, four, "call", "failed").status == "FAIL"
    assert conclude(made, two, "call", "passed").status == "PASS"


def test_nothing_but_a_judged_pass_is_a_pass() -> None:
    def status(verdicts: list[str], outcome: str, **more: Any) -> str:
        made = record(1, "C", "p1", "PASS")
        return conclude(made, [Verdict("", Status(s), "") for s in verdicts], "call", outcome, **more).status.value

    assert status([], "failed", error=Outcome.NOT_JUDGED) == "NOT JUDGED"
    assert status([], "passed") == "PASS", "a test of a run by its own assertions"
    assert status([], "skipped") == "NOT RUN"
    assert status(["PASS"], "failed") == "FAIL", "an assertion after the verdict failed, or a known failure passed"
    assert status([], "failed", error=Outcome.ERROR) == "ERROR"
    assert status(["NA"], "failed", error=Outcome.ERROR) == "ERROR"
    assert status(["UNSURE"], "skipped") == "UNSURE"
    assert status(["UNSURE"], "passed") == "UNSURE", "whatever the test makes of it"
    assert status(["UNSURE"], "failed", error=Outcome.UNSURE) == "UNSURE"
    assert status(["UNSURE"], "failed") == "FAIL", "an assertion of the test"


def test_a_known_failure_does_not_hide_an_unexpected_one() -> None:
    mixed = [
        record(9, "C", "p2", "FAIL", scenario="1213", known="I3"),
        record(9, "C", "p2", "FAIL", scenario="3121"),
        record(9, "C", "p2", "PASS", scenario="1312"),
    ]
    assert texts(matrices(mixed)[0])[0][1] == ("1/3 fail, 1/3 xfail I3",)
    assert sum(c.count for c in causes(mixed)) == 1


def test_properties_are_builtins() -> None:
    assert dict(properties(RECORDS[2])) == {
        "junction": "stop4",
        "class": 2,
        "scenario": "1112",
        "configuration": "C",
        "rotation": 0,
        "rule": "p1",
        "verdict": "FAIL",
        "driver": "mine.Pilot",
        "simulator": "mine",
    }


def recorded(name: str, rule: str, status: str) -> Record:
    """The record of a run that nobody simulated."""
    keys = {"junction": "stop4", "recording": name, "rule": rule}
    return replace(planned_record(f"t.py::test[{name}-{rule}]", 3, "test", keys, 4), status=Outcome(status), outcome="passed")


def test_properties_of_a_recording_name_no_scenario() -> None:
    told = {"junction": "stop4", "recording": "drive17-t0312.4", "rule": "p1", "verdict": "PASS"}
    assert dict(properties(recorded("drive17-t0312.4", "p1", "PASS"))) == told


def test_recordings_with_the_same_verdicts_are_a_row() -> None:
    names = [f"d{number}" for number in range(6)]
    records = [recorded(name, "p1", "FAIL" if name == "d3" else "PASS") for name in names]
    (matrix,) = matrices(records)
    assert (matrix.title, matrix.corner, matrix.headings) == ("stop4 as recorded   t.py::test", "recording", ["p1"])
    assert texts(matrix) == (("d0, d1, d2 and 2 more", ("pass",)), ("d3", ("FAIL",)))
    assert matrix.members == (("d0", "d1", "d2", "d4", "d5"), ("d3",)), "what a page lists by a click"
    assert matrix.shortened(1).members == (("d3",),), "what went wrong first"


def test_unsure_causes_name_their_reasons() -> None:
    def unsure(name: str, *hangs: str, reason: str = "") -> Record:
        instances = tuple(InstanceVerdict((("a", f"v{n}"),), Status.UNSURE, hangs=text) for n, text in enumerate(hangs))
        verdict = Verdict("", Status.UNSURE, "", instances=instances, reason=reason)
        return conclude(recorded(name, "p3", "NOT RUN"), [verdict], "call", "skipped", text="p3 UNSURE")

    one, two = unsure("d0", "0.02 s", "0.03 s", reason="first come"), unsure("d1", reason="who came first")
    many, silent = unsure("d2", *"12345"), unsure("d3")
    told = ["a=v0: 0.02 s; a=v1: 0.03 s", "who came first", "a=v0: 1; a=v1: 2; a=v2: 3 and 2 more", "p3 UNSURE"]
    assert [cause.text for cause in filled(triage.unsure(), [one, two, many, silent]).causes()] == told
    assert filled(triage.idle(), [one]).causes() == [], "told once"
    failed = replace(one, outcome="failed")
    assert (filled(triage.unsure(), [failed]).causes(), [cause.text for cause in causes([failed])]) == ([], told[:1])


def test_a_report_is_read_back(tmp_path: Path) -> None:
    save(tmp_path / "out" / "r.json", REPORT)
    assert load(tmp_path / "out" / "r.json") == REPORT
    save(tmp_path / "r.md", REPORT)
    assert (tmp_path / "r.md").read_text(encoding="utf-8") == markdown(REPORT)


OLDER, OTHER = ({"format": name, "version": n, "records": []} for name, n in (("rvads-report", 4), ("other-report", 5)))


@pytest.mark.parametrize("content", ["", "[]", "{}", json.dumps(OLDER), json.dumps(OTHER)])
def test_other_files_are_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "r.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(RvadsError, match=r"r\.json (is not a report of version 5|can't be read)"):
        load(path)


def test_unknown_endings_and_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RvadsError, match=r"\.json, .*\.md"):
        save(tmp_path / "r.txt", REPORT)
    with pytest.raises(RvadsError, match="can't be read"):
        load(tmp_path / "none.json")


def test_markdown_keeps_its_tables_whole() -> None:
    text = markdown(Report((record(1, "C", "p1", "FAIL", cause="a | b\nc"),), TOTALS))
    assert "a \\| b c" in text
    lines = text.splitlines()
    heads = [k for k, line in enumerate(lines) if line.startswith("| class |")]
    assert [lines[k + 1] for k in heads] == ["|---|---|"], "a column of classes and one of a rule"


HOSTILE = {
    "": "",
    "plain text: p1 -> a@j & b, 3 < 4 (a_b in test[run])": "plain text: p1 -> a@j & b, 3 < 4 (a_b in test[run])",
    "<script>alert(1)</script>": "&lt;script>alert(1)&lt;/script>",
    "[x](javascript:alert(1))": "[x\\](javascript\\:alert(1))",
    "![x](http://x.org)": "![x\\](http\\://x.org)",
    "see www.x.org or https://x.org": "see www\\.x.org or https://x.org",
    "`code` *bold* _slant_ ~~gone~~ $x$": "\\`code\\` \\*bold\\* \\_slant\\_ \\~\\~gone\\~\\~ \\$x\\$",
    "a\\|b\nc": "a\\\\\\|b c",
    "&lt; &#60;": "&amp;lt; &amp;#60;",
    "ask @everybody": "ask @\u2060everybody",
    "\x1b[2J\u202e": "\\\\x1b[2J\\\\u202e",
}


@pytest.mark.parametrize("text", HOSTILE)
def test_markdown_escapes_texts(text: str) -> None:
    (line,) = (line for line in markdown(Report((), versions={text: "1"})).splitlines() if line.startswith("- versions: "))
    assert line == f"- versions: {HOSTILE[text]} 1"
    (rendered,) = (token for token in MarkdownIt().parse(line) if token.type == "inline")
    read = "".join(child.content for child in rendered.children)
    assert read.replace("\u2060", "") == f"versions: {printable(text)} 1".replace("\n", " ")


def test_a_line_that_would_begin_a_block_does_not() -> None:
    text = markdown(
        Report((), {}, left_out={}, notes=("one",), comparison=Comparison("x", (), ("# head", "[x]: y", "- item", "> q")))
    )
    assert [line for line in text.splitlines() if line[:3] in ("- #", "- [", "- -", "- >")] == []


def test_code_spans_are_quoted() -> None:
    def examples(nodeid: str) -> list[str]:
        one = replace(record(1, "C", "p1", "FAIL"), nodeid=nodeid)
        rows = (row.split(" | ") for row in markdown(Report((one,), TOTALS)).splitlines() if row.startswith("| 1 "))
        return [row[-1].removesuffix(" |") for row in rows]

    assert examples("t.py::test[a_b]") == ['`"t.py::test[a_b]"`']
    assert examples("t.py::`<b>") == ["'t.py::\\`&lt;b>'"]


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        *(
            (text, f"'{text}")
            for text in ("=1+1", "+x", "-x", "@x", "=cmd|' /C calc'!A0", "  =1", "'=1", '"=1', "\t1", "＝1", "-1-1")
        ),
        ("\r=1", "'\\r=1"),
        *((text, text) for text in ("-1", "+2.5", "-1e-3", "a=b", "", "x\ny", "1133")),
    ],
)
def test_no_cell_is_a_formula(text: str, cell: str) -> None:
    one = replace(record(1, "C", "p1", "PASS"), message=text, requirements=(text,), simulator=text, scenario=text)
    rows = list(csv.DictReader(io.StringIO("".join(table(Report((one,), TOTALS))), newline="")))
    assert {rows[0][column] for column in ("requirement", "message", "simulator", "scenario")} == {cell}
    assert rows[0]["class"] == "1"


@pytest.mark.parametrize(
    ("look", "link"),
    [
        (".rvads/a b.html#t=1.00", "a b.html#t=1.00"),
        ("other/a.html", "../other/a.html"),
        ("https://ci.example.org/1/a.html#t=1", "https://ci.example.org/1/a.html#t=1"),
        *((look, "") for look in ("", "http://x.org/a", "javascript:alert(1)", " javascript:alert(1)", "JAVASCRIPT&colon;:x")),
        *((look, "") for look in ("x/../.rvads/javascript:alert(1)", "a/../.rvads/data:x", "java\tscript:alert(1)")),
        *(
            (look, "")
            for look in ("//x.org/a", " //x.org", "\\\\x.org\\a", "/\\x.org", "a\nb", "https://x.org/\x00", "C:/a.html")
        ),
    ],
)
def test_pages_link_to_relative_paths_and_https_only(look: str, link: str) -> None:
    one = replace(record(1, "C", "p1", "FAIL"), look=look)
    (data,) = re.findall('id="data">(.*)</script>', page(Report((one,), TOTALS), Path(".rvads")))
    assert json.loads(data)["items"][0]["look"] == link


def test_names_are_no_commands_of_the_terminal_or_of_its_library() -> None:
    hostile = "[/] [red]x\x1b[31m\u202e\ny"
    one = replace(record(1, hostile, hostile, "FAIL"), junction=hostile, driver=hostile, known=hostile)
    text = summary(Report((one,), TOTALS, versions={hostile: hostile}), colour=False, width=300, unicode=False, full=True)
    assert text.count(r"[/] [red]x\x1b[31m\u202e y") > 4
    assert set(text) & set("\x1b\u202e") == set()


def measured(cls: int, **vehicle: float | None) -> Record:
    made = record(cls, "C", "p1", "PASS")
    one = {"agent": "a0", "waiting": 1.0, "delay": None, "deceleration": 2.0, "jerk": 3.0}
    pair = {"agents": ["a0", "a1"], "ttc": 2.5 - cls, "pet": None}
    vehicles = [one, {**one, "agent": "a1", **vehicle}]
    return replace(made, run=f"run{cls}", kpis=msgspec.convert({"vehicles": vehicles, "pairs": [pair]}, Kpis))


@pytest.mark.parametrize(
    ("rule", "status", "told"),
    [
        ("no_collision", "PASS", "discs around the bodies touch, the bodies do not"),
        ("no_collision", "FAIL", "no_collision is FAIL"),
        ("p1", "PASS", "discs around the bodies touch"),
    ],
)
def test_time_to_collision_of_zero_says_whether_bodies_touched(rule: str, status: str, told: str) -> None:
    kpis = msgspec.convert({"vehicles": [], "pairs": [{"agents": ["a0", "a1"], "ttc": 0.0, "pet": None}]}, Kpis)
    one = replace(record(1, "C", rule, status), run="run1", kpis=kpis)
    assert extremes([one]) == [f"nearest: time to collision 0.00 s (a0 and a1 in test[run1]: {told})"]


def test_extremes_name_value_vehicle_and_run() -> None:
    runs = [measured(1, waiting=7.0), measured(2, deceleration=4.0, waiting=7.0)]
    assert extremes(runs) == [
        "nearest: time to collision 0.50 s (a0 and a1 in test[run2])",
        "most: braking 4.00 m/s^2 (a1 in test[run2]), waiting 7.00 s (a1 in test[run1])",
    ]
    assert extremes(RECORDS) == [], "records of items whose run never came to be have none"
    text = summary(Report(tuple(runs), TOTALS), colour=False, width=120, unicode=False)
    assert all(line in text for line in extremes(runs))
    assert all(f"- {line}\n" in markdown(Report(tuple(runs), TOTALS)) for line in extremes(runs))


@pytest.mark.parametrize("width", [30, 60, 80, 100])
def test_every_rule_and_verdict_can_be_read_in_narrow_terminals_too(width: int) -> None:
    """The rulebook of the road, at classes that do not fit into one line."""
    rules = [rule.name for rule in rulebook("road")]
    classes = range(1, 41, 2)
    made = [record(cls, cfg, rule, "UNAVOIDABLE") for cls in classes for cfg in "CE" for rule in rules]
    text = summary(Report(tuple(made), TOTALS), colour=False, width=width, unicode=False, full=True)
    table = text[text.index("\nstop4   t.py") : text.index(" unavoidable: nobody")].splitlines()[2:]
    assert all(len(line) <= width for line in table)
    words = re.findall(r"[\w.]+", "\n".join(table))
    assert [words.count(rule) for rule in rules] == [2] * len(rules)
    assert words.count("unavoidable") == 2 * len(rules)
    assert {f"{cls:02d}" for cls in classes} <= set(words)


def test_the_terminal_summary_is_plain_where_the_terminal_is() -> None:
    text = summary(REPORT, colour=False, width=100, unicode=False)
    assert "\x1b" not in text
    assert text.isascii()
    assert "1/2 fail" in text
    coloured = summary(REPORT, colour=True, width=100, unicode=True)
    for style, word in (("32", "pass"), ("1;31", "FAIL"), ("33", "OPEN"), ("2", "NA")):
        assert f"\x1b[{style}m{word}" in coloured


def long_session(rows: int) -> Report:
    """Every class with other verdicts, so that none fold into one row; the last class fails."""
    records = []
    for cls in range(1, rows + 1):
        for bit in range(8):
            passes = (cls >> bit) & 1 and cls < rows
            made = record(cls, f"d{bit:05.2f}v00.00", "p1", "PASS" if passes else "FAIL" if cls == rows else "NA")
            nodeid = f"t.py::test[stop5-class{cls:03d}-as11111-cfg{bit}-p1]"
            records.append(replace(made, nodeid=nodeid, message=f"number {'x' * cls}"))
    return Report(tuple(records), {4: (208, 1024)})


def test_a_long_table_is_cut_but_for_its_failures() -> None:
    report = long_session(60)
    text = summary(report, colour=False, width=200, unicode=False)
    assert " ... and 40 more rows: reports in files hold all" in text
    rows = [line.split()[0] for line in text.splitlines() if line[1:4].isdigit()]
    assert len(rows) == 20
    assert rows[-1] == "060", "the row that fails is shown, and numbers are as wide as in ids"
    whole = summary(report, colour=False, width=200, unicode=False, full=True)
    assert len([line for line in whole.splitlines() if line[1:4].isdigit()]) == 60
    assert "more rows" not in whole


def test_a_long_list_of_causes_is_cut() -> None:
    report = Report(tuple(record(n, "C", "p1", "FAIL", cause=f"cause {'x' * n}") for n in range(1, 15)), {4: (24, 81)})
    text, whole = (summary(report, colour=False, width=200, unicode=False, full=full) for full in (False, True))
    assert (text.count("1 x p1: cause"), whole.count("1 x p1: cause")) == (10, 14)


def test_a_long_label_of_a_configuration_has_a_number() -> None:
    label = "d20.00_20.00_20.00_20.00v08.00_08.00_08.00_08.00"
    text = summary(Report((record(1, label, "p1", "PASS"),), {4: (24, 81)}), colour=False, width=200, unicode=False)
    assert text.count(label) == 1
    assert " #1 " in text
    assert f" #1 = {label}" in text


def test_every_status_has_a_word() -> None:
    records = [replace(record(n, "C", "p1", "FAIL"), status=outcome) for n, outcome in enumerate(Outcome, start=1)]
    (line,) = at_junctions(records, {4: (24, 81)})
    words = (
        "1 pass, 1 fail, 1 open, 1 unavoidable, 1 provoked by traffic, 1 unsure, 1 NA, 1 error, 1 flaky, 1 not judged, 1 not run"
    )
    assert f"{len(Outcome)} verdicts: {words}" in line


@pytest.mark.parametrize(
    ("outcomes", "whole", "status"),
    [
        ({Outcome.PASS, Outcome.NA}, True, 0),
        ({Outcome.PASS, Outcome.PROVOKED, Outcome.UNSURE}, True, 0),
        ({Outcome.PASS, Outcome.OPEN}, True, 1),
        ({Outcome.ERROR}, True, 1),
        ({Outcome.NA, Outcome.UNSURE, Outcome.UNAVOIDABLE, Outcome.PROVOKED}, True, 5),
        (set(), True, 5),
        ({Outcome.PASS}, False, 2),
        ({Outcome.FAIL}, False, 2),
    ],
)
def test_the_exit_status_is_that_of_an_unfinished_then_a_failed_then_an_idle_session(
    outcomes: set[Outcome], whole: bool, status: int
) -> None:
    assert exit_status(outcomes, complete=whole) == status


def test_slow_runs_are_told_where_they_matter() -> None:
    quick = Report(tuple(RECORDS), TOTALS, seconds={"test[one]": 0.2, "test[two]": 0.3})
    slow = Report(tuple(RECORDS), TOTALS, seconds={f"test[{n}]": float(n) for n in range(12)})
    assert "slowest" not in summary(quick, colour=False, width=100, unicode=False)
    assert "slowest: 11.0 s test[11], 10.0 s test[10], 9.0 s test[9]\n" in summary(slow, colour=False, width=100, unicode=False)
    assert "2.0 s test[2]\n" in summary(slow, colour=False, width=100, unicode=False, full=True)
    assert quick == slow, "how fast a machine is, is no difference between reports"


def test_rules_of_one_start_on_two_runs_are_flaky() -> None:
    start = [replace(record(1, "C", rule, "PASS"), run="start") for rule in ("p1", "p2", "p3")]
    other, error = replace(start[1], hash="another"), replace(start[2], hash="another", status=Outcome.ERROR, outcome="failed")
    assert [found.status for found in steady(start)] == ["PASS"] * 3
    among_others = replace(start[1], hash="another", traffic="hesitant")
    assert [found.status for found in steady([start[0], among_others])] == ["PASS"] * 2
    found = list(steady([start[0], other, error, replace(record(2, "C", "p1", "PASS"), run="next")]))
    assert [one.status for one in found] == ["FLAKY", "FLAKY", "ERROR", "PASS"]
    assert found[0].flaky is not None
    assert found[0].flaky.text == f"it was judged on another run than {other.nodeid}"
    assert [one.failed for one in found] == [True, True, True, False]


def test_rules_of_one_start_on_two_runs_in_two_shards_are_flaky() -> None:
    one, two = (replace(record(1, "C", rule, "PASS"), run="start", hash=rule) for rule in ("p1", "p2"))
    merged = merge([("a.json", Report((one,))), ("b.json", Report((two,)))])
    assert {found.status for found in merged.records} == {"FLAKY"}
    assert merged.exitstatus == 1


@pytest.mark.parametrize(
    ("edited", "says"),
    [
        ({"status": "NOT RUN"}, "is NOT RUN, failed, and has a verdict FAIL"),
        ({"status": "NOT RUN", "outcome": ""}, "is NOT RUN, never ran, and has a verdict FAIL"),
        ({"status": "NOT RUN", "verdicts": []}, "is NOT RUN, failed, and has no verdict"),
        ({"status": "PASS", "outcome": "passed"}, "is PASS, passed, and has a verdict FAIL"),
        ({"rule": "p2"}, "is about p2 and has a verdict of p1"),
    ],
)
def test_record_that_contradicts_itself_is_refused(tmp_path: Path, edited: dict[str, Any], says: str) -> None:
    failed = record(1, "C", "p1", "FAIL")
    path = tmp_path / "old.json"
    save(path, Report((replace(failed, verdicts=(replace(failed.verdicts[0], rule="p1"),)),)))
    content = json.loads(path.read_text(encoding="utf-8"))
    assert load(path).records
    content["records"][0] |= edited
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(RvadsError, match=re.escape(f"the record of {failed.nodeid} {says}")):
        load(path)


@pytest.mark.parametrize("error", [None, Outcome.ERROR, Outcome.NOT_JUDGED, Outcome.UNSURE])
@pytest.mark.parametrize("status", ["PASS", "FAIL", "OPEN", "NA", "UNSURE"])
@pytest.mark.parametrize("outcome", ["passed", "failed", "skipped"])
def test_no_record_that_a_session_writes_contradicts_itself(outcome: str, status: str, error: Outcome | None) -> None:
    start = planned_record("t", 3, "test", {"junction": "stop4", "rule": "p1"}, 4)
    verdicts = [Verdict("p1", Status(status), "", unavoidable=flag) for flag in (False, True)]
    for given in ([], verdicts[:1], verdicts):
        for when in ("setup", "call"):
            assert conclude(start, given, when, outcome, error=error).contradiction == ""


def test_unavoidable_violation_that_is_to_fail_stays_unavoidable() -> None:
    start = planned_record("t", 3, "test", {"junction": "stop4", "rule": "p2"}, 4)
    verdict = Verdict("p2", Status.FAIL, "", unavoidable=True)
    assert conclude(start, [verdict], "call", "failed").status is Outcome.UNAVOIDABLE

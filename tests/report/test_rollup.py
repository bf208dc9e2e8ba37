"""Many junctions: sums in place of tables, in every form, in one pass over the records."""

import csv
import io
import json
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report import matrix, triage
from pytest_rvads.report.counting import counts_of
from pytest_rvads.report.figures import cell_coverage
from pytest_rvads.report.files import FORMATS, load, markdown
from pytest_rvads.report.matrix import Matrix
from pytest_rvads.report.outline import Causes, Figures, Head, RollUp, outline
from pytest_rvads.report.record import Computing, Record, RecordedItem, conclude, planned_record
from pytest_rvads.report.session_report import Report
from pytest_rvads.report.terminal import summary
from pytest_rvads.satellites.pages.page import page
from pytest_rvads.support.wording import natural


def record(junction: str, run: int, rule: str, status: str, **more: Any) -> Record:
    """A verdict of a campaign on a run; junctions with an even number have lights."""
    number = int(re.sub(r"\D", "", junction) or 0)
    keys: dict[str, Any] = {"junction": junction, "cls": run, "scenario": f"11{run:02d}", "cfg": "C", "rotation": 0, "rule": rule}
    keys |= {"control": "stop" if number % 2 else "lights", "driver": "mine.Pilot", "simulator": "mine"}
    name = f"{junction}-class{run:02d}-as11{run:02d}-cfgC"
    start = planned_record(f"{name}-{rule}", 0, "", keys, 3 + number % 2, more.pop("requirements", ()))
    outcome = "skipped" if status == "NA" else "passed" if status == "PASS" else "failed"
    verdict = Verdict("", Status(status), "", violated="both in" if status == "FAIL" else "", time=1.0)
    over = conclude(start, [verdict], "call", outcome, text=f"{rule} {status}", **more)
    return replace(over, run=name, hash=f"{junction} {run}")


def town(junctions: int, runs: int = 2, *, wrong: Collection[tuple[int, int]] = ()) -> list[Record]:
    """Records of p1 and p2 at junctions 1 to n: p1 passes but in runs that are wrong, as (junction, run), p2 is about stops."""
    return [
        record(f"J{j}", run, rule, ("FAIL" if (j, run) in wrong else "PASS") if rule == "p1" else "PASS" if j % 2 else "NA")
        for j in range(1, junctions + 1)
        for run in range(1, runs + 1)
        for rule in ("p1", "p2")
    ]


def rolled_up(report: Report) -> RollUp:
    (block,) = (block for block in outline(report) if isinstance(block, RollUp))
    return block


def told(report: Report, width: int = 80, full: bool = False) -> str:
    return summary(report, colour=False, width=width, unicode=False, full=full, more="-vv shows them all")


def rows(text: str) -> list[str]:
    """The lines of a summary that stand in tables, and in what explains them."""
    found, title = [], ""
    for line in text[: text.index("causes of failures")].splitlines():
        title = title if line.startswith((" ", "-")) else line
        found += [line] if line != title and not re.search("verdicts on|status|driven|simulated|: |^not ", title) else []
    return found


def written(form: str, report: Report) -> str:
    return "".join(FORMATS[form](report, Path()))


@pytest.mark.parametrize(("junctions", "many"), [(4, False), (5, True)])
def test_of_more_than_four_junctions_sums_are_told_in_place_of_tables(junctions: int, many: bool) -> None:
    report = Report(tuple(town(junctions)))
    for short in (True, False):
        kinds = [type(block) for block in outline(report, short)]
        assert (RollUp in kinds, Matrix in kinds) == (many, not many)
    both = [type(block) for block in outline(report, tables=True)]
    assert (RollUp in both, both.count(Matrix)) == (many, junctions), "who asks for the tables gets them"
    assert "J3\n" in told(report, full=True)


def test_the_sums_add_up_per_kind_rule_and_junction() -> None:
    records = [*town(6, wrong=[(2, 1), (2, 2), (5, 1)]), record("J5", 3, "p1", "FAIL", known="I3: order")]
    kinds, rules, junctions = rolled_up(Report(tuple(records))).sums
    assert kinds.columns == ("kind", "junctions", "runs", "wrong", "pass", "fail", "known", "NA")
    assert [kinds.cells(row) for row in kinds.rows] == [
        ("3-way lights", "3", "6", "2", "4", "2", "", "6"),
        ("4-way stop", "3", "7", "1", "11", "1", "1", ""),
    ]
    assert rules.columns[:3] == ("rule", "junctions", "wrong at")
    assert [rules.cells(row) for row in rules.rows] == [
        ("p1", "6", "2", "9", "3", "1", ""),
        ("p2", "6", "0", "6", "", "", "6"),
    ]
    assert [junctions.cells(row)[:4] for row in junctions.rows] == [
        ("J2", "3-way lights", "2", "2"),
        ("J5", "4-way stop", "3", "1"),
        ("J1", "4-way stop", "2", "0"),
        ("J3", "4-way stop", "2", "0"),
        ("J4", "3-way lights", "2", "0"),
        ("J6", "3-way lights", "2", "0"),
    ]
    assert list(junctions.plain())[:2] == [
        "junction J2: kind 3-way lights, runs 2, wrong 2: 2 fail, 2 NA",
        "junction J5: kind 4-way stop, runs 3, wrong 1: 3 pass, 1 fail, 1 known failure",
    ]


def test_the_worst_is_where_the_largest_share_of_runs_went_wrong_then_most_then_the_first_by_number() -> None:
    few, many = [(10, 1), (9, 1)], [(11, run) for run in (1, 2)]
    records = [*town(12, 2, wrong=[*few, *many]), *(record("J12", run, "p1", "FAIL") for run in range(3, 7))]
    names = [row.name for row in rolled_up(Report(tuple(records))).sums[2].rows]
    assert names[:4] == ["J11", "J12", "J9", "J10"], "2 of 2, 4 of 6, 1 of 2 each"
    assert names[4:] == [f"J{n}" for n in range(1, 9)]


@pytest.mark.extended
def test_a_summary_of_three_hundred_junctions_fits_a_screen_or_two_and_keeps_its_names() -> None:
    report = Report(tuple(town(300, 5, wrong=[(n, 1) for n in range(1, 300, 7)])))
    text = told(report)
    assert len(text.splitlines()) < 60
    table = rows(text)
    assert max(map(len, table)) <= 80
    names = re.findall(r"^ (J\d+) ", "\n".join(table), re.MULTILINE)
    assert names == [f"J{n}" for n in range(1, 140, 7)], "each with one of five"
    assert " ... and 280 more junctions: -vv shows them all" in text
    assert "... and 296 more junctions, with no worse verdicts" in text
    whole = told(report, full=True)
    assert set(re.findall(r"^ (J\d+) ", whole, re.MULTILINE)) == {f"J{n}" for n in range(1, 301)}


@pytest.mark.parametrize("width", [30, 50, 80])
def test_sums_are_as_narrow_as_the_terminal(width: int) -> None:
    long = [replace(one, junction=f"a_town_with_a_long_name.{one.junction}") for one in town(6, wrong=[(2, 1)])]
    table = rows(told(Report(tuple(long)), width, full=True))
    assert max(map(len, table)) <= width
    assert {f"a_town_with_a_long_name.J{n}" for n in range(1, 7)} <= {*" ".join(table).split()}, "never cut"


def test_causes_say_at_how_many_junctions_where_sums_stand_for_tables() -> None:
    wrong = [(1, 1), (1, 2), (2, 1)]
    for junctions, line in ((4, "both in, in 3 runs"), (5, "both in, in 3 runs at 2 junctions")):
        blocks = outline(Report(tuple(town(junctions, wrong=wrong))), short=True)
        assert [block.causes[0].line for block in blocks if isinstance(block, Causes)] == [line]


def test_roll_up_lists_the_worst_junctions() -> None:
    figures = outline(Report(tuple(town(9, wrong=[(7, 1), (3, 2)]))))[-1]
    assert isinstance(figures, Figures)
    lines = [line.partition(":")[0] for line in figures.lines if re.match(r"J\d|\.\.\.", line)]
    assert lines == ["J3", "J7", "J1", "J2", "... and 5 more junctions, with no worse verdicts"]


def test_of_few_junctions_no_line_is_left_out_where_runs_were_recorded_there_too() -> None:
    records = town(4, 1)
    names = [name for name in RecordedItem.__struct_fields__ if name not in ("recording", "nodeid")]
    there = [
        RecordedItem(recording="mon", nodeid=f"{one.nodeid}-mon", **{name: getattr(one, name) for name in names})
        for one in records
    ]
    figures = outline(Report((*records, *there)))[-1]
    assert isinstance(figures, Figures)
    assert sum(bool(re.match(r"J\d", line)) for line in figures.lines) == 8


def test_failed_run_of_several_rules_counts_once() -> None:
    broken = [
        replace(record("J9", 1, rule, "FAIL"), hash=None, status=Outcome.ERROR, message="ValueError: no gap")
        for rule in ("p1", "p2")
    ]
    blocks = outline(Report((*town(5), *broken)), short=True)
    (row,) = (row for block in blocks if isinstance(block, RollUp) for row in block.sums[2].rows if row.name == "J9")
    assert row.texts == ("4-way stop", "1", "1")
    assert [(cause.count, cause.runs) for block in blocks if isinstance(block, Causes) for cause in block.causes] == [(2, 1)]


def test_too_many_verdicts_become_sums(monkeypatch: pytest.MonkeyPatch) -> None:
    records = tuple(town(1, 6))
    monkeypatch.setattr(matrix, "_MOST", 12)
    assert Matrix in map(type, outline(Report(records)))
    monkeypatch.setattr(matrix, "_MOST", 11)
    assert [type(block) for block in outline(Report(records), tables=True)] == [Head, RollUp, Figures]


def test_tables_of_a_session_together_keep_to_a_screen() -> None:
    """Thirty tests at one junction, each with seven rows; the last two have something wrong."""
    records = []
    for test in range(30):
        for cls in range(1, 8):
            for bit in range(3):
                bad = cls == 7 and test >= 28
                status = "FAIL" if bad else "PASS" if cls >> bit & 1 else "NA"
                nodeid = f"t.py::test_{test:02d}[class{cls:02d}-{bit}]"
                records.append(replace(record("J1", cls, f"p{bit}", status), nodeid=nodeid, test=f"test_{test:02d}"))
    report = Report(tuple(records))
    text = told(report)
    shown = re.findall(r"^J1   t.py::test_(\d+)$", text, re.MULTILINE)
    assert shown == ["00", "01", "28", "29"], "twelve lines each"
    assert "... and 26 more tables: -vv shows them all" in text
    assert len(re.findall(r"^J1   t.py::test_(\d+)$", told(report, full=True), re.MULTILINE)) == 30


def at(cls: int = 1, cfg: str = "C", rule: str = "p1", status: str = "PASS", **more: Any) -> Record:
    """A verdict at one junction; failures say what the message of the item says."""
    one = record("J1", cls, rule, status)
    return replace(one, **{"cfg": cfg, "nodeid": f"J1-class{cls:04d}-cfg{cfg}-{rule}", **more})


LONG = 3000
GROWN = {
    "classes that alternate": Report(tuple(at(cls, status="FAIL" if cls % 2 else "PASS") for cls in range(LONG))),
    "classes that all differ": Report(
        tuple(at(cls, rule=f"p{bit}", status="PASS" if cls >> bit & 1 else "NA") for cls in range(512) for bit in range(9))
    ),
    "configurations": Report(tuple(at(cfg=f"d{number:05d}v00.00") for number in range(LONG))),
    "configurations a table can hold": Report(tuple(at(cfg=f"d{number:05d}v00.00") for number in range(190))),
    "wrong configurations a table can hold": Report(
        tuple(at(cfg=f"d{number:05d}v00.00", status="FAIL", message="both in") for number in range(190))
    ),
    "rules": Report(tuple(at(rule=f"rule_{number}", status="NA") for number in range(LONG))),
    "causes": Report(
        tuple(at(number, status="ERROR", outcome="failed", message=f"{'x' * (number % 997)} broke") for number in range(LONG))
    ),
    "a message": Report((at(status="ERROR", outcome="failed", message="word " * 20_000),)),
    "policies of traffic": Report(tuple(at(traffic=f"policy_{number}") for number in range(LONG))),
    "tests": Report(
        tuple(at(nodeid=f"t.py::test_{number}[x]", test=f"test_{number}") for number in range(LONG)),
        left_out={f"test_{number}": 1 for number in range(LONG)},
    ),
    "drivers": Report(tuple(at(driver=f"mine.Pilot{number}") for number in range(LONG))),
    "reasons and junctions": Report(
        (at(),),
        refused={f"it is {number}": tuple(f"J{number}.{k}" for k in range(50)) for number in range(LONG)},
        unfit={f"J{number}": 1 for number in range(LONG)},
    ),
}


@pytest.mark.parametrize("what", GROWN)
@pytest.mark.parametrize("width", [60, 100])
def test_a_summary_keeps_to_a_screen_or_two_whatever_grows(what: str, width: int) -> None:
    lines = told(GROWN[what], width).splitlines()
    assert sum(-(-max(len(line), 1) // width) for line in lines) < 130, "as a terminal of that width breaks them"


@pytest.mark.parametrize("what", GROWN)
def test_unfolded_markdown_has_less_than_130_lines(what: str) -> None:
    unfolded, folds = markdown(GROWN[what]), 1
    while folds:  # some are within others
        unfolded, folds = re.subn(r"<details>(?:(?!<details>).)*?</details>", "", unfolded, flags=re.DOTALL)
    assert len(unfolded.splitlines()) < 130


def test_numbers_stand_for_configurations_of_columns_that_are_shown() -> None:
    text = told(GROWN["configurations a table can hold"])
    heads = set(re.findall(r"(?<!^ )#(\d+)\b", text, re.MULTILINE))
    assert heads == set(re.findall(r"^ #(\d+) = d", text, re.MULTILINE))
    assert 0 < len(heads) < 60


def test_a_table_that_is_wider_than_some_screens_is_cut_but_for_its_failures() -> None:
    """Forty rules over twenty rows, the last of which fails one."""
    records = [
        record("J1", run, f"a_rule_with_number_{n:02d}", "FAIL" if (run, n) == (20, 39) else "PASS" if run & n else "NA")
        for run in range(1, 21)
        for n in range(40)
    ]
    text = told(Report(tuple(records)))
    table = rows(text)
    assert len(table) < 60
    shown = re.findall(r"a_rule_with_number_(\d\d)", "\n".join(table))
    assert (shown[0], shown[-1], len(shown) < 20) == ("00", "39", True)
    assert f" ... and {40 - len(shown)} more columns: -vv shows them all" in table
    whole = "\n".join(rows(told(Report(tuple(records)), full=True)))
    assert {f"{n:02d}" for n in range(40)} == set(re.findall(r"a_rule_with_number_(\d\d)", whole))


def test_records_without_a_test_have_a_junction_for_a_title() -> None:
    among = replace(record("J1", 1, "p1", "PASS"), traffic="hesitant")
    titles = [block.title for block in outline(Report((record("J1", 1, "p1", "PASS"), among))) if isinstance(block, Matrix)]
    assert titles == ["J1", "J1 among hesitant traffic"]


@pytest.mark.parametrize("form", [".md", ".html", ".json", "terminal"])
def test_rerun_command_is_that_of_the_report(form: str) -> None:
    report = Report(tuple(town(2, wrong=[(1, 1)])), again="rvads town T.xodr --only")
    text = told(report) if form == "terminal" else written(form, report)
    assert "rvads town T.xodr --only" in text
    assert "pytest" not in text.replace("pytest_rvads", "")


def content(report: Report) -> Any:
    (data,) = re.findall('id="data">(.*)</script>', page(report, Path()))
    return json.loads(data)


def test_full_page_holds_failures_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pytest_rvads.satellites.pages.page._ITEMS", 500)
    wrong = [(j, run) for j in range(1, 31) for run in (1, 2)]
    known = [record("J1", run, "p1", "FAIL", known="I3: order") for run in range(6, 506)]
    report = Report((*town(60, 5, wrong=wrong), *known))
    data = content(report)
    assert (data["all"], len(data["items"])) == (1100, 500)
    assert sum(item["status"] == "FAIL" and not item["known"] for item in data["items"]) == 60, "all of them"
    monkeypatch.setattr("pytest_rvads.satellites.pages.page._ITEMS", 1000)
    data = content(report)
    assert sum(item["known"] for item in data["items"]) == 500
    assert len({(item["junction"], item["rule"]) for item in data["items"]}) == 120, "every rule at every junction"
    places = {one.nodeid: number for number, one in enumerate(report.records)}
    found = [places[item["id"]] for item in data["items"]]
    assert found == sorted(found), "in their order"
    whole = content(Report(tuple(town(50, 5))))
    assert (whole["all"], len(whole["items"])) == (500, 500)


def test_markdown_folds_the_junctions_that_are_not_the_worst() -> None:
    text = markdown(Report(tuple(town(25, 1, wrong=[(25, 1)]))))
    assert "<details><summary>5 more junctions</summary>\n\n| junction | kind |" in text
    before, _, after = text.partition("<details>")
    names = [re.findall(r"^\| (J\d+) \|", part, re.MULTILINE) for part in (before, after)]
    assert (names[0][0], len(names[0]), names[1]) == ("J25", 20, [f"J{n}" for n in range(20, 25)])


@dataclass
class Stream(Collection[Record]):
    """Records that are made whenever somebody goes through them."""

    runs: int
    passes: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        return 2 * self.runs

    def __contains__(self, one: object) -> bool:
        raise AssertionError("nobody looks for a record")

    def __iter__(self) -> Iterator[Record]:
        self.passes.append(1)
        for number in range(self.runs):
            junction, run = f"J{number % 10}", number // 10 % 90
            for rule, status in (("p1", "FAIL" if number % 20 == 3 else "PASS"), ("p2", "NA")):
                one = record(junction, run, rule, status, requirements=(f"R{number % 3}",) if number % 2 else ())
                yield replace(one, hash=f"{number:032x}")


def test_an_outline_takes_one_pass() -> None:
    stream = Stream(50)
    outline(Report(stream))
    assert len(stream.passes) == 1


@pytest.mark.parametrize("form", [*FORMATS, "terminal"])
def test_streamed_records_render_like_a_tuple(form: str) -> None:
    lazy, whole = Report(Stream(200)), Report(tuple(Stream(200)))
    if form == "terminal":
        assert told(lazy) == told(whole)
    else:
        assert written(form, lazy) == written(form, whole)


def test_rows_come_in_the_order_of_requirements() -> None:
    long = "x" * 2000
    wanted = ["B", "A", "", "C"]
    records = [
        replace(record("J1", run, "p1", "PASS"), nodeid=f"{run}", message=long, requirements=(name,) if name else ())
        for run in range(800)
        for name in [wanted[run % 4]]
    ]
    rows = list(csv.DictReader(io.StringIO(written(".csv", Report(tuple(records))))))
    assert [(row["requirement"], int(row["item"])) for row in rows] == [
        *(("A", n) for n in range(1, 800, 4)),
        *(("B", n) for n in range(0, 800, 4)),
        *(("C", n) for n in range(3, 800, 4)),
        *(("", n) for n in range(2, 800, 4)),
    ]
    assert {row["message"] for row in rows} == {long}
    assert {row["control"] for row in rows} == {"stop"}


def test_json_has_a_record_per_line() -> None:
    report = Report(tuple(town(3)))
    lines = [line.strip().rstrip(",") for line in written(".json", report).splitlines()]
    found = [json.loads(line) for line in lines if line.startswith('{"type"')]
    assert [one["nodeid"] for one in found] == [one.nodeid for one in report.records]


def test_a_report_written_before_there_was_another_command_is_read(tmp_path: Path) -> None:
    report = Report(tuple(town(1)))
    content = json.loads(written(".json", report))
    assert content.pop("again") == "pytest"
    (tmp_path / "r.json").write_text(json.dumps(content, indent=1), encoding="utf-8")
    assert load(tmp_path / "r.json") == report


def found_by(tally: triage.ByText, records: list[Record]) -> list[triage.Cause]:
    for one in records:
        tally.add(one)
    return tally.causes(True)


def test_a_cause_counts_all_and_keeps_the_ids_of_the_first_thousand() -> None:
    (cause,) = found_by(triage.causes(), [record("J1", run, "p1", "FAIL") for run in range(1200)])
    assert (cause.count, cause.runs, len(cause.nodeids), cause.nodeids[0]) == (1200, 1200, 1000, cause.example)


@given(st.permutations([(run, rule) for run in range(4) for rule in range(3)]))
def test_causes_and_coverage_do_not_depend_on_what_comes_between_the_records_of_a_run(order: list[tuple[int, int]]) -> None:
    """In each run rule 2 breaks first; in the last one it is the only one."""

    def verdict(run: int, rule: int) -> Record:
        status = "PASS" if run == 3 and rule < 2 else "FAIL"
        one = record("J1", run, f"p{rule}", status)
        told = {"violated": f"what p{rule} is about", "time": 5.0 - rule}
        return replace(one, verdicts=tuple(replace(v, **told) for v in one.verdicts))

    records = [verdict(*key) for key in order]
    (cause,) = found_by(triage.causes(), records)
    assert (cause.text, cause.count, cause.runs, cause.junctions) == ("what p2 is about", 10, 4, 1)
    assert (cause.rules[0], set(cause.rules), set(cause.nodeids)) == (
        "p2",
        {"p0", "p1", "p2"},
        {one.nodeid for one in records if one.failed},
    )
    assert str(cell_coverage(counts_of(Report(tuple(records))))) == "12/12 cells exercised (100.0 %)"


def test_stack_with_several_vehicles_counts_one_run() -> None:
    took = Computing(stack="stack ./mine", decisions=50, compute=0.5, longest=0.02)
    report = Report((replace(record("J1", 1, "p1", "PASS"), timing={"a0": took, "a1": took}),))
    assert "stack ./mine: 100 decisions in 1 run, 10 ms each, 20 ms the longest" in told(report, 120)


def test_names_with_numbers_are_in_their_order_however_long_these_are() -> None:
    long = "9" * 5000  # Python makes no number of so many digits
    names = ["j26", "j124", "j07", "j7", f"j{long}", f"j1{long}", "j", "\u0663"]
    assert sorted(names, key=natural) == ["\u0663", "j", "j07", "j7", "j26", "j124", f"j{long}", f"j1{long}"]

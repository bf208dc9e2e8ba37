"""One outline: a report that has something of everything says all of it in every form."""

import csv
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec import structs

import pytest_rvads as rvads
from pytest_rvads.logic.conduct.kpis import kpis
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.figures import SIMULTANEOUS
from pytest_rvads.report.files import FORMATS, load, save
from pytest_rvads.report.matrix import Matrix
from pytest_rvads.report.outline import Block, Causes, Changes, Figures, Head, RollUp, outline
from pytest_rvads.report.record import (
    AgentRecord,
    Computing,
    Excess,
    Record,
    RecordedItem,
    SimulatedItem,
    conclude,
    planned_record,
    received,
    sent,
)
from pytest_rvads.report.session_report import Cell, Change, Comparison, Report, cell_of
from pytest_rvads.report.terminal import summary
from pytest_rvads.report.triage import hanging as hanging_on
from pytest_rvads.runs.measured import ArrivalDifferences, Kpis

STACK = Computing(stack="stack ./mine", decisions=60, compute=0.3, longest=0.02)
EXCESS = Excess(requests=3, largest=-33.2)
INDICATORS = {
    "vehicles": [{"agent": "a0", "waiting": 7.0, "delay": 3.0, "deceleration": 4.5, "jerk": 1.0}],
    "pairs": [{"agents": ["a0", "a1"], "ttc": 0.4, "pet": 1.3}],
}
AGENTS = tuple(AgentRecord(name=f"a{arm}", kind="car", entrance=(arm, 0), exit=(arm + 2, 0)) for arm in (0, 1))
ARRIVALS = ArrivalDifferences(1, 14, ((0, 1, 0.25),))
TELLING: dict[str, dict[str, Any]] = {
    "FAIL": {"violated": "both <in> | it", "roles": "a left from +0", "time": 2.0},
    "OPEN": {"violated": "waits for ever", "time": 9.0},
    "PROVOKED": {"status": "FAIL", "provoked": True, "violated": "was run into"},
    "UNAVOIDABLE": {"status": "FAIL", "unavoidable": True, "violated": "a cycle of four"},
    "UNSURE": {"instances": (InstanceVerdict((("a", "v7"), ("a'", "v9")), Status.UNSURE, hangs="v7 came 0.02 s <= v9"),)},
}


def record(number: int, outcome: Outcome, known: str | None = None) -> Record:
    """An item with an outcome; each has a run of its own."""
    keys: dict[str, Any] = {
        "junction": "stop4",
        "cls": number,
        "scenario": f"11{number:02d}",
        "cfg": "d12.50v08.00",
        "rotation": 0,
        "seat": 1,
        "traffic": "hesitant",
        "rule": f"p{number % 2}",
        "driver": "mine.Pilot",
        "source": "mine.py 3fa29c01",
        "simulator": "mine",
    }
    start = planned_record(f"t.py::test[stop4-class{number:02d}-p{number % 2}]", 3, "test", keys, 4, ("REQ-1", "REQ-2"))
    telling = dict(TELLING.get(outcome, {}))
    status = telling.pop("status", outcome.value)
    verdicts = [Verdict("", Status(status), "", **telling)] if outcome.value in (*TELLING, "PASS", "NA") else []
    kpis = msgspec.convert(INDICATORS, Kpis)
    ran = structs.replace(start, run=f"run{number}", hash=f"h{number}", kpis=kpis, timing={"a1": STACK}, excess={"a1": EXCESS})
    ran = structs.replace(ran, agents=AGENTS, arrivals=ARRIVALS)
    result = "skipped" if known or outcome.meaning == "idle" else "failed" if outcome.bad else "passed"
    over = conclude(ran, verdicts, "call", result, known=known, text=f"{outcome} in run {number}")
    return structs.replace(over, status=outcome)


def recorded(one: Record) -> Record:
    """The record of a run that nobody simulated."""
    keys = {"junction": one.junction, "control": one.control, "recording": "drive17-t0312.4", "rule": one.rule}
    start = planned_record("t.py::test[drive17-t0312.4-p1]", one.line, one.test, keys, one.ways, one.requirements)
    shared = ("status", "verdicts", "outcome", "message", "run", "hash", "kpis", "arrivals", "agents", "variant")
    return structs.replace(start, **{name: getattr(one, name) for name in shared})


def in_variant(one: Record, variant: str) -> Record:
    """The record of a run of one of several controllers."""
    return structs.replace(one, nodeid=one.nodeid.replace("[", f"[{variant}-"), variant=variant)


def everything() -> Report:
    records = [record(number, outcome) for number, outcome in enumerate(Outcome, start=1)]
    records.append(record(len(records) + 1, Outcome.FAIL, "I3: order of creation"))
    records.append(recorded(record(len(records) + 1, Outcome.PASS)))
    records += [in_variant(record(len(records) + n, outcome), f"v{n}") for n, outcome in ((1, Outcome.PASS), (2, Outcome.FAIL))]
    comparison = Comparison(
        "main.json",
        (
            Change("NEW", records[1].nodeid, "p1 at t=2.00 s"),
            Change("LOST", "t.py::test[gone]", "was PASS"),
            Change("OUTSIDE", "x"),
        ),
        ("numpy was 1.0 and is 2.0",),
    )
    return Report(
        tuple(records),
        {4: (24, 81)},
        (*map(cell_of, records), Cell("stop4", 20, "C", "p1", None, None)),
        {"numpy": "2.0"},
        1,
        ("3 items vanished", "2 items did not run"),
        {"test": 2},
        {f"test[run{n}]": n / 10 for n in range(12)},
        comparison,
    )


def facts(block: Block) -> Iterator[str]:
    """The smallest things that a block says."""
    match block:
        case Changes(comparison):
            yield from (comparison.headline, *comparison.lines())
        case Matrix() as matrix:
            yield from (matrix.title, matrix.corner)
            yield from (word for column in matrix.columns for word in column)
            yield from (text for label, entries in matrix.rows for text in (label, *(entry.text for entry in entries)))
        case Causes(title, causes):
            yield title
            yield from (text for c in causes for text in (str(c.count), c.rule, c.line, c.example))
        case RollUp(sums):
            yield block.title
            yield from (text for table in sums for row in (table.columns, *map(table.cells, table.rows)) for text in row)
        case Figures(lines, arrivals=table):
            assert table is not None
            yield from lines
            yield from (text for row in table.rows for text, _ in row[:-1])  # bars are for eyes, lines have numbers
        case _:
            yield from block.plain()


def strings(value: Any) -> Iterator[str]:
    """Every string and number in a value of JSON."""
    if isinstance(value, dict):
        yield from (text for pair in value.items() for one in pair for text in strings(one))
    elif isinstance(value, list):
        yield from (text for one in value for text in strings(one))
    else:
        yield str(value)


def read(form: str, text: str) -> str:
    """What a reader of a form reads, without its way to write special characters."""
    if form == ".html":
        (data,) = re.findall(r'<script type="application/json" id="data">(.*)</script>', text)
        markup = text[: text.index("<script")].replace("<li>", "\n")
        markup = markup.replace("<dt>command</dt><dd>", "command: ").replace("</dt><dd>", " ")
        return unescape(re.sub(r"<[^>]*>", "\n", markup)) + "\n".join(strings(json.loads(data)))
    if form == ".json":
        return "\n".join(strings(json.loads(text)))
    if form == ".md":
        return unescape(re.sub(r"\\([!-/:-@\[-`{-~])", r"\1", text)).replace("\u2060", "")
    return text


@pytest.mark.parametrize("form", [".json", ".html", ".md", "terminal"])
def test_no_form_leaves_out_what_another_says(form: str) -> None:
    report = everything()
    blocks = outline(report)
    assert [block.title for block in blocks] == [
        *(
            "notes",
            "session",
            "since the baseline",
            "stop4 among hesitant traffic   t.py::test",
            "stop4 as recorded   t.py::test",
        ),
        *("causes of failures", "provoked by traffic", "unavoidable: nobody could have kept the rule"),
        "unsure: another reading of what was recorded changes the verdict",
        *("known failures", "not applicable, skipped or not run", "coverage"),
    ]
    head = ["15 verdicts on 15 runs: 3 pass, 2 fail, ", "exit status 1", "driven by", "simulated by"]
    assert [next(b for b in head if line.startswith(b)) for line in blocks[1].plain()] == head
    figures = blocks[-1].plain()
    begins = [
        "nearest",
        "most",
        "stop4: ",
        "stop4 as recorded: 1 run, 1 verdict: ",
        "stack ./mine",
        "beyond the limits of the vehicle: ",
        "slowest",
        "requirement REQ-1",
        "requirement REQ-2",
        "versions",
    ]
    begins += ["coverage", "arrivals: ", "2 points beyond", SIMULTANEOUS, "junction stop4, ", "junction stop4 as recorded, "]
    assert [next(b for b in begins if line.startswith(b)) for line in figures] == begins
    if form == "terminal":
        blocks = blocks[1:]  # Who asks for the summary prints the notes: tests/plugin/test_interrupted.py, test_gate.py.
    said = rendered(form, report)
    wanted = [fact for block in blocks for fact in facts(block)]
    assert len(wanted) > 60
    assert [fact for fact in wanted if fact.lower() not in said] == []


@pytest.mark.parametrize("form", [".json", ".html", ".md", "terminal"])
def test_no_form_leaves_out_what_another_says_of_many_junctions(form: str) -> None:
    one = everything()
    records = [
        structs.replace(record, junction=f"stop4.{number}", control="stop", nodeid=f"{record.nodeid}.{number}")
        for number in range(25)
        for record in one.records
    ]
    blocks = outline(replace(one, records=tuple(records), planned=()))
    assert [type(block) for block in blocks[1:5]] == [Head, Changes, RollUp, Causes], "in place of tables"
    said = rendered(form, replace(one, records=tuple(records), planned=()))
    wanted = [fact for block in blocks[1:] for fact in facts(block)]
    assert len(wanted) > 500
    assert [fact for fact in wanted if fact.lower() not in said] == []


def rendered(form: str, report: Report) -> str:
    """What a reader of a form reads, in small letters."""
    if form == "terminal":
        return summary(report, colour=False, width=2000, unicode=True, full=True).lower()
    return read(form, written(form, report)).lower()


def written(form: str, report: Report) -> str:
    """What a form writes; some come in pieces."""
    return "".join(FORMATS[form](report, Path()))


SUMMED_UP = {
    "nodeid": "the first of each cause",
    "line": "the node id tells where it is",
    "control": "where there are many junctions, by their kind",
    "ways": "the junction has them",
    "scenario": "rows are classes",
    "rotation": "rows are classes",
    "seat": "rows are classes",
    "pedestrians": "rows are classes",
    "orbit": "rows are classes",
    "verdicts": "as causes, by what was violated",
    "formula": "told where it is not that of the baseline",
    "outcome": "pytest tells it",
    "late": "the message tells it",
    "agents": "pictures and replays show them",
    "run": "those with extremes, and the slowest",
    "hash": "programs compare it",
    "place": "programs compare it",
    "duration": "the slowest, by the clock on the wall",
    "kpis": "the extremes",
    "arrivals": "per pair of movements, or per junction",
    "timing": "per stack",
    "excess": "one sum for all",
    "unkept": "one note for all",
    "flaky": "as a cause",
    "look": "the page links them",
    "looks": "likewise",
    "change": "in the list of changes",
}
"""The fields of records that text does not say record by record, and what it says instead; JSON has all of them."""


def told(one: Record) -> dict[str, tuple[str, ...]]:
    """What text says of a record by itself, by field."""
    idle = one.status in ("NA", "NOT RUN") and not one.known  # messages of failures are told as causes, those of passes are not
    if isinstance(one, RecordedItem):
        begun: dict[str, tuple[str, ...]] = {"recording": (one.recording,)}
    else:
        begun = {"cls": (f"{one.cls:02d}",), "cfg": (one.cfg,), "traffic": (one.traffic or "",)}
        begun |= {"driver": (one.driver,), "source": (one.source,), "simulator": (one.simulator,)}
    return begun | {
        "junction": (one.junction,),
        "test": (one.test,),
        "variant": (one.variant,),
        "rule": (one.asks,),
        "requirements": one.requirements,
        "status": () if one.known else (one.status.cell,),
        "known": (one.known,) if one.known else (),
        "message": (one.message,) if idle else (),
    }


@pytest.mark.parametrize("form", [".json", ".html", ".md", "terminal"])
def test_every_form_says_all_of_every_record_but_what_is_summed_up(form: str) -> None:
    report = everything()
    fields = {name for kind in (SimulatedItem, RecordedItem) for name in kind.__struct_fields__}
    simulated = record(1, Outcome.PASS)
    assert {*told(simulated), *told(recorded(simulated)), *SUMMED_UP} == fields
    said = rendered(form, report)
    wanted = [(one.nodeid, fact) for one in report.records for facts in told(one).values() for fact in facts]
    assert [(item, fact) for item, fact in wanted if fact.lower() not in said] == []
    assert [fact for name, version in report.versions.items() for fact in (name, version) if fact not in said] == []


def test_the_tables_have_a_row_with_all_columns_for_every_record() -> None:
    report = everything()
    rows = {row["item"]: row for row in csv.DictReader(written(".csv", report).splitlines())}
    for one in report.records:
        found = {heading: rows[one.nodeid][heading] for heading in ("class", "verdict", "known", "run", "message", "versions")}
        assert list(found.values()) == [
            str(getattr(one, "cls", "")),
            one.status,
            one.known or "",
            one.hash,
            one.message,
            "numpy 2.0",
        ]


def test_known_failure_without_a_rule_is_a_failure() -> None:
    start = record(1, Outcome.NOT_RUN)
    assert conclude(start, [], "call", "skipped", known="I7: too slow", text="assert 3 < 1").status is Outcome.FAIL
    assert conclude(start, [], "call", "skipped", text="no camera here").status is Outcome.NOT_RUN
    assert conclude(start, [], "setup", "skipped", known="I7: too slow").status is Outcome.NOT_RUN


def test_records_hold_no_explanations() -> None:
    explained = Verdict("p1", Status.FAIL, "p1 at t=1.00 s", explanation="a0 entered before a1\n...")
    (kept,) = conclude(record(1, Outcome.NOT_RUN), [explained], "call", "failed").verdicts
    assert kept == structs.replace(explained, explanation="")


def test_a_report_read_back_says_the_same(tmp_path: Path) -> None:
    report = everything()
    save(tmp_path / "r.json", report)
    back = load(tmp_path / "r.json")
    assert back == report
    assert outline(back) == outline(report)


@pytest.mark.parametrize(
    ("place", "value", "says"),
    [
        (("records", 1, "status"), "FINE", "the field 'records[1].status' must be 'ERROR' or 'FAIL' or "),
        (("records", 0, "kpis"), 7, "the field 'records[0].kpis' must be an object or null, got 7"),
        (("records", 0, "cls"), -1, "the field 'records[0].cls' must be a whole number >= 0, got -1"),
        (("records", 0, "type"), "searched", "the field 'records[0].type' must be 'recorded' or 'simulated', got 'searched'"),
        (("records", 0, "type"), ["recorded"], "the field 'records[0].type' must be 'recorded' or 'simulated', got ['recorded']"),
        (("records", 0, "type"), "recorded", "the field 'records[0].recording' is missing"),
        (("records", 0, "timing", "a1", "decisions"), 10**400, "'records[0].timing.a1.decisions' must be a whole number <= "),
        (("planned", 0), ["stop4"], "the field 'planned[0]' must be a list of length 6, got ['stop4']"),
        (("notes",), "one", "the field 'notes' must be a list, got 'one'"),
        (("notes", 1), "\ud800", "can't be read as a report"),
        (("seconds", "test[run3]"), "soon", "the field 'seconds.test[run3]' must be a number, got 'soon'"),
        (("seconds", "test[run3]"), float("nan"), "can't be read as a report"),
        (("totals", "four"), [24, 81], "a key of the field 'totals' must be a whole number, got ['4', 'four']"),
        (("totals", "5"), [24, "many"], "the field 'totals.5[1]' must be a whole number, got 'many'"),
        (("exitstatus",), 256, "the field 'exitstatus' must be a whole number <= 255, got 256"),
        (("comparison", "changes", 0), 3, "the field 'comparison.changes[0]' must be an object, got 3"),
        (("deep",), ["DEEP"], "can't be read as a report"),
    ],
)
def test_a_damaged_report_names_the_place(tmp_path: Path, place: tuple[Any, ...], value: Any, says: str) -> None:
    save(tmp_path / "r.json", everything())
    content = inner = json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    (tmp_path / "r.json").write_text(json.dumps(content).replace('"DEEP"', "[" * 9999 + "]" * 9999), encoding="utf-8")
    with pytest.raises(rvads.errors.RvadsError, match=r"r\.json (is a damaged report|can't be read)") as refused:
        load(tmp_path / "r.json")
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_records_hold_all_that_verdicts_and_indicators_say() -> None:
    run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "1133", distance=0.3, duration=3.0), rvads.Reference))
    for rule in ("p1", "p2", "p4"):
        verdict = rvads.check(run, rule)
        assert msgspec.json.decode(msgspec.json.encode(verdict), type=Verdict) == verdict
    assert msgspec.json.decode(msgspec.json.encode(kpis(run)), type=Kpis) == kpis(run)


def test_records_hold_what_an_unsure_instance_hangs_on() -> None:
    binding = (("a", "v7"), ("a'", "v9"))
    hanging, sure = (
        InstanceVerdict(binding, Status(s), (), 3, None, (), 0.02, h) for s, h in (("UNSURE", "0.02 s"), ("PASS", ""))
    )
    start = planned_record("t.py::test[p3]", 3, "test", {"junction": "stop4", "rule": "p3"}, 4)
    verdict = Verdict("p3", Status.UNSURE, "p3 UNSURE", instances=(hanging, sure))
    back = received(sent(conclude(start, [verdict], "call", "skipped")))
    assert back.verdicts == (verdict,)
    assert hanging_on(back) == "a=v7, a'=v9: 0.02 s"


def test_a_record_crosses_processes_as_builtins() -> None:
    for one in everything().records:
        content = sent(one)
        assert json.loads(json.dumps(content)) == content
        assert received(content) == one
        assert content.keys() & {"unkept", "flaky", "look", "change"} == set(), "what there is none of is left out"


def test_every_outcome_has_severity_title_and_section() -> None:
    severities = [outcome.severity for outcome in Outcome.worst_first()]
    assert severities == sorted(set(severities))
    assert [outcome for outcome in Outcome if outcome.judges] == ["PASS", "FAIL", "OPEN"]
    assert {outcome for outcome in Outcome if outcome.bad} == {"ERROR", "FLAKY", "FAIL", "NOT JUDGED", "OPEN"}
    assert all(Outcome(outcome.value) is outcome and outcome.word and outcome.cell for outcome in Outcome)
    empty = replace(everything(), records=(), seconds={}, notes=(), comparison=None, left_out={}, planned=(), versions={})
    said = [["0 verdicts on 0 runs: none", "exit status 1"], ["coverage: 0/0 cells exercised (0.0 %)"]]
    assert [list(block.plain()) for block in outline(empty)] == said

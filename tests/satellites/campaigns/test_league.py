"""``rvads league``: drivers share their cells, a killed league continues, and a wrong configuration gives one sentence."""

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from msgspec import structs

from pytest_rvads.cli import main
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.outline import Notes
from pytest_rvads.report.record import conclude, planned_record
from pytest_rvads.report.session_report import Report
from pytest_rvads.report.side_by_side import sections, side_by_side
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.campaigns.campaign import campaign
from pytest_rvads.satellites.campaigns.league import Config, League, Side, figure_sections
from pytest_rvads.satellites.campaigns.resultsfile import Results
from pytest_rvads.satellites.pages.page import rendered
from pytest_rvads.satellites.starts.critical import CriticalStart, Order
from pytest_rvads.satellites.starts.lines import Fault
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.simulator import Simulator, simulate
from pytest_rvads.support.errors import RvadsError

CELLS = """
junctions = ["stop4"]
traffic = ["reference", "hesitant"]
cells = 3
seed = 1
"""
TWO = f"""{CELLS}
[drivers]
reference = {{ autopilot = "reference" }}
"rolling stop" = {{ autopilot = "rolling_stop" }}
"""
PILOTS = """
import os
import signal
import time
from pathlib import Path

from pytest_rvads import Reference

class Raising(Reference):
    def control(self, seen):
        raise ValueError("no idea")

class Killed(Reference):
    made = 0

    def __init__(self):
        super().__init__()
        Killed.made += 1
        if Killed.made == 2 and Path("kill").exists():
            time.sleep(2)  # the league writes the result of the first run
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(60)

class Interrupts(Reference):
    def control(self, seen):
        if seen.time > 0.5 and Path("stop").exists():
            os.kill(os.getppid(), getattr(signal, Path("stop").read_text()))
            swallows()
        return super().control(seen)

class Ends(Reference):
    def control(self, seen):
        os._exit(0)

def swallows():
    while True:
        try:
            time.sleep(1)
        except BaseException:
            pass
"""


class Page(HTMLParser):
    """The tags, the links and the cells of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.cells: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attributes if (tag, name) == ("a", "href")]
        if tag in ("th", "td"):
            self.cells.append("")

    def handle_data(self, data: str) -> None:
        if self.cells:
            self.cells[-1] += data


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with drivers."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "league_pilots", raising=False)
    (tmp_path / "league_pilots.py").write_text(PILOTS)
    return tmp_path


def judged(text: str, out: str = "out") -> tuple[int, dict[str, Any]]:
    """Return the exit status and the JSON object of a league with a configuration."""
    Path("league.toml").write_text(text, encoding="utf-8")
    status = main(["league", "league.toml", "-j", "1", "-o", out])
    return status, json.loads((Path(out) / "league.json").read_text(encoding="utf-8"))


def never(*_: object, **__: object) -> None:
    raise AssertionError("this was judged before")


@pytest.mark.extended
def test_two_drivers_are_judged_on_the_same_cells(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    status, league = judged(TWO)
    assert status == 1
    reference, rolling = league["drivers"]
    assert (reference["name"], rolling["name"]) == ("reference", "rolling stop")
    runs = [[(result.run, result.traffic) for result in Results(path)] for path in sorted((folder / "out").glob("results-*"))]
    assert runs[0] == runs[1]
    assert sorted(traffic or "" for _, traffic in runs[0]) == ["hesitant", "reference", "reference"]
    assert reference["verdicts"]["full_stop"] == {"PASS": 3}
    assert rolling["verdicts"]["full_stop"] == {"FAIL": 3}
    (cause,) = league["causes"]
    assert (cause["rule"], cause["counts"], cause["where"]) == ("full_stop", [0, 3], "only in rolling stop")
    page = Page(folder / "out" / "league.html")
    row = [cell.strip() for cell in page.cells]
    assert row[row.index("full_stop") :][:3] == ["full_stop", "3 pass", "3 fail"]
    assert [f"out/{link}" for link in page.links] == [cause["look"]]
    assert all((folder / "out" / unquote(link.partition("#")[0])).is_file() for link in page.links)
    capsys.readouterr()
    (command,) = (cell for cell in row if cell.startswith("rvads critical"))
    assert main(shlex.split(command.splitlines()[0])[1:]) == 1
    assert "full_stop" in capsys.readouterr().out

    page_before = (folder / "out" / "league.html").read_bytes()
    monkeypatch.setattr("pytest_rvads.satellites.campaigns.campaign.simulate", never)
    assert judged(TWO) == (1, league)
    assert (folder / "out" / "league.html").read_bytes() == page_before


def test_league_in_which_no_rule_applies_judged_nothing() -> None:
    status, league = judged(f'{CELLS}rules = ["red"]\n[drivers]\nreference = {{ autopilot = "reference" }}\n')
    assert status == 5
    assert league["drivers"][0]["verdicts"] in ({}, {"red": {"NA": 3}})


def test_driver_that_raises_costs_only_its_own_cells() -> None:
    status, league = judged(TWO.replace("rolling_stop", "league_pilots:Raising"))
    reference, raising = league["drivers"]
    assert status == 1
    assert all(counts == {"ERROR": 3} for counts in raising["verdicts"].values())
    assert "no idea" in league["causes"][0]["text"]
    assert reference["verdicts"]["full_stop"] == {"PASS": 3}


def test_driver_that_cannot_be_sent_to_processes_leaves_the_league_incomplete(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(cases: Any, *words: Any, **more: Any) -> Results:
        if "RollingStop" in str(next(iter(cases)).driver):
            raise RvadsError("it can't be pickled")
        return campaign(cases, *words, **more)

    monkeypatch.setattr("pytest_rvads.satellites.campaigns.campaign.campaign", refused)
    status, league = judged(TWO)
    assert status == 2
    assert [driver["runs"] for driver in league["drivers"]] == [3, 0]
    assert league["drivers"][1]["notes"] == ["INCOMPLETE: it can't be pickled"]


def test_failed_search_of_critical_starts_keeps_the_runs_of_the_driver(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def one_line(groups: list[Any], *_: Any) -> Iterator[CriticalStart]:
        yield from (CriticalStart(groups[0][0], order, None, ()) for order in Order)
        raise RvadsError("the process of a job died")

    monkeypatch.setattr("pytest_rvads.satellites.campaigns.league.critical_starts", one_line)
    text = f'{CELLS}critical = 2\n[drivers]\nreference = {{ autopilot = "reference" }}\n'
    status, league = judged(text)
    assert status == 2
    (reference,) = league["drivers"]
    assert (reference["runs"], reference["verdicts"]["full_stop"]) == (3, {"PASS": 3})
    assert [side["line"] for side in reference["sides"]] == [reference["sides"][0]["line"]] * 2
    assert reference["notes"] == ["INCOMPLETE: the process of a job died"]
    assert "INCOMPLETE: the process of a job died" in capsys.readouterr().out


@pytest.mark.extended
def test_killed_league_continues(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = f'{CELLS}[drivers]\nkilled = {{ autopilot = "league_pilots:Killed" }}\n'
    Path("league.toml").write_text(text)
    Path("kill").touch()
    words = [sys.executable, "-c", "from pytest_rvads.cli import main; main()", "league", "league.toml", "-j", "1", "-o", "out"]
    assert subprocess.run(words, capture_output=True, check=False).returncode == -9
    Path("kill").unlink()
    (path,) = (folder / "out").glob("results-*")
    with Results(path) as results:
        assert len(results) == 1
    assert not (folder / "out" / "league.html").exists()

    def counted(case: Case, simulator: Simulator) -> Run:
        with Path("made").open("a") as made:  # another process simulates
            made.write("x")
        return simulate(case, simulator)

    monkeypatch.setattr("pytest_rvads.satellites.campaigns.campaign.simulate", counted)
    continued = judged(text)
    assert Path("made").read_text() == "xx"
    assert continued == judged(text, out="another")
    assert Path("made").read_text() == "xxxxx"


@pytest.mark.parametrize("number", ["SIGTERM", "SIGINT"])
def test_interrupted_league_has_the_page_of_what_was_judged(folder: Path, number: str) -> None:
    drivers = ["reference", "league_pilots:Interrupts", "rolling_stop"]
    listed = "".join(f'd{k} = {{ autopilot = "{driver}" }}\n' for k, driver in enumerate(drivers))
    Path("league.toml").write_text(f"{CELLS}[drivers]\n{listed}")
    Path("stop").write_text(number)
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    code = (
        "import signal; from pytest_rvads.cli import main; signal.signal(2, signal.default_int_handler); raise SystemExit(main())"
    )
    words = [sys.executable, "-c", code, "league", "league.toml", "-j", "1", "-o", "out"]
    done = subprocess.run(words, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2, done.stderr
    league = json.loads(Path("out/league.json").read_text())
    assert [(driver["runs"], driver["notes"]) for driver in league["drivers"]] == [
        (3, []),
        (0, ["INCOMPLETE: interrupted"]),
        (0, ["INCOMPLETE: interrupted"]),
    ]
    assert "INCOMPLETE: interrupted" in Path("out/league.html").read_text()
    Path("stop").unlink()
    status, league = judged(Path("league.toml").read_text())
    assert status == 1
    assert [driver["runs"] for driver in league["drivers"]] == [3, 3, 3]


def test_driver_that_ends_its_process_fails_its_own_cells() -> None:
    drivers = 'ends = { autopilot = "league_pilots:Ends" }\nreference = { autopilot = "reference" }\n'
    status, league = judged(f"{CELLS}[drivers]\n{drivers}")
    assert status == 1
    ends, reference = league["drivers"]
    assert {outcome for counts in ends["verdicts"].values() for outcome in counts} == {"ERROR"}
    assert "the process that simulated it died" in league["causes"][0]["text"]
    assert reference["verdicts"]["full_stop"] == {"PASS": 3}


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("type", {}, "the field 'type' must be"),
        ("kpis", 3, "the field 'kpis' must be"),
        ("junction", None, "the field 'junction' must be"),
        ("nodeid", "zz", "'zz' is no run of this league"),
    ],
)
def test_damaged_line_of_results_is_told_in_one_sentence(
    field: str, value: object, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = f'{CELLS}[drivers]\nreference = {{ autopilot = "reference" }}\n'
    judged(text)
    (file,) = Path("out").glob("results-*")
    lines = file.read_text().split("\n")
    number = next(k for k, line in enumerate(lines) if line and not line.startswith('{"format"'))
    lines[number] = json.dumps(json.loads(lines[number]) | {field: value})
    file.write_text("\n".join(lines))
    capsys.readouterr()
    assert judged(text)[0] == 2
    assert f"rvads: {file} is damaged: {told}" in capsys.readouterr().err


SIDE = {"line": "", "order": "goes", "started": True, "status": "PASS", "fault": None, "rule": "", "rerun": "", "error": ""}


@pytest.mark.parametrize(
    "content",
    [
        "[{}]",
        '[{"line": "x"}, {"line": "y"}]',
        "[1]",
        "{",
        "",
        "null",
        json.dumps([SIDE | {"status": "ZZ"}] * 2),
        json.dumps([SIDE | {"fault": "brave"}] * 2),
        json.dumps([SIDE | {"started": "yes"}] * 2),
        json.dumps([SIDE]),
        json.dumps([SIDE] * 4),
    ],
)
def test_damaged_file_of_critical_starts_leaves_the_league_incomplete(content: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pytest_rvads.satellites.campaigns.league.critical_starts", lambda *_: iter(()))
    text = f'{CELLS}critical = 1\n[drivers]\nreference = {{ autopilot = "reference" }}\n'
    judged(text)
    (results,) = Path("out").glob("results-*")
    file = results.with_name(results.name.replace("results-", "critical-")).with_suffix(".json")
    file.write_text(content)
    status, league = judged(text)
    assert status == 2
    (driver,) = league["drivers"]
    assert driver["runs"] == 3
    assert driver["notes"][0].startswith("INCOMPLETE: ")
    assert file.name in driver["notes"][0]


@pytest.mark.extended
def test_critical_starts_are_searched_once_and_their_failures_can_be_seen_again(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    text = TWO.replace("seed", "critical = 2\nseed").replace("cells = 3", "cells = 1")
    status, league = judged(text)
    assert status == 1
    reference, rolling = league["drivers"]
    assert [side["line"] for side in reference["sides"]] == [side["line"] for side in rolling["sides"]]
    assert len(rolling["sides"]) == 2 * league["lines"] == 4
    assert not any(side["fault"] for side in reference["sides"])
    failed = [side for side in rolling["sides"] if side["fault"]]
    assert failed
    capsys.readouterr()
    assert main(shlex.split(failed[0]["rerun"])[1:]) == 1
    assert failed[0]["rule"] in capsys.readouterr().out

    def nothing(groups: list[Any], *_: Any) -> list[Any]:
        assert not groups
        return []

    monkeypatch.setattr("pytest_rvads.satellites.campaigns.league.critical_starts", nothing)
    assert judged(text) == (1, league)


def test_name_of_a_driver_is_text_on_the_page_and_stays_in_the_folder(folder: Path) -> None:
    hostile = "../../<script>alert(1)</script>\\u001b[31m"
    _, league = judged(f'{CELLS}[drivers]\n"{hostile}" = {{ autopilot = "rolling_stop" }}\n')
    assert league["drivers"][0]["name"] == hostile.replace("\\u001b", "\x1b")
    page = Page(folder / "out" / "league.html")
    assert page.tags.count("script") == 2, "the data and the script of the page"
    assert "../../<script>alert(1)</script>\\x1b[31m" in page.cells
    assert {path.name for path in folder.iterdir()} == {"league.toml", "league_pilots.py", "out"}
    assert len(page.links) == 1
    assert (folder / "out" / unquote(page.links[0].partition("#")[0])).is_file()


def test_hostile_texts_of_results_are_texts_on_the_page() -> None:
    def page(text: str) -> str:
        made = planned_record("run-p1", 0, text, {"junction": text, "driver": text, "run": text, "rule": "p1"}, 4)
        made = structs.replace(made, hash="aa", look=f"{text}.html#t=1.00")
        report = Report((conclude(made, [Verdict("", Status.FAIL, text, violated=text)], "call", "failed", text=text),))
        side = Side(
            line=text, order=Order.GOES, started=True, status=Outcome.FAIL, fault=Fault.BOLD, rule=text, rerun=text, error=text
        )
        row = {"name": text, "runs": 1, "hours": 0.5, "met": 1, "pairs": 2, "gap": 0.5, "sides": [side]}
        parts = sections(side_by_side([(text, report)] * 3, [text] * 3), again=lambda _: text)
        return rendered(text, [Notes((text,)), *parts, *figure_sections([row])], {}, Path())

    hostile = "javascript:1</td></script><script>alert(1)</script><img src=x onerror=alert(2)>\"' \x1b[2J"
    shown, tame = page(hostile), page("tame")
    tags = [[tag for tag in re.findall("<[a-zA-Z/][^ >]*", text) if tag not in ("<a", "</a")] for text in (shown, tame)]
    assert tags[0] == tags[1], "a path that could run a script is no link"
    assert "\x1b" not in shown
    assert not [href for href in re.findall('href="([^"]*)"', shown) if href.startswith("javascript:")]


def test_page_says_how_to_read_its_tables_and_narrow_screens_repeat_the_headings(folder: Path) -> None:
    judged(TWO)
    page = (folder / "out" / "league.html").read_text(encoding="utf-8")
    assert "<th>rule<th>reference<th>rolling stop</thead>" in re.sub(r"\s*\n\s*", "", page)
    assert "The untested gap is " in page
    headings = ["where", "reference", "rolling stop", "rule", "cause", "replay", "first"]
    assert re.findall('data-column="([^"]*)"', page)[: len(headings)] == headings


DRIVER = '[drivers.a]\nautopilot = "reference"\n'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("junctions = [", "league.toml must hold a league in TOML: Invalid value (at end of document)"),
        (CELLS, "league.toml: the field 'drivers' is missing"),
        (f"{CELLS}drivers = 3\n", "league.toml: the field 'drivers' must be an object, got 3"),
        (f"cels = 3\n{DRIVER}", "league.toml: the field 'cels' is unknown, expected one of drivers, cells, junctions, "),
        (f"{CELLS}{DRIVER}speed = 3\n", "league.toml: the field 'drivers.a.speed' is unknown, expected one of autopilot, sut, "),
        (f'{CELLS}{DRIVER}sut = "x"\n', "league.toml: the field 'drivers.a' must have an autopilot or a sut, got both: "),
        (f"{CELLS}[drivers.a]\n", "league.toml: the field 'drivers.a' must have an autopilot or a sut, got none: "),
        (f'{CELLS}[drivers.a]\nsut = "\'"\n', """league.toml: drivers.a: a stack needs a command as for a shell, got "'": """),
        (f'{CELLS}{DRIVER}simulator = "none"\n', "league.toml: drivers.a: unknown simulator 'none', there is "),
        (f'{CELLS}[drivers.a]\nautopilot = "no_module:X"\n', "league.toml: drivers.a: --autopilot must name an autopilot as "),
        (f"{CELLS.replace('3', '0')}{DRIVER}", "league.toml: the field 'cells' must be a whole number >= 1, got 0"),
        (
            f"{CELLS.replace('stop4', 'stop5')}{DRIVER}",
            "league.toml: junctions: unknown junction 'stop5': the built-in ",
        ),
        (f"cells = 3\n{DRIVER}", "league.toml: no cell is possible: name junctions or maps"),
        (f"seats = [7]\n{CELLS}{DRIVER}", "league.toml: no cell is possible: stop4: subject must be an entrance, 0 to 3, "),
        (f"{CELLS.replace('hesitant', 'shy')}{DRIVER}", "league.toml: traffic: unknown traffic 'shy', there are reference, "),
        (f'rules = ["nope"]\n{CELLS}{DRIVER}', "league.toml: rules: unknown rule 'nope', there are "),
        (f'maps = [{{file = "x.xodr"}}]\n{CELLS}{DRIVER}', "league.toml: the field 'maps[0].junctions' is missing"),
        (f'maps = [{{file = "x.xodr", junctions = 1}}]\n{CELLS}{DRIVER}', "league.toml: maps: map file x.xodr does not exist; "),
    ],
)
def test_wrong_configuration_is_one_sentence(text: str, sentence: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("league.toml").write_text(text)
    assert main(["league", "league.toml", "-j", "1"]) == 2
    out, err = capsys.readouterr()
    assert not out
    assert err.count("\n") == 1
    assert err.startswith(f"rvads: {sentence}")
    assert not (folder / "rvads-league").exists()


def test_missing_configuration_is_one_sentence(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["league", "missing.toml"]) == 2
    sentence = "missing.toml can't be read: No such file or directory, expected the configuration of a league in TOML"
    assert capsys.readouterr().err == f"rvads: {sentence}\n"


def test_folder_that_cannot_be_made_is_one_sentence(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "league.toml").write_text(TWO, encoding="utf-8")
    (folder / "file").touch()
    assert main(["league", "league.toml", "-o", "file"]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        "rvads: -o must name a folder to write to, got 'file', which can't be made (File exists): name another folder"
    )


def test_seats_and_traffic_share_the_cells() -> None:
    text = TWO.replace("cells = 3", "cells = 5").replace("seed", "seats = [2, 0]\nseed")
    config = Path("league.toml")
    config.write_text(text)
    league = League(Config.read(config), config)
    groups = [(case.scenario.subject, "hesitant" in name) for name, case in league.cells.items()]
    assert sorted(groups) == [(0, False), (0, True), (2, False), (2, False), (2, True)]


def test_junction_without_a_seat_is_left_out(capsys: pytest.CaptureFixture[str]) -> None:
    _, league = judged(TWO.replace('"stop4"', '"stop3", "stop4"').replace("seed", "seats = [3]\nseed"))
    assert league["junctions"] == ["stop4"]
    assert "left out: stop3: subject must be an entrance, 0 to 2" in capsys.readouterr().err

"""``rvads critical``, with ``--all-lines``, and ``rvads dynamics``: tables, JSON, pages and exit statuses."""

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.starts import all_lines, critical_command, lines
from pytest_rvads.satellites.starts.lines import Line, Setting, lines_at
from pytest_rvads.scenarios.ids import from_id
from pytest_rvads.simulators import driver_dynamics

from ...synthetic_starts import judged_by

Make = Callable[..., Run]
Read = pytest.CaptureFixture[str]
GROUP = lines_at(rvads.find("stop3"))[0]
RULES = ("--rules", "no_collision", "-j", "1")
CRITICAL = ("critical", "stop3", "--autopilot", "reference", *RULES)
START = GROUP[0].scenario(-50).name
STOP4 = str(path_of("stop4"))
TURN = 50
"""Lead from which on the subject goes [steps]: 0.5 s."""


def passing(lead: int) -> tuple[bool, Mapping[str, Status]]:
    return lead >= TURN, {"no_collision": Status.PASS}


def colliding(lead: int) -> tuple[bool, Mapping[str, Status]]:
    """Return the verdict of a driver that sets off too early."""
    return lead >= TURN, {"no_collision": Status.FAIL if TURN <= lead < 2 * TURN else Status.PASS}


def not_asked(lead: int) -> tuple[bool, Mapping[str, Status]]:
    return lead >= TURN, {"no_collision": Status.NA}


@pytest.fixture
def choose(monkeypatch: pytest.MonkeyPatch) -> Callable[[Sequence[Line]], None]:
    """Return a function that makes a group of lines the only group of every junction."""

    def chosen(group: Sequence[Line]) -> None:
        for module in (lines, all_lines):
            monkeypatch.setattr(module, "lines_at", lambda *_, **__: (tuple(group),))

    chosen(GROUP[:1])
    return chosen


@pytest.fixture(autouse=True)
def _one_line(choose: Callable[[Sequence[Line]], None]) -> None:
    """Every junction has one line of starts."""


def test_json_has_an_entry_per_order_of_a_line(make: Make, capsys: Read) -> None:
    with judged_by(colliding, make):
        assert main([*CRITICAL, "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert (result["version"], result["rules"]) == (1, ["no_collision"])
    goes, waits = result["lines"]
    for entry in (goes, waits):
        assert (entry["junction"], entry["ways"], entry["seat"]) == ("stop3", ["0->1", "2->1"], 0)
        assert entry["decided_by"] == "all-way stop"
    assert [entry["order"] for entry in (goes, waits)] == ["goes", "waits"]
    assert [entry["critical_start"]["lead"] for entry in (goes, waits)] == [0.5, 0.49]
    assert [entry["status"] for entry in (goes, waits)] == ["FAIL", "PASS"]
    assert [entry["rule"] for entry in (goes, waits)] == ["no_collision", ""]
    assert [entry["fault"] for entry in (goes, waits)] == ["too bold", None]
    assert goes["failed_start"] == goes["critical_start"]
    start = goes["critical_start"]
    # At 8 m/s the vehicle that is nearer starts 20 m before its line, and 0.5 s are 4 m.
    assert (start["distances"], start["speeds"]) == ([20.0, 24.0], [8.0, 8.0])
    assert from_id(start["id"]) == GROUP[0].scenario(TURN)
    assert goes["rerun"] == f"rvads critical stop3 --autopilot reference --rules no_collision --start {start['id']}"
    assert waits["rerun"] == ""


def test_table_names_the_failure_and_the_command_that_shows_it_again(make: Make, capsys: Read) -> None:
    with judged_by(colliding, make):
        assert main(CRITICAL) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("stop3: 1 line of starts, ")
    assert lines[2].split() == ["0->1", "2->1", "all-way", "stop", "goes", "+0.50", "s", "FAIL", "no_collision,", "too", "bold"]
    assert lines[3].split() == ["0->1", "2->1", "all-way", "stop", "waits", "+0.49", "s", "PASS"]
    assert "stop3: 0->1 meets 2->1, too bold: no_collision FAIL, lead +0.50 s" in lines
    assert lines[-2] == "no_collision is judged FAIL"
    assert lines[-1].startswith("rerun     rvads critical stop3 --autopilot reference --rules no_collision --start stop3-")


def test_lines_that_are_equal_up_to_a_rotation_are_one_row(
    make: Make, capsys: Read, choose: Callable[[Sequence[Line]], None]
) -> None:
    choose(lines_at(rvads.find("stop4"))[0])
    with judged_by(passing, make):
        assert main(["critical", "stop4", *CRITICAL[2:]]) == 0
    head, _, *rows = capsys.readouterr().out.splitlines()
    assert head.startswith("stop4: 4 lines of starts, ")
    assert [row.split()[4:] for row in rows] == [
        [order, lead, "s", "PASS,", "as", "on", "3", "similar", "lines"]
        for order, lead in (("goes", "+0.50"), ("waits", "+0.49"))
    ]


def test_line_from_rest_is_named_in_table_and_json(make: Make, capsys: Read, choose: Callable[[Sequence[Line]], None]) -> None:
    line = lines_at(rvads.find("stop3"))[1][0]
    choose([line])
    with judged_by(colliding, make):
        assert main(CRITICAL) == 1
        lines = capsys.readouterr().out.splitlines()
        assert main([*CRITICAL, "--json"]) == 1
    assert lines[2].startswith("0->1 from rest    2->1     all-way stop")
    assert "stop3: 0->1 from rest meets 2->1, too bold: no_collision FAIL, lead +0.50 s" in lines
    goes, _ = json.loads(capsys.readouterr().out)["lines"]
    assert (goes["ways"], goes["from_rest"], goes["critical_start"]["lead"]) == (["0->1", "2->1"], True, 0.5)
    # The other vehicle comes at a fifth of 8 m/s, since 0.5 s are a fifth of the 2.5 s for the nearest start at 8 m/s.
    assert (goes["critical_start"]["distances"], goes["critical_start"]["speeds"]) == ([0.01, 0.8], [0.0, 1.6])
    assert from_id(goes["critical_start"]["id"]) == line.scenario(TURN)


@pytest.mark.extended
def test_pedestrian_takes_the_place_of_the_other_vehicle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Read, choose: Callable[[Sequence[Line]], None]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("holding.py").write_text(
        "import pytest_rvads as rvads\n\nclass Holds:\n    def control(self, seen):\n        return rvads.Acceleration(0.0)\n"
    )
    groups = lines_at(rvads.find("zebra4"), [0], ["steady"])
    choose([line for group in groups for line in group if line.id == "zebra4-s0-0to2-meets-0n.steady"])
    walked = ("zebra4", "--pedestrians", "steady", "--autopilot", "holding:Holds", *RULES)
    main(["critical", *walked])
    heading, row = capsys.readouterr().out.splitlines()[1:3]
    assert row.split()[:2] == ["0->2", "0n.steady"]
    assert row.index("subject gives way") == heading.index("decided by")
    main(["critical", *walked, "--json"])
    goes, _ = json.loads(capsys.readouterr().out)["lines"]
    assert (goes["ways"], goes["from_rest"], goes["decided_by"]) == (["0->2", "0n.steady"], False, "subject gives way")
    start = goes["critical_start"]
    assert (start["distances"], start["speeds"]) == ([20.0], [8.0]), "of the only vehicle"
    assert from_id(start["id"]).pedestrians[0].difference == start["lead"]
    main(["critical", *walked, "--start", start["id"]])
    assert f"p0 steady from the near side of crosswalk 0, {abs(start['lead']):g} s" in capsys.readouterr().out
    main(["critical", *walked, "--all-lines", "--probes", "2", "--json", "-o", "lines.html"])
    (certificate,) = json.loads(capsys.readouterr().out)["atlases"]
    ((strip,),) = certificate["groups"]
    assert (certificate["pedestrians"], strip["title"]) == (["steady"], "0->2 meets 0n.steady")
    turn = next(piece["from"] for piece in strip["pieces"] if piece["order"] == "goes")
    assert turn == start["lead"], "both searches find the same turn"
    assert "the arrival of the pedestrian minus" in Path("lines.html").read_text()


@pytest.mark.parametrize(("answer", "status"), [(passing, 0), (colliding, 1), (not_asked, 5)])
def test_exit_status_is_that_of_the_critical_starts(make: Make, answer: Any, status: int) -> None:
    with judged_by(answer, make):
        assert main([*CRITICAL, "--json"]) == status


def test_exit_status_is_5_if_no_start_has_room(capsys: Read, choose: Callable[[Sequence[Line]], None]) -> None:
    (line, *_) = GROUP
    lanes = tuple(replace(lane, setback=lane.approach.length) for lane in line.place.entrances if lane.approach)
    choose([replace(line, place=replace(line.place, entrances=lanes))])
    assert main([*CRITICAL, "--json"]) == 5
    out, err = capsys.readouterr()
    assert "rvads: no start could be simulated: distance" in err
    assert all("does not fit on entrance" in entry["unfit"] for entry in json.loads(out)["lines"])
    main(CRITICAL)
    rows = [row.split()[4:] for row in capsys.readouterr().out.splitlines()[2:]]
    assert rows == [[order, "-", "no", "room", "where", "a", "vehicle", "starts"] for order in ("goes", "waits")]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("critical", "stop5", "--autopilot", "reference"), r"'stop5' is no built-in junction \(.*stop4.*\) and no file"),
        (("critical", "stop3", "--autopilot", "reference", "--junction", "1"), "--junction names a junction of a map"),
        (("critical", "stop3", "--autopilot", "reference", "--rules", "no_colision"), "did you mean 'no_collision'"),
        (
            ("critical", "stop3", "--autopilot", "reference", "-o", "replay.html"),
            "-o writes the replay of one start, .* give --start",
        ),
        (("critical", "stop3"), "no driver is named"),
        (("critical", "stop3", "--autopilot", "referense"), "did you mean 'reference'"),
        (("critical", "stop3", "--autopilot", "reference", "-j", "0"), "--workers must be at least 1, got 0"),
        (("critical", "stop3", "--autopilot", "reference", "--start", "nonsense"), "'nonsense' is no id of a scenario"),
        ((*CRITICAL, "--start", ""), "--start needs a value, got ''"),
        ((*CRITICAL, "--start="), "--start needs a value, got ''"),
        (("critical", "stop3", "--all-lines", "--autopilot", "reference", "-o", ""), "-o needs a value, got ''"),
        (("critical", STOP4, "--autopilot", "reference", "--junction", ""), "--junction needs a value, got ''"),
        (("critical", "stop3", "--sut", "./no_such_program"), "--sut must be the command of a program that exists"),
        (("dynamics", "--sut", "no_such_program"), "--sut must be the command of a program that exists"),
        (("dynamics", "pedals", "--sut", "no_such_program"), "--sut must be the command of a program that exists"),
        (("critical", "stop5", "--autopilot", "reference", "--start", START), "'stop5' is no built-in junction"),
        (("critical", "stop4", "--autopilot", "reference", "--start", START), "--start is at junction 'stop3', .* names 'stop4'"),
        ((*CRITICAL, "--start", START, "--json"), "--json prints lines of starts, .* leave one of the two out"),
        ((*CRITICAL, "--pedestrians", "stedy"), "pedestrians have the behaviours .* did you mean 'steady'"),
        (("critical", STOP4, "--autopilot", "reference", "--pedestrians", "stedy"), "did you mean 'steady'"),
        (
            ("critical", STOP4, "--all-lines", "--autopilot", "reference", "-o", "/"),
            "-o must name a file to write, got '/', .*: name another file",
        ),
        (("critical", "stop5", "--all-lines", "--autopilot", "reference"), "'stop5' is no built-in junction"),
        (("critical", "stop3", "--autopilot", "reference", "--probes", "-1"), "--probes must be a number .* got -1"),
        (("dynamics",), "no driver is named"),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(capsys: Read, arguments: Sequence[str], message: str) -> None:
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert re.search(message, err)


@pytest.mark.parametrize("option", [(), ("--all-lines",)])
def test_map_without_a_line_of_starts_is_refused(option: tuple[str, ...], capsys: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lines, "lines_at", lines_at)
    assert main(["critical", STOP4, *option, "--autopilot", "reference", "--pedestrians", "steady"]) == 2
    reason, refused = capsys.readouterr().err.splitlines()
    assert "no way of junction 'stop4.1' from seats [0, 1, 2, 3] gives way to pedestrians" in reason
    assert refused == f"rvads: {STOP4} has no junction with a line of starts, for the reasons above: use another map"


@pytest.fixture
def interrupted(make: Make) -> Iterator[None]:
    """Starts with entrance 0 as the seat collide; Ctrl-C interrupts the first run with another seat."""
    with judged_by(colliding, make), pytest.MonkeyPatch.context() as patch:
        judged = Setting.judged

        def once(self: Setting, scenario: rvads.Scenario) -> object:
            if scenario.subject:
                raise KeyboardInterrupt
            return judged(self, scenario)

        patch.setattr(Setting, "judged", once)
        yield


@pytest.mark.usefixtures("interrupted")
def test_interrupted_search_shows_the_lines_before(capsys: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lines, "lines_at", lambda *_, **__: (GROUP[:1], GROUP[1:]))
    assert main(CRITICAL) == 130
    out, err = capsys.readouterr()
    assert out.startswith("stop3: 1 line of starts, ")
    assert "stop3: 0->1 meets 2->1, too bold: no_collision FAIL, lead +0.50 s" in out.splitlines()
    assert err.splitlines()[-2:] == [
        "rvads: INCOMPLETE: 1 of 3 lines of starts at stop3 were searched",
        "rvads: interrupted",
    ]
    assert main([*CRITICAL, "--json"]) == 130
    result = json.loads(capsys.readouterr().out)
    assert [(entry["seat"], entry["status"]) for entry in result["lines"]] == [(0, "FAIL"), (0, "PASS")]
    assert result["complete"] is False


@pytest.mark.usefixtures("interrupted")
def test_interrupted_search_of_all_lines_has_the_junctions_before(
    tmp_path: Path, capsys: Read, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(all_lines, "lines_at", lambda place, **_: (GROUP[:1] if place.name == "stop3" else GROUP[1:],))
    monkeypatch.setattr(critical_command, "_places", lambda _: map(rvads.find, ("stop3", "stop4")))
    page = tmp_path / "lines.html"
    assert main([*CRITICAL, "--all-lines", "--probes", "0", "-o", str(page), "--json"]) == 130
    out, err = capsys.readouterr()
    assert [certificate["junction"] for certificate in json.loads(out)["atlases"]] == ["stop3"]
    assert "no_collision FAIL from +0.50 to +0.99 s" in page.read_text("utf-8")
    assert err.splitlines()[-2:] == [
        "rvads: INCOMPLETE: the search ended before junction stop4",
        "rvads: interrupted",
    ]


def rows(page: str) -> list[tuple[str, str]]:
    """The starts and verdicts in the tables of what is broken."""
    return re.findall(r"<tr>\n<th[^>]*>(.*?)\n<td[^>]*>(.*?)\n", page)


def test_page_repeats_a_failing_start_of_every_row(make: Make, tmp_path: Path, choose: Callable[[Sequence[Line]], None]) -> None:
    choose(GROUP)
    page = tmp_path / "lines.html"
    with judged_by([passing, colliding, colliding], make):
        main([*CRITICAL, "--all-lines", "--probes", "0", "-o", str(page)])
    text = page.read_text("utf-8")
    assert text.count('<rect class="band') == 2 + 3, "the strips of the two colliding seats share a row"
    assert rows(text) == [("1-&gt;2 meets 0-&gt;2", "no_collision FAIL from +0.50 to +0.99 s")]


def test_one_start_prints_its_verdicts_and_writes_its_replay(tmp_path: Path, capsys: Read) -> None:
    page = tmp_path / "replay.html"
    scenario = GROUP[0].scenario(-50)
    assert main([*CRITICAL, "--start", scenario.name, "-o", str(page)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == scenario.describe()
    assert lines[1].startswith("no_collision PASS")
    assert lines[2:] == [f"wrote {page}"]
    assert "no_collision PASS" in page.read_text("utf-8")


class Dividing(rvads.Reference):
    """Raises an error 0.5 s after the start."""

    def control(self, seen: rvads.Observation, /) -> Any:
        return 1 / 0 if seen.time > 0.5 else super().control(seen)


def test_one_start_with_a_fault_of_the_driver_tells_the_fault_once(capsys: Read) -> None:
    line = ("critical", "stop3", "--autopilot", f"{__name__}:Dividing", "--rules", "no_collision", "full_stop", "-j", "1")
    assert main([*line, "--start", GROUP[0].scenario(-50).name]) == 1
    described, fault, *more = capsys.readouterr().out.splitlines()
    assert described == GROUP[0].scenario(-50).describe()
    assert re.fullmatch(r"ERROR: Dividing driving a0 raised ZeroDivisionError: .* at 0\.51 s", fault)
    assert more == []


def test_one_start_with_an_error_of_a_rule_tells_the_other_verdicts(capsys: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown_light(run: Run, rule: rvads.Rule) -> rvads.Verdict:
        if rule.name == "full_stop":
            raise rvads.errors.RunError("the run records no signs")
        return check(run, rule)

    monkeypatch.setattr("pytest_rvads.logic.check.check", unknown_light)
    line = ("critical", "stop3", "--autopilot", "reference", "--rules", "full_stop", "no_collision", "-j", "1")
    assert main([*line, "--start", GROUP[0].scenario(-50).name]) == 1
    _, error, passed = capsys.readouterr().out.splitlines()
    assert error == "full_stop ERROR: the run records no signs"
    assert passed.startswith("no_collision PASS")


def test_one_start_that_no_rule_is_about_has_exit_status_5(capsys: Read) -> None:
    line = ("critical", "stop3", "--autopilot", "reference", "--rules", "yield_sign", "-j", "1")
    assert main([*line, "--start", GROUP[0].scenario(-50).name, "-o", "replay.html"]) == 5
    assert "none of the rules is about junction 'stop3': choose others by --rules" in capsys.readouterr().err


def test_page_with_an_error_on_a_line_draws_the_other_lines(
    make: Make, tmp_path: Path, capsys: Read, choose: Callable[[Sequence[Line]], None]
) -> None:
    choose(GROUP)
    page = tmp_path / "lines.html"
    with judged_by(colliding, make), pytest.MonkeyPatch.context() as patch:
        judged = Setting.judged

        def divides_by_zero(self: Setting, scenario: rvads.Scenario) -> object:
            if scenario.subject == 0:
                raise rvads.errors.RunError("the driver divides by zero")
            return judged(self, scenario)

        patch.setattr(Setting, "judged", divides_by_zero)
        command = [*CRITICAL, "--all-lines", "--probes", "40", "-o", str(page)]
        assert main([*command, "--json"]) == 1
        failing, *others = json.loads(capsys.readouterr().out)["atlases"][0]["groups"][0]
        assert main(command) == 1
    assert (failing["error"], failing["pieces"]) == ("the driver divides by zero", [])
    assert [(strip["error"], len(strip["pieces"])) for strip in others] == [("", 3)] * len(others)
    summary, told, *_ = capsys.readouterr().out.splitlines()
    count = sum(len(strip["simulated"]) for strip in others)
    assert f"{count} starts simulated, {len(others) * 1201 - count:,} inferred; 0 of 40 random starts differ" in summary
    assert told == "stop3: 0->1 meets 2->1: ERROR: the driver divides by zero"
    text = page.read_text("utf-8")
    assert text.count('<rect class="band') == 3, "the other lines are equal and share a row"
    assert rows(text)[0] == ("0-&gt;1 meets 2-&gt;1", "ERROR: the driver divides by zero")


def test_all_lines_write_a_page_and_a_certificate(make: Make, tmp_path: Path, capsys: Read) -> None:
    page = tmp_path / "lines.html"
    with judged_by(colliding, make):
        command = [*CRITICAL, "--all-lines", "--probes", "40", "-o", str(page)]
        assert main([*command, "--json"]) == 0
        certificates = json.loads(capsys.readouterr().out)
        assert main(command) == 0
    out = capsys.readouterr().out.splitlines()
    assert certificates["version"] == 1
    (certificate,) = certificates["atlases"]
    ((strip,),) = certificate["groups"]
    assert certificate["driver"] == "reference"
    assert certificate["digest"] == rvads.find("stop3").digest
    assert (certificate["probes"], certificate["differing"]) == (40, [])
    spans = [(piece["from"], piece["to"], piece["order"], piece["status"], piece["rule"]) for piece in strip["pieces"]]
    assert spans == [
        (-6.0, 0.49, "waits", "PASS", ""),
        (0.5, 0.99, "goes", "FAIL", "no_collision"),
        (1.0, 6.0, "goes", "PASS", ""),
    ]
    # There are 1,201 starts from -6 to 6 s in steps of 0.01 s; each is either simulated or inferred.
    count = len(strip["simulated"])
    assert certificate["summary"] == out[0]
    assert out[0] == (
        f"stop3: 1 line of starts, {count} starts simulated, {1201 - count:,} inferred; 0 of 40 random starts differ"
    )
    assert {-6.0, 0.49, 0.5, 0.99, 1.0, 6.0} <= set(strip["simulated"])
    assert strip["pieces"][1]["rerun"].startswith(
        "rvads critical stop3 --autopilot reference --rules no_collision --start stop3-"
    )
    assert out[1:] == [f"wrote {page}"]
    text = page.read_text("utf-8")
    assert text.count('<rect class="band') == 3
    assert "0-&gt;1 meets 2-&gt;1" in text
    assert "no_collision FAIL from +0.50 to +0.99 s" in text


def test_differing_probe_has_exit_status_1(make: Make, tmp_path: Path, capsys: Read) -> None:
    def narrow(lead: int) -> tuple[bool, Mapping[str, Status]]:
        """Fail between two starts of the grid, 0.00 and 0.50 s."""
        return False, {"no_collision": Status.FAIL if 5 <= lead < 45 else Status.PASS}

    with judged_by(narrow, make):
        assert main([*CRITICAL, "--all-lines", "-o", str(tmp_path / "lines.html"), "--json"]) == 1
    (certificate,) = json.loads(capsys.readouterr().out)["atlases"]
    assert certificate["probes"] == 250
    assert certificate["differing"]
    for probe in certificate["differing"]:
        assert probe["line"] == "stop3: 0->1 meets 2->1"
        assert 0.05 <= probe["lead"] < 0.45


def test_page_of_all_lines_does_not_depend_on_when_it_is_written(make: Make, tmp_path: Path) -> None:
    pages = [tmp_path / name for name in ("a.html", "b.html")]
    for page in pages:
        with judged_by(colliding, make):
            main([*CRITICAL, "--all-lines", "--probes", "0", "-o", str(page)])
    assert pages[0].read_bytes() == pages[1].read_bytes()


class Uniform:
    """Brakes at 4 m/s^2, but not from more than 12 m/s, and accelerates at 2 m/s^2 without a limit."""

    def braking(self, speed: float) -> float:
        return speed**2 / 8 if speed <= 12.0 else math.inf

    def driving(self, speed: float, distance: float) -> tuple[float, float]:
        after = math.sqrt(speed**2 + 4 * distance)
        return after, (after - speed) / 2


def test_dynamics_are_a_table_json_and_a_drawing(tmp_path: Path, capsys: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driver_dynamics, "Measured", lambda *_: Uniform())
    drawing = tmp_path / "dynamics.svg"
    assert main(["dynamics", "--autopilot", "reference", "--json", "--svg", str(drawing)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["version"], result["B"][result["speeds"].index(8.0)]) == (1, 8.0)
    row, column = result["speeds"].index(8.0), result["distances"].index(24.0)
    assert result["AV"][row][column] == pytest.approx(math.sqrt(160.0), abs=0.001)
    assert result["AT"][row][column] == pytest.approx((math.sqrt(160.0) - 8.0) / 2, abs=0.001)
    crossing, lights, _ = (entry for entry in result["settings"]["rows"] if entry["speed"] == 8.0)
    # The vehicle starts 8 m before a junction of 24 m; a vehicle at sqrt(192) m/s does not stop any more.
    across = (math.sqrt(192.0) - 8.0) / 2 * result["settings"]["limit"]
    assert crossing == {"speed": 8.0, "vista": "crossing with yield signs", "xe": 8.0, "xf": None, "xa": round(across, 3)}
    assert lights == {"speed": 8.0, "vista": "crossing with lights", "xe": 8.0, "xf": None, "xa": None}
    words = [node.text for node in ElementTree.parse(drawing).getroot().iter("{http://www.w3.org/2000/svg}text")]
    assert {"dynamics of reference", "speed v [m/s]", "from 8 m/s"} <= set(words)

    assert main(["dynamics", "--autopilot", "reference"]) == 0
    table = capsys.readouterr().out.splitlines()
    numbers = [8.0, *result["AV"][row], *result["AT"][row]]
    assert table[1 + row].split() == ["8", *(f"{value:.2f}" for value in numbers)]
    assert ["8", "crossing", "with", "yield", "signs", "8.00", "never", f"{across:.2f}"] in [line.split() for line in table]
    assert table[-1].endswith("LGSVL 39.7 m, Apollo 120 m, Autoware 165 m, CARLA 72.2 m")

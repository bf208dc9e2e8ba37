"""The pages of ``rvads check``: the replays of tests, and of recorded traffic what matters, on the clock of the log."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.report.failures import failure_picture, moment
from pytest_rvads.report.scene import picture
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording, Track
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import save_run
from pytest_rvads.runs.states import Agent
from pytest_rvads.satellites.pages.replay import events, failure_pages

Make = Callable[..., Run]
RUN = ("dt", "start", "opened", "agents", "motion", "zones", "lights", "tracks", "responsible", "marked", "events")
"""What a page is given of the run and of the rule, whoever draws it."""
START, SPEED, ROAD = 86_400.0, 5.0, 60.0


def data(page: str) -> dict[str, Any]:
    """What the script of a page is given, which JSON has to hold: a browser reads no NaN."""
    (text,) = re.findall('<script type="application/json" id="data">(.*)</script>', page)
    found: dict[str, Any] = json.loads(text, parse_constant=pytest.fail)
    return found


def items(index: Path) -> list[dict[str, Any]]:
    """Return what the page of the verdicts is given of each item."""
    found: list[dict[str, Any]] = data(index.read_text(encoding="utf-8"))["items"]
    return found


def links(index: Path) -> list[tuple[str, float]]:
    """Return the names of the pages that the page of the verdicts leads to, and the times at which they open [s]."""
    found = [link.split("#t=") for item in items(index) for link in (item["look"], *item["more"]) if link]
    return [(name, float(time)) for name, time in found]


@pytest.fixture(scope="module")
def traffic() -> Run:
    """A busy period of a log that begins at midnight: a car every 4 s drives through stop4 straight on without stopping."""
    place = find("stop4")
    way = Itinerary.through(place, 0, place.leads(0, 2).exit)
    tracks = []
    for number in range(20):
        times = START + 4.0 * number + np.arange(0.0, (ROAD + way.end) / SPEED, 0.1)
        station = SPEED * (times - times[0]) - ROAD
        pose = np.array([way.pose(float(s)) for s in station])
        agent = Agent(f"v{number}", place.movements[0, place.leads(0, 2).exit], size=(4.6, 1.8))
        tracks.append(Track(agent, times, station, np.full(len(times), SPEED), pose))
    (run,) = Recording("log", place, tuple(tracks))
    return run


@pytest.mark.extended
def test_the_page_is_that_of_a_test(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    pytester.makepyfile(
        test_it="""
        import pytest_rvads as rvads
        import pytest

        @pytest.fixture
        def rvads_autopilot():
            return rvads.RollingStop

        @rvads.scenario("stop4", classes=7, distances=(10, 11, 12, 13), rules="p3")
        def test_rules(run, rule, monitor):
            monitor.check(rule)
        """
    )
    pytester.runpytest("--rvads-keep=kept").assert_outcomes(failed=1)
    assert main(["check", "kept", "--rules", "p3", "-o", "pages"]) == 1
    (tested,) = (pytester.path / ".rvads" / "1").glob("test_it*.html")
    ((name, time),) = links(pytester.path / "pages" / "index.html")
    checked = (pytester.path / "pages" / name).read_text(encoding="utf-8")
    shown = data(tested.read_text(encoding="utf-8"))
    assert {key: data(checked)[key] for key in RUN} == {key: shown[key] for key in RUN}
    assert data(checked)["marked"] == [pytest.approx(time, abs=0.005)]
    block = checked[checked.index("<pre>") :]
    assert "violated" in block
    assert "rerun     rvads check " in block


@pytest.mark.extended
def test_traffic_is_shown_around_each_violation_with_the_time_of_the_log(
    traffic: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_run(traffic, tmp_path / "busy.npz")
    assert main(["check", str(tmp_path / "busy.npz"), "--rules", "full_stop", "-o", str(tmp_path / "pages")]) == 1
    # v0 has driven 60 m at 5 m/s when it comes to the entrance; the others follow every 4 s.
    violated = START + ROAD / SPEED + 4.0 * np.arange(20)
    assert f"at t={violated[0]:.2f}"[:-1] in capsys.readouterr().out
    pages = links(tmp_path / "pages" / "index.html")
    covered = np.zeros(20, dtype=bool)
    for name, time in pages:
        text = (tmp_path / "pages" / name).read_text(encoding="utf-8")
        held = data(text)
        end = held["start"] + (held["steps"] - 1) * held["dt"]
        assert held["start"] == pytest.approx(max(time - 30.0, START), abs=0.02)
        assert end == pytest.approx(min(time + 10.0, traffic.start + traffic.duration), abs=0.02)
        assert held["opened"] == held["marked"][0] == pytest.approx(time, abs=0.006)
        told = [moment for moment, _, marked in held["events"] if marked]
        inside = (violated > held["start"]) & (violated < end)
        assert told == pytest.approx(violated[inside], abs=0.03)
        covered |= inside
        who = np.abs(violated - time).argmin()
        assert held["responsible"] == [f"v{who}"]
    assert covered.all()
    assert len(pages) == pytest.approx((violated[-1] - violated[0]) / 10.0, abs=2), "none shows what an earlier one has shown"


@pytest.mark.extended
def test_who_is_not_there_is_not_on_the_page(traffic: Run) -> None:
    verdict = check(traffic, "full_stop")
    first, *_ = failure_pages(traffic, verdict, "full_stop", "")
    held = data(first.html)
    # It opens at 12 s and ends at 22 s: v5 has come at 20 s, v6 comes at 24 s.
    assert held["agents"] == [f"v{n}" for n in range(6)]
    motion = held["motion"]
    for number in range(6):
        there = [row[number] is not None for row in motion]
        came = there.index(True)
        assert came * held["every"] * held["dt"] == pytest.approx(4.0 * number, abs=0.06)
        assert all(there[came:]), "all of them are on their way when it ends"
        *_, station, speed = motion[-1][number]
        assert (station, speed) == (pytest.approx(SPEED * (22.0 - 4.0 * number) - ROAD, abs=0.3), SPEED)


def test_a_page_of_dense_traffic_stays_small(traffic: Run) -> None:
    # Forty vehicles all the while, as many as ever are near a junction.
    crowd = {name: np.repeat(getattr(traffic, name)[:, :1], 40, axis=1) for name in ("zone", "station", "speed", "pose")}
    here = slice(*traffic.spans[0].tolist())
    longer: dict[str, Any] = {name: np.concatenate([values[here]] * 5) for name, values in crowd.items()}
    agents = tuple(replace(traffic.agents[0], name=f"track {n:04d}") for n in range(40))
    steps = len(longer["zone"])
    run = replace(traffic, agents=agents, lights=np.zeros((steps, 4), np.int8), collisions=(), **longer)
    instance = InstanceVerdict((("a", agents[3].name),), Status.FAIL, (agents[3].name,), 40, steps // 2, (), None)
    verdict = Verdict("p1", Status.FAIL, "p1", instances=(instance,), time=run.start + steps // 2 * run.dt, start=run.start)
    (page,) = failure_pages(run, verdict, "p1", "")
    assert run.duration > 100.0
    assert len(page.html) < 2_000_000


def test_nobody_is_seen_to_come_where_a_page_begins(traffic: Run) -> None:
    told = [text for _, text in events(traffic)]
    assert sum(text.endswith("enters the junction") for text in told) == 20
    cut = replace(
        traffic,
        **{name: getattr(traffic, name)[1400:] for name in ("zone", "station", "speed", "pose", "lights")},
        excerpt=replace(traffic.excerpt, start=START + 14.0),
    )
    assert cut.zone[0, 0] == 2, "v0 is in the junction"
    entered = [(time, text) for time, text in events(cut) if text.endswith("enters the junction")]
    assert len(entered) == 19
    assert entered[0][0] == pytest.approx(START + ROAD / SPEED + 4.0, abs=0.02)


def test_the_picture_is_of_the_instant_in_the_log(traffic: Run) -> None:
    verdict = check(traffic, "full_stop")
    assert moment(traffic, verdict) == pytest.approx(START + ROAD / SPEED, abs=0.02)
    drawn = failure_picture(traffic, verdict)
    assert drawn == picture(traffic, round(ROAD / SPEED / traffic.dt) + 1, verdict.message, verdict.responsible)
    assert "nan" not in drawn
    ET.fromstring(drawn)


def test_what_is_unsure_is_shown_at_what_it_hangs_on(traffic: Run) -> None:
    binding = (("a", "v2"), ("a'", "v3"))
    instance = InstanceVerdict(binding, Status.UNSURE, (), None, 2000, (), None, "v2 crossed its line within 0.10 m of v3")
    verdict = Verdict("p3", Status.UNSURE, "p3 UNSURE: 1 of 1", instances=(instance,), dt=traffic.dt, start=traffic.start)
    (page,) = failure_pages(traffic, verdict, "p3", "")
    assert page.time == START + 20.0
    assert [text for _, text, marked in data(page.html)["events"] if marked] == [
        "p3 UNSURE: v2, v3, v2 crossed its line within 0.10 m of v3"
    ]


def test_without_positions_the_index_explains(make: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 30, 150, 300)}, 400)
    save_run(replace(run, label="<b>drive</b>"), tmp_path / "run.npz")
    assert main(["check", str(tmp_path / "run.npz"), "--rules", "p1", "-o", str(tmp_path / "pages")]) == 1
    assert [path.name for path in (tmp_path / "pages").iterdir()] == ["index.html"]
    (item,) = items(tmp_path / "pages" / "index.html")
    assert "holds no positions, so there is nothing to replay" in item["why"]
    assert "recorded  " in item["why"]
    assert item["id"] == "<b>drive</b>-p1"
    assert "<b>" not in (tmp_path / "pages" / "index.html").read_text(encoding="utf-8")


def test_an_index_is_written_whatever_ends_it(
    make: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = make("stop4", {0: (2, 10, 50, 200), 1: (2, 30, 150, 300)}, 400)
    for name in ("one", "two"):
        save_run(replace(run, label=name), tmp_path / f"{name}.npz")

    def interrupted(run: Run, rule: Any) -> Verdict:
        if run.label == "two":
            raise KeyboardInterrupt
        return check(run, rule)

    monkeypatch.setattr("pytest_rvads.logic.check.check", interrupted)
    assert main(["check", str(tmp_path), "--rules", "p1", "-o", str(tmp_path / "pages")]) == 130
    assert "1 verdict on 1 run: 1 fail" in (tmp_path / "pages" / "index.html").read_text(encoding="utf-8")
    assert "INCOMPLETE" in (tmp_path / "pages" / "index.html").read_text(encoding="utf-8")
    assert len(items(tmp_path / "pages" / "index.html")) == 1


def test_a_folder_that_can_not_be_made_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["check", str(tmp_path / "none.npz"), "-o", str(tmp_path / "file" / "pages")]) == 2
    assert capsys.readouterr().err == (
        f"rvads: -o must name a folder to write to, got '{tmp_path}/file/pages', which can't be made (Not a directory): name "
        "another folder\n"
    )

"""Runs as trajectories: what comes back is judged as what went out."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.errors import MapError, RunError, RvadsError
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.book import rulebook
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.states import Colour, Zone

from .failures import FAILURES, TRUCK, Failure

pytestmark = pytest.mark.usefixtures("library")


def judged(run: rvads.Run) -> dict[str, Any]:
    """Return all that the rules of both books say of a run, but for the rounding of margins."""

    def told(verdict: Verdict) -> tuple[Any, ...]:
        each = [(i.binding, i.status, i.responsible, i.trigger, i.failed, i.broken) for i in verdict.instances]
        return verdict.status, verdict.time, verdict.message, dict(verdict.counts), each

    return {rule.name: told(rvads.check(run, rule)) for book in ("paper", "road") for rule in rulebook(book)}


def again(run: rvads.Run, folder: Path) -> rvads.Run:
    rvads.export_run(run, folder / "run.xosc")
    (found,) = rvads.read_runs(folder / "run.xosc")
    return found


@pytest.mark.extended
@pytest.mark.parametrize("failure", FAILURES, ids=str)
def test_a_failure_is_read_back_with_the_verdict_that_it_failed_with(failure: Failure, maps: Path, tmp_path: Path) -> None:
    run = failure.run(maps)
    assert rvads.check(run, failure.rule).status in (Status.FAIL, Status.OPEN)
    found = again(run, tmp_path)
    assert (found.label, found.junction, found.agents, found.facts) == (run.label, run.junction, run.agents, run.facts)
    assert (found.collisions, found.steps, found.dt) == (run.collisions, run.steps, run.dt)
    assert np.array_equal(found.zone, run.zone)
    assert np.array_equal(found.lights, run.lights)
    assert np.abs(found.station - run.station).max() < 1e-9
    assert np.abs(found.pose[run.here] - run.pose[run.here]).max() < 1e-9
    assert np.abs(found.speed - run.speed)[run.here].max() < 0.02  # tyres slip a little where bodies turn
    assert judged(found) == judged(run)


def test_there_are_as_many_failures_as_are_promised() -> None:
    assert len(FAILURES) >= 20
    assert len({failure.junction for failure in FAILURES}) >= 8


def test_equal_runs_give_equal_files(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[8].run(maps)
    rvads.save_run(run, tmp_path / "kept.npz")
    rvads.export_run(run, tmp_path / "one" / "run.xosc")
    rvads.export_run(rvads.load_run(tmp_path / "kept.npz"), tmp_path / "two" / "run.xosc")
    for name in ("run.xosc", "light4.xodr"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_the_verdict_stands_in_the_file(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[1].run(maps)
    verdict = rvads.check(run, "p2")
    rvads.export_run(run, tmp_path / "run.xosc", verdict=verdict)
    head = (tmp_path / "run.xosc").read_text("utf-8")[:3000]
    assert f'description="{run.label}: {verdict.message}"' in head
    assert "&quot;rule&quot;:&quot;p2&quot;,&quot;status&quot;:&quot;FAIL&quot;" in head


def test_who_stands_costs_no_vertices(maps: Path, tmp_path: Path) -> None:
    run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("light4"), "0200", distance=5, duration=10.0), rvads.Reference))
    found = again(run, tmp_path)
    vertices = (tmp_path / "run.xosc").read_text("utf-8").count("<Vertex")
    stands = int((np.diff(run.pose[:, 0], axis=0) == 0.0).all(axis=1).sum())
    assert stands > 500  # the light is red for 20 s
    assert vertices < run.steps - stands + 20
    assert np.abs(found.station - run.station).max() < 1e-9


def test_who_is_through_leaves(tmp_path: Path) -> None:
    scenario = rvads.Scenario(rvads.find("stop4"), "2020", distance=(1, 0, 40, 0), speed=(10, 0, 0, 0), duration=20.0)
    run = rvads.simulate(rvads.Case(scenario, traffic("red_light_runner")))
    gone = np.flatnonzero(run.zone[:, 0] == Zone.GONE)
    assert 0 < gone[0] < run.steps - 100
    assert not (run.zone[:, 1] == Zone.GONE).any()
    found = again(run, tmp_path)
    assert np.array_equal(found.zone, run.zone)
    text = (tmp_path / "run.xosc").read_text("utf-8")
    assert re.findall(r'<DeleteEntityAction|<EntityAction entityRef="(a\d)">\s*<DeleteEntityAction', text) == ["a0"]
    time = re.search(r'<Event name="a0 leaves".*?<SimulationTimeCondition value="([^"]*)"', text, re.DOTALL)
    assert float(time[1]) == pytest.approx(gone[0] * run.dt)


def test_the_reference_point_is_the_rear_axle(maps: Path, tmp_path: Path) -> None:
    failure = next(failure for failure in FAILURES if failure.truck == "a1")
    run = failure.run(maps)
    rvads.export_run(run, tmp_path / "run.xosc")
    text = (tmp_path / "run.xosc").read_text("utf-8")
    entity = text[text.index('<ScenarioObject name="a1"') :]
    x = float(re.search(r'<Center x="([\d.]+)"', entity)[1])
    assert 'vehicleCategory="truck"' in entity[:400]
    assert x + TRUCK.length / 2 == pytest.approx(TRUCK.rear_axle_offset)
    assert f'positionX="{TRUCK.wheelbase}"' in entity[:2000]
    teleport = re.search(r'entityRef="a1">.*?<WorldPosition x="(\S+)" y="(\S+)" h="(\S+)"', text, re.DOTALL)
    column = [agent.name for agent in run.agents].index("a1")
    front, place = run.pose[0, column], np.array(list(map(float, teleport.groups())))
    assert np.hypot(*(front[:2] - place[:2])) == pytest.approx(TRUCK.rear_axle_offset)
    assert place[2] == front[2]


def test_without_provenance_the_size_tells_the_axles(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[16].run(maps)
    found = again(replace(run, provenance={}), tmp_path)
    assert found.agents == run.agents
    assert judged(found) == judged(run)


def test_lights_are_phases_of_the_signals_of_the_map(tmp_path: Path) -> None:
    run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("light4"), "2222", distance=20, duration=17.0), traffic("stopped")))
    rvads.export_run(run, tmp_path / "run.xosc")
    phases = re.findall(
        r'<Phase name="phase \d" duration="([\d.]+)">(.*?)</Phase>', (tmp_path / "run.xosc").read_text("utf-8"), re.DOTALL
    )
    assert [float(seconds) for seconds, _ in phases] == [15.0, 2.01]
    shown = [re.findall(r'trafficSignalId="(\w+)" state="([\w;]+)"', states) for _, states in phases]
    red, yellow, green = "on;off;off", "off;on;off", "off;off;on"
    assert shown == [list(zip("0123", (now, red, now, red), strict=True)) for now in (green, yellow)]
    ids = re.findall(r'<signal [^>]*id="(\w+)"', (tmp_path / "light4.xodr").read_text("utf-8"))
    assert {"0", "1", "2", "3"} <= set(ids)


def test_twenty_failures_at_one_junction_share_its_map(maps: Path, tmp_path: Path) -> None:
    first = FAILURES[17].run(maps)
    rvads.export_run(first, tmp_path / "0.xosc")
    written = (tmp_path / "left.xodr").stat().st_ino  # a file that is written anew is another one, moved into place
    rvads.export_run(first, tmp_path / "1.xosc")
    assert (tmp_path / "left.xodr").stat().st_ino == written
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.xosc", "1.xosc", "left.xodr"]


def test_another_map_of_the_same_name_keeps_its_own(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[17].run(maps)
    (tmp_path / "left.xodr").write_text("<OpenDRIVE/>", encoding="utf-8")
    found = again(run, tmp_path)
    assert found.junction == run.junction
    assert (tmp_path / "left.xodr").read_text("utf-8") == "<OpenDRIVE/>"
    assert len([*tmp_path.glob("left-*.xodr")]) == 1


def test_a_map_that_has_changed_is_refused_not_judged_on(maps: Path, tmp_path: Path) -> None:
    rvads.export_run(FAILURES[17].run(maps), tmp_path / "run.xosc")
    (tmp_path / "left.xodr").write_bytes((maps / "five.xodr").read_bytes())
    with pytest.raises(RunError, match=r"run\.xosc: junction 'left\.1' of map file .* is not as it was when"):
        rvads.read_runs(tmp_path / "run.xosc")
    (tmp_path / "left.xodr").unlink()
    with pytest.raises(MapError, match=r"left\.xodr does not exist"):
        rvads.read_runs(tmp_path / "run.xosc")


def test_the_map_of_a_kept_run_is_where_it_was_or_where_one_says(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[17].run(maps)
    rvads.save_run(run, tmp_path / "kept.npz")
    kept = rvads.load_run(tmp_path / "kept.npz")
    assert again(kept, tmp_path / "a").junction == run.junction
    lost = replace(kept, provenance={})
    with pytest.raises(MapError, match=r"junction 'left\.1' is from no map file that is known.*--map"):
        rvads.export_run(lost, tmp_path / "x.xosc")
    with pytest.raises(MapError, match=r"junction 'left\.1' is not as it is in map file .*five\.xodr"):
        rvads.export_run(lost, tmp_path / "x.xosc", map=maps / "five.xodr")
    assert not (tmp_path / "x.xosc").exists()
    rvads.export_run(lost, tmp_path / "x.xosc", map=maps / "left.xodr")
    assert rvads.read_runs(tmp_path / "x.xosc")[0].junction == run.junction


def test_a_fault_stays_one(maps: Path, tmp_path: Path) -> None:
    fault = rvads.Fault(1.0, "a0", "the autopilot of a0 raised")
    found = again(replace(FAILURES[3].run(maps), fault=fault), tmp_path)
    assert found.fault == fault
    assert rvads.check(found, "p3").status is Status.ERROR


@pytest.mark.parametrize("kind", rvads.Kind)
@pytest.mark.parametrize("size", [None, (1.25, 0.75)], ids=["unknown", "small"])
def test_every_kind_and_size_comes_back(kind: rvads.Kind, size: tuple[float, float] | None, maps: Path, tmp_path: Path) -> None:
    run = FAILURES[15].run(maps)
    run = replace(run, agents=(replace(run.agents[0], kind=kind, size=size), *run.agents[1:]), collisions=None)
    found = again(run, tmp_path)
    assert found.agents == run.agents
    assert judged(found) == judged(run)


@pytest.fixture(scope="module")
def rolling() -> rvads.Run:
    """Two vehicles that drive all the way, past the line without a stop."""
    return rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2030", distance=20), rvads.RollingStop))


def test_an_excerpt_of_a_recording_is_read_as_recorded_traffic(rolling: rvads.Run, tmp_path: Path) -> None:
    rvads.export_run(rolling, tmp_path / "run.xosc")
    recorded = rvads.read_tracks(tmp_path / "run.xosc")[0]
    assert recorded.excerpt is not None
    rvads.export_run(recorded, tmp_path / "excerpt.xosc")
    found = rvads.read_runs(tmp_path / "excerpt.xosc")
    assert isinstance(found, Recording)
    assert [rvads.check(run, "full_stop").status for run in found] == [Status.FAIL]


def test_nobody_in_an_excerpt_gets_a_size_that_was_not_recorded(rolling: rvads.Run, tmp_path: Path) -> None:
    rvads.export_run(rolling, tmp_path / "run.xosc")
    recorded = rvads.read_tracks(tmp_path / "run.xosc")[0]
    first, second = recorded.agents
    rvads.export_run(replace(recorded, agents=(replace(first, size=None), second)), tmp_path / "excerpt.xosc")
    sizes = {track.agent.name: track.agent.size for track in rvads.read_tracks(tmp_path / "excerpt.xosc").tracks}
    assert sizes == {first.name: None, second.name: second.size}


def test_who_comes_and_goes_is_added_and_deleted(rolling: rvads.Run, tmp_path: Path) -> None:
    parts = {name: getattr(rolling, name).copy() for name in ("zone", "station", "speed", "pose")}
    for column, there in ((0, slice(0, 100)), (1, slice(1000, None))):
        parts["zone"][there, column] = Zone.ABSENT
        for numbers in ("station", "speed", "pose"):
            parts[numbers][there, column] = np.nan
    rvads.export_run(replace(rolling, **parts), tmp_path / "run.xosc")
    text = (tmp_path / "run.xosc").read_text("utf-8")
    assert text.count("<AddEntityAction>") == text.count("<DeleteEntityAction") == 1
    assert re.search(r'name="a0 appears".*?<SimulationTimeCondition value="1.0"', text, re.DOTALL)
    assert re.search(r'name="a2 leaves".*?<SimulationTimeCondition value="9.99"', text, re.DOTALL)
    tracks = {track.agent.name: track for track in rvads.read_tracks(tmp_path / "run.xosc").tracks}
    assert tracks["a0"].times[0] == pytest.approx(1.0)
    assert tracks["a2"].times[-1] == pytest.approx(9.99)


def test_others_who_use_the_library_keep_their_version(maps: Path, tmp_path: Path) -> None:
    xosc = pytest.importorskip("scenariogeneration.xosc")
    before = xosc.VersionBase.version_minor
    rvads.export_run(FAILURES[3].run(maps), tmp_path / "run.xosc")
    assert xosc.VersionBase.version_minor == before


def named(run: rvads.Run, name: str) -> rvads.Run:
    """Return a run whose first vehicle has another name."""
    return replace(run, agents=(replace(run.agents[0], name=name), *run.agents[1:]))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda run: replace(run, pose=None), RunError, "holds no positions"),
        (lambda run: run.label, RunError, "export_run takes a run"),
        (lambda run: replace(run, label="$run"), RvadsError, "'\\$run' can't stand in OpenSCENARIO"),
        (lambda run: named(run, "$0"), RvadsError, "'\\$0' can't stand in OpenSCENARIO"),
        (lambda run: named(run, "\ufffe"), RvadsError, "can't stand in XML, which has no character '.ufffe'"),
        (lambda run: named(run, "x" * 1001), RunError, r"'agents\[0\]\.name' must be a text of length <= 1000"),
        (lambda run: replace(run, zone=run.zone[:0], lights=run.lights[:0], pose=run.pose[:0]), RunError, "it has no states"),
    ],
)
def test_what_can_not_be_exported_is_told(
    change: Callable[[rvads.Run], Any], error: type[RvadsError], message: str, maps: Path, tmp_path: Path
) -> None:
    with pytest.raises(error, match=message):
        rvads.export_run(change(FAILURES[3].run(maps)), tmp_path / "run.xosc")
    assert not (tmp_path / "run.xosc").exists()


def test_the_map_beside_is_not_written_over(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[17].run(maps)
    (tmp_path / "left.xodr").write_bytes((maps / "left.xodr").read_bytes())
    with pytest.raises(RvadsError, match=r"the map beside has this name: .* such as .*left\.xosc"):
        rvads.export_run(run, tmp_path / "left.xodr")
    assert (tmp_path / "left.xodr").read_bytes() == (maps / "left.xodr").read_bytes()


def test_a_verdict_is_one(maps: Path, tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"verdict= must be what rvads\.check\(run, rule\) returns, got 'p1'"):
        rvads.export_run(FAILURES[3].run(maps), tmp_path / "run.xosc", verdict=cast(Any, "p1"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (r'(<Dimensions [^>]*length=")[^"]*', r"\g<1>-4", r"length and width of 'a0': .* must be a number > 0"),
        (r'<WorldPosition x="[^"]*"', '<WorldPosition x="2e9"', r"'a0' has a place, heading or speed beyond 1e\+09"),
        (r'(AbsoluteTargetSpeed value=")[^"]*', r"\g<1>2e9", r"'a0' has a place, heading or speed beyond 1e\+09"),
        (r"steps&quot;:\d+", "steps&quot;:5000", r"'a0' must last to the end of the run at 49.99 s, or until it is gone"),
    ],
)
def test_what_no_run_can_hold_is_refused(old: str, new: str, message: str, maps: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.xosc"
    rvads.export_run(FAILURES[3].run(maps), path)
    text, count = re.subn(old, new, path.read_text("utf-8"))
    assert count
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RunError, match=rf"^run\.xosc: .*{message}"):
        rvads.read_runs(path)


def test_a_missing_library_is_told_with_what_to_install(maps: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "scenariogeneration.xosc", None)
    with pytest.raises(RvadsError, match="pip install 'pytest-rvads\\[openscenario\\]'"):
        rvads.export_run(FAILURES[3].run(maps), tmp_path / "new" / "run.xosc")
    assert not (tmp_path / "new").exists()


def test_a_place_that_can_not_be_written_is_told(maps: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(RvadsError, match=r"can't be (copied|written)"):
        rvads.export_run(FAILURES[3].run(maps), tmp_path / "file" / "run.xosc")


def test_colours_are_lamps_from_above() -> None:
    from pytest_rvads.satellites.openscenario.xosc import LAMPS

    assert {colour for colour, lamps in LAMPS.items() if lamps.count("on") == 1} == {*Colour} - {Colour.NONE}

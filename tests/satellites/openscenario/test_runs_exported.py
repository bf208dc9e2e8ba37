"""Exported runs have the trajectories, lights and map of the run."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.satellites.openscenario.xosc import LAMPS, read_trajectories
from pytest_rvads.support.errors import MapError, RunError, RvadsError

from .failures import FAILURES, TRUCK, Failure

pytestmark = pytest.mark.usefixtures("library")


@pytest.fixture(scope="module")
def rolling() -> rvads.Run:
    """A run of two vehicles that pass the junction without a stop at the line."""
    return rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2030", distance=20), rvads.RollingStop))


def fronts(path: Path, run: rvads.Run) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the pose of the front of every agent in every state of a run, computed from the trajectories of an exported file."""
    file, times, poses = read_trajectories(path), np.arange(run.steps) * run.dt, []
    for agent, entity in zip(run.agents, file.entities, strict=True):
        assert (entity.name, entity.kind, entity.size) == (agent.name, agent.kind, agent.size)
        way = file.ways[agent.name]
        x, y, h = (np.interp(times, way[:, 1], column) for column in (way[:, 2], way[:, 3], np.unwrap(way[:, 4])))
        poses.append(np.column_stack((x + entity.ahead * np.cos(h), y + entity.ahead * np.sin(h), h)))
    return np.stack(poses, axis=1)


def exported(run: rvads.Run, folder: Path) -> Path:
    rvads.files.export_run(run, folder / "run.xosc")
    return folder / "run.xosc"


@pytest.mark.extended
@pytest.mark.parametrize("failure", FAILURES, ids=str)
def test_exported_failure_has_the_poses_of_its_run(failure: Failure, maps: Path, tmp_path: Path) -> None:
    run = failure.run(maps)
    assert rvads.check(run, failure.rule).status in (Status.FAIL, Status.OPEN)
    present = run.here & (run.zone != Zone.GONE)
    assert np.abs(fronts(exported(run, tmp_path), run) - run.pose)[present].max() < 1e-9


def test_exported_run_is_read_as_recorded_traffic(rolling: rvads.Run, tmp_path: Path) -> None:
    recording = rvads.files.read_runs(exported(rolling, tmp_path))
    assert isinstance(recording, Recording)
    assert [rvads.check(run, "full_stop").status for run in recording] == [Status.FAIL]


def test_at_least_20_failures_at_8_junctions() -> None:
    assert len(FAILURES) >= 20
    assert len({failure.junction for failure in FAILURES}) >= 8


def test_equal_runs_give_equal_files(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[8].run(maps)
    rvads.files.save_run(run, tmp_path / "kept.npz")
    rvads.files.export_run(run, tmp_path / "one" / "run.xosc")
    rvads.files.export_run(rvads.files.load_run(tmp_path / "kept.npz"), tmp_path / "two" / "run.xosc")
    for name in ("run.xosc", "light4.xodr"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_file_quotes_the_verdict(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[1].run(maps)
    verdict = rvads.check(run, "p2")
    rvads.files.export_run(run, tmp_path / "run.xosc", verdict=verdict)
    head = (tmp_path / "run.xosc").read_text("utf-8")[:3000]
    assert f'description="{run.label}: {verdict.message}"' in head
    assert "&quot;rule&quot;:&quot;p2&quot;,&quot;status&quot;:&quot;FAIL&quot;" in head


def test_standing_vehicle_needs_no_vertices(maps: Path, tmp_path: Path) -> None:
    run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("light4"), "0200", distance=5, duration=10.0), rvads.Reference))
    path = exported(run, tmp_path)
    vertices = (tmp_path / "run.xosc").read_text("utf-8").count("<Vertex")
    stands = int((np.diff(run.pose[:, 0], axis=0) == 0.0).all(axis=1).sum())
    assert stands > 500  # the light is red for 20 s
    assert vertices < run.steps - stands + 20
    assert np.abs(fronts(path, run) - run.pose).max() < 1e-9


def test_vehicle_beyond_its_exit_road_is_deleted(tmp_path: Path) -> None:
    scenario = rvads.Scenario(rvads.find("stop4"), "2020", distance=(1, 0, 40, 0), speed=(10, 0, 0, 0), duration=20.0)
    run = rvads.simulate(rvads.Case(scenario, traffic("red_light_runner")))
    gone = np.flatnonzero(run.zone[:, 0] == Zone.GONE)
    assert 0 < gone[0] < run.steps - 100
    assert not (run.zone[:, 1] == Zone.GONE).any()
    text = exported(run, tmp_path).read_text("utf-8")
    assert re.findall(r'<DeleteEntityAction|<EntityAction entityRef="(a\d)">\s*<DeleteEntityAction', text) == ["a0"]
    time = re.search(r'<Event name="a0 leaves".*?<SimulationTimeCondition value="([^"]*)"', text, re.DOTALL)
    assert float(time[1]) == pytest.approx(gone[0] * run.dt)


def test_reference_point_is_the_rear_axle(maps: Path, tmp_path: Path) -> None:
    failure = next(failure for failure in FAILURES if failure.truck == "a1")
    run = failure.run(maps)
    rvads.files.export_run(run, tmp_path / "run.xosc")
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


def test_axles_follow_from_the_size_without_provenance(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[16].run(maps)
    path = exported(replace(run, provenance={}), tmp_path)
    assert np.abs(fronts(path, run) - run.pose).max() < 1e-9


def test_lights_are_phases_of_the_signals_of_the_map(tmp_path: Path) -> None:
    run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("light4"), "2222", distance=20, duration=17.0), traffic("stopped")))
    rvads.files.export_run(run, tmp_path / "run.xosc")
    phases = re.findall(
        r'<Phase name="phase \d" duration="([\d.]+)">(.*?)</Phase>', (tmp_path / "run.xosc").read_text("utf-8"), re.DOTALL
    )
    assert [float(seconds) for seconds, _ in phases] == [15.0, 2.01]
    shown = [re.findall(r'trafficSignalId="(\w+)" state="([\w;]+)"', states) for _, states in phases]
    red, yellow, green = "on;off;off", "off;on;off", "off;off;on"
    assert shown == [list(zip("0123", (now, red, now, red), strict=True)) for now in (green, yellow)]
    ids = re.findall(r'<signal [^>]*id="(\w+)"', (tmp_path / "light4.xodr").read_text("utf-8"))
    assert {"0", "1", "2", "3"} <= set(ids)


def test_exports_at_a_junction_share_its_map(maps: Path, tmp_path: Path) -> None:
    first = FAILURES[17].run(maps)
    rvads.files.export_run(first, tmp_path / "0.xosc")
    written = (tmp_path / "left.xodr").stat().st_ino  # writing a file anew would give it another inode
    rvads.files.export_run(first, tmp_path / "1.xosc")
    assert (tmp_path / "left.xodr").stat().st_ino == written
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.xosc", "1.xosc", "left.xodr"]


def test_different_map_of_the_same_name_is_not_overwritten(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[17].run(maps)
    (tmp_path / "left.xodr").write_text("<OpenDRIVE/>", encoding="utf-8")
    assert rvads.files.read_tracks(exported(run, tmp_path)).junction.digest == run.junction.digest
    assert (tmp_path / "left.xodr").read_text("utf-8") == "<OpenDRIVE/>"
    assert len([*tmp_path.glob("left-*.xodr")]) == 1


def test_map_of_a_kept_run_is_found_or_given(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[17].run(maps)
    rvads.files.save_run(run, tmp_path / "kept.npz")
    saved = rvads.files.load_run(tmp_path / "kept.npz")
    assert rvads.files.read_tracks(exported(saved, tmp_path / "a")).junction.digest == run.junction.digest
    without_provenance = replace(saved, provenance={})
    with pytest.raises(MapError, match=r"the map file of junction 'left\.1' is not known.*--map"):
        rvads.files.export_run(without_provenance, tmp_path / "x.xosc")
    with pytest.raises(MapError, match=r"junction 'left\.1' differs from the junction in map file .*five\.xodr"):
        rvads.files.export_run(without_provenance, tmp_path / "x.xosc", map=maps / "five.xodr")
    assert not (tmp_path / "x.xosc").exists()
    rvads.files.export_run(without_provenance, tmp_path / "x.xosc", map=maps / "left.xodr")
    assert rvads.files.read_tracks(tmp_path / "x.xosc").junction.digest == run.junction.digest


@pytest.mark.parametrize("kind", rvads.Kind)
@pytest.mark.parametrize("size", [None, (1.25, 0.75)], ids=["unknown", "small"])
def test_kind_and_size_survive_export(kind: rvads.Kind, size: tuple[float, float] | None, maps: Path, tmp_path: Path) -> None:
    run = FAILURES[15].run(maps)
    run = replace(run, agents=(replace(run.agents[0], kind=kind, size=size), *run.agents[1:]), collisions=None)
    first, *_ = read_trajectories(exported(run, tmp_path)).entities
    assert (first.name, first.kind, first.size) == (run.agents[0].name, kind, size)


def test_exported_excerpt_has_recorded_sizes_only(rolling: rvads.Run, tmp_path: Path) -> None:
    recorded = rvads.files.read_tracks(exported(rolling, tmp_path))[0]
    first, second = recorded.agents
    rvads.files.export_run(replace(recorded, agents=(replace(first, size=None), second)), tmp_path / "excerpt.xosc")
    sizes = {track.agent.name: track.agent.size for track in rvads.files.read_tracks(tmp_path / "excerpt.xosc").tracks}
    assert sizes == {first.name: None, second.name: second.size}


def test_late_and_early_vehicles_are_added_and_deleted(rolling: rvads.Run, tmp_path: Path) -> None:
    parts = {name: getattr(rolling, name).copy() for name in ("zone", "station", "speed", "pose")}
    for column, states in ((0, slice(0, 100)), (1, slice(1000, None))):
        parts["zone"][states, column] = Zone.ABSENT
        for numbers in ("station", "speed", "pose"):
            parts[numbers][states, column] = np.nan
    rvads.files.export_run(replace(rolling, **parts), tmp_path / "run.xosc")
    text = (tmp_path / "run.xosc").read_text("utf-8")
    assert text.count("<AddEntityAction>") == text.count("<DeleteEntityAction") == 1
    assert re.search(r'name="a0 appears".*?<SimulationTimeCondition value="1.0"', text, re.DOTALL)
    assert re.search(r'name="a2 leaves".*?<SimulationTimeCondition value="9.99"', text, re.DOTALL)
    tracks = {track.agent.name: track for track in rvads.files.read_tracks(tmp_path / "run.xosc").tracks}
    assert tracks["a0"].times[0] == pytest.approx(1.0)
    assert tracks["a2"].times[-1] == pytest.approx(9.99)


def test_export_restores_the_version_of_the_library(maps: Path, tmp_path: Path) -> None:
    xosc = pytest.importorskip("scenariogeneration.xosc")
    before = xosc.VersionBase.version_minor
    rvads.files.export_run(FAILURES[3].run(maps), tmp_path / "run.xosc")
    assert xosc.VersionBase.version_minor == before


def with_name(run: rvads.Run, name: str) -> rvads.Run:
    """Return a run whose first vehicle has another name."""
    return replace(run, agents=(replace(run.agents[0], name=name), *run.agents[1:]))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda run: replace(run, pose=None), RunError, "holds no positions"),
        (lambda run: run.label, RunError, "export_run takes a run"),
        (lambda run: replace(run, label="$run"), RvadsError, "'\\$run' can't stand in OpenSCENARIO"),
        (lambda run: with_name(run, "$0"), RvadsError, "'\\$0' can't stand in OpenSCENARIO"),
        (lambda run: with_name(run, "\ufffe"), RvadsError, "can't stand in XML, which has no character '.ufffe'"),
        (lambda run: replace(run, zone=run.zone[:0], lights=run.lights[:0], pose=run.pose[:0]), RunError, "0 states"),
    ],
)
def test_unexportable_runs_are_refused(
    change: Callable[[rvads.Run], Any], error: type[RvadsError], message: str, maps: Path, tmp_path: Path
) -> None:
    with pytest.raises(error, match=message):
        rvads.files.export_run(change(FAILURES[3].run(maps)), tmp_path / "run.xosc")
    assert not (tmp_path / "run.xosc").exists()


def test_file_with_the_name_of_its_map_is_refused(maps: Path, tmp_path: Path) -> None:
    run = FAILURES[17].run(maps)
    (tmp_path / "left.xodr").write_bytes((maps / "left.xodr").read_bytes())
    with pytest.raises(RvadsError, match=r"left\.xodr: the map has this name: .* such as .*left\.xosc"):
        rvads.files.export_run(run, tmp_path / "left.xodr")
    assert (tmp_path / "left.xodr").read_bytes() == (maps / "left.xodr").read_bytes()


def test_verdict_argument_must_be_a_verdict(maps: Path, tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"verdict= must be what rvads\.check\(run, rule\) returns, got 'p1'"):
        rvads.files.export_run(FAILURES[3].run(maps), tmp_path / "run.xosc", verdict=cast(Any, "p1"))


def test_missing_library_names_the_package_to_install(maps: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "scenariogeneration.xosc", None)
    with pytest.raises(RvadsError, match="pip install 'pytest-rvads\\[openscenario\\]'"):
        rvads.files.export_run(FAILURES[3].run(maps), tmp_path / "new" / "run.xosc")
    assert not (tmp_path / "new").exists()


def test_unwritable_path_of_an_export_is_refused(maps: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(RvadsError, match=r"can't be (copied|written)"):
        rvads.files.export_run(FAILURES[3].run(maps), tmp_path / "file" / "run.xosc")


def test_each_colour_lights_a_single_lamp() -> None:
    assert {colour for colour, lamps in LAMPS.items() if lamps.count("on") == 1} == {*Colour} - {Colour.NONE}

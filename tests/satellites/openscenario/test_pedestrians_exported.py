"""Runs with pedestrians in OpenSCENARIO: entities, trajectories, lights; scenarios are refused."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.drivers.interface import Command, Observation
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.openscenario.xosc import read_trajectories
from pytest_rvads.support.errors import ScenarioError

pytestmark = pytest.mark.usefixtures("library")


class Drives:
    """Drives at 8 m/s whoever is in the way."""

    def control(self, seen: Observation) -> Command:
        return rvads.TargetSpeed(8.0)


def scenario(name: str, difference: float = 1.5) -> rvads.Scenario:
    walkers = [
        rvads.Pedestrian(1, "near", "hidden", difference),
        rvads.Pedestrian(3, "far", "group", 3.0),
        rvads.Pedestrian(1, "far", "returns", 2.0),
    ]
    place = rvads.find(name) if name in ("zebra4", "walk4") else rvads.find("1", path_of("zebra4"))
    return rvads.Scenario(place, "0200", distance=20, speed=8, subject=1, pedestrians=walkers, duration=14.0)


@pytest.fixture(params=["zebra4", "walk4"])
def run(request: pytest.FixtureRequest) -> Run:
    return rvads.simulate(rvads.Case(scenario(request.param), Drives))


def test_exported_pedestrians_walk_as_in_their_run(run: Run, tmp_path: Path) -> None:
    rvads.files.export_run(run, tmp_path / "run.xosc")
    file = read_trajectories(tmp_path / "run.xosc")
    assert [(entity.name, entity.kind) for entity in file.entities] == [(agent.name, agent.kind) for agent in run.agents]
    for column, entity in enumerate(file.entities):
        way = file.ways[entity.name]
        front = way[:, 2:4] + entity.ahead * np.column_stack((np.cos(way[:, 4]), np.sin(way[:, 4])))
        states = np.round(way[:, 1] / run.dt).astype(int)
        assert np.abs(front - run.need("pose")[states, column, :2]).max() < 1e-9


def test_file_has_pedestrians_as_pedestrians(run: Run, tmp_path: Path) -> None:
    rvads.files.export_run(run, tmp_path / "run.xosc")
    root = ElementTree.parse(tmp_path / "run.xosc").getroot()
    entities = {entity.get("name"): entity[0] for entity in root.iter("ScenarioObject")}
    kinds = {name: entity.tag for name, entity in entities.items()}
    people = dict.fromkeys(("p0", "p1", "p1+1", "p1+2", "p2"), "Pedestrian")
    assert kinds == {"a1": "Vehicle", "parked0": "Vehicle", **people}
    middle, size = entities["p0"].find("BoundingBox/Center"), entities["p0"].find("BoundingBox/Dimensions")
    assert middle is not None
    assert size is not None
    assert (float(middle.get("x", "1")), float(size.get("length", "0")), float(size.get("width", "0"))) == (0.0, 0.6, 0.6)
    signals = {state.get("trafficSignalId") for state in root.iter("TrafficSignalState")}
    walks = {f"w{k}" for k in range(4)}
    assert walks & signals == (walks if run.junction.phase_groups else set())


def test_command_exports_a_kept_run_of_a_map_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rvads.files.save_run(rvads.simulate(rvads.Case(scenario("file"), Drives)), tmp_path / "kept.npz")
    assert main(["export", str(tmp_path / "kept.npz"), "-o", str(tmp_path / "out" / "run.xosc")]) == 0
    assert "2 vehicles, 5 pedestrians at zebra4.1, " in capsys.readouterr().out
    entities = read_trajectories(tmp_path / "out" / "run.xosc").entities
    assert [entity.name for entity in entities if entity.kind is rvads.Kind.PEDESTRIAN] == ["p0", "p1", "p1+1", "p1+2", "p2"]


def test_scenario_with_pedestrians_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ScenarioError, match="has pedestrians, and elements of OpenSCENARIO can't express how they behave"
    ) as caught:
        rvads.files.save_scenario(scenario("zebra4"), tmp_path / "start.xosc")
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())

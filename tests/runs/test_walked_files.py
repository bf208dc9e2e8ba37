"""Files of runs and recordings in which pedestrians walk."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.recording import Changes, Recording, Track
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import glance
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.support.errors import RunError
from tests.zebras import zebra


@pytest.fixture(scope="module")
def walked() -> Run:
    walkers = [rvads.Pedestrian(1, "near", "hidden", 0.5), rvads.Pedestrian(1, "far")]
    scenario = rvads.Scenario(zebra("light4", lit=True), "0200", distance=20, speed=8, subject=1, pedestrians=walkers)
    return rvads.simulate(rvads.Case(scenario, rvads.Reference))


def header_of(path: Path) -> dict[str, Any]:
    header: dict[str, Any] = json.loads(bytes(np.load(path)["header"]))
    return header


def test_run_with_pedestrians_comes_back_bit_by_bit(walked: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    rvads.files.save_run(walked, path)
    back = rvads.files.load_run(path)
    assert [agent.name for agent in back.agents] == ["a1", "p0", "parked0", "p1"]
    assert [agent.way.kind for agent in back.agents] == ["movement", "crossing", "parking place", "crossing"]
    assert back.hash == walked.hash
    assert back.lights.shape == (walked.steps, 4 + 3 * 4)
    place, same = walked.junction, back.junction
    assert same == place
    assert (same.stretches, same.yields, same.covers) == (place.stretches, place.yields, place.covers)
    assert [(one.id, one.arm, one.middle, one.island, one.phase) for one in same.crossings] == [
        (one.id, one.arm, one.middle, one.island, one.phase) for one in place.crossings
    ]
    first = path.read_bytes()
    rvads.files.save_run(back, path)
    assert path.read_bytes() == first


def test_the_junction_of_a_file_is_known_without_its_lines(walked: Run, tmp_path: Path) -> None:
    rvads.files.save_run(walked, tmp_path / "run.npz")
    place = glance(tmp_path / "run.npz")
    assert place is not None
    assert [way.kind for way, _, _ in place.further] == ["crossing"] * 8 + ["parking place"] * 4


def test_file_of_a_run_without_pedestrians_says_nothing_of_crosswalks(tmp_path: Path) -> None:
    for name, place in (("plain", find("stop4")), ("zebra", zebra("stop4"))):
        run = rvads.simulate(rvads.Case(rvads.Scenario(place, "0200", distance=5.0), rvads.Reference))
        rvads.files.save_run(run, tmp_path / f"{name}.npz")
    assert (tmp_path / "plain.npz").read_bytes() == (tmp_path / "zebra.npz").read_bytes()
    assert "crosswalks" not in header_of(tmp_path / "plain.npz")["junction"]


def damaged(walked: Run, folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """Return the file of a run after a change of the record of its junction."""
    path = folder / "run.npz"
    rvads.files.save_run(walked, path)
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = header_of(path)
    change(header["junction"])
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda one: one.update(arm=4), "it has a crosswalk over arm 4, and its junction has 4 arms"),
        (lambda one: one.update(area=one["area"][:2]), r"area' must be a list of length >= 3"),
        (lambda one: one.update(path=one["path"][:1]), r"path' must be a list of length >= 2"),
        (lambda one: one.update(path=[[0.0, 0.0], [0.0, 0.0]]), "segment 'zebra0' has zero length"),
        (lambda one: one.update(path=[[0.0, 0.0], [1e9, 0.0]]), "its movements and crosswalks are 1,000,000"),
        (lambda one: one.update(area=[[0.0, 0.0]] * 3), "segment 'zebra0.beside' has zero length"),
        (lambda one: one.update(area=[[0.0, 0.0], [1.0, 2e9], [3.0, 3.0]]), "must be a number <= "),
        (lambda one: one.update(middle=-1.0), "must be a number >= 0"),
    ],
)
def test_damaged_crosswalk_is_refused_in_one_sentence(
    walked: Run, tmp_path: Path, change: Callable[[dict[str, Any]], None], message: str
) -> None:
    path = damaged(walked, tmp_path, lambda junction: change(junction["crosswalks"][0]))
    with pytest.raises(RunError, match=message) as caught:
        rvads.files.load_run(path)
    assert "\n" not in str(caught.value)


def test_pedestrian_without_crosswalks_in_the_file_is_refused(walked: Run, tmp_path: Path) -> None:
    path = damaged(walked, tmp_path, lambda junction: junction.pop("crosswalks"))
    with pytest.raises(RunError, match=r"lights must be whole numbers in the shape \(\d+, 4\), got int8 in \(\d+, 16\)"):
        rvads.files.load_run(path)


def test_ways_that_do_not_follow_from_the_crosswalks_are_refused(walked: Run, tmp_path: Path) -> None:
    place = walked.junction
    narrower = replace(place, further=place.further[:8])
    with pytest.raises(RunError, match="of the kind crossing that do not follow from its crosswalks"):
        rvads.files.save_run(replace(walked, junction=narrower), tmp_path / "run.npz")


def test_recording_with_pedestrians_comes_back(walked: Run, tmp_path: Path) -> None:
    tracks = []
    for column in (0, 1, 3):
        there = np.flatnonzero(walked.zone[:, column] != Zone.GONE)[::10]
        arrays = (walked.need(name)[there, column] for name in ("station", "speed", "pose"))
        tracks.append(Track(walked.agents[column], 100.0 + walked.times[there], *arrays))
    lights = {start: Changes(np.array([0.0]), np.array([Colour.GREEN], dtype=np.int8)) for start in (1, 6, 7)}
    recording = Recording("street", walked.junction, tuple(tracks), lights)
    path = tmp_path / "street.npz"
    rvads.files.save_recording(recording, path)
    back = rvads.files.load_recording(path)
    assert [run.hash for run in back] == [run.hash for run in recording]
    assert {agent.name for run in back for agent in run.agents} == {"a1", "p0", "p1"}
    assert back[0].lights[0, [1, 6, 7]].tolist() == [Colour.GREEN] * 3

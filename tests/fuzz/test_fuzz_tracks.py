"""Whatever happens to a file of tracks, it is read or refused in one sentence that names the file, and of a row where it is."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.check import check
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.readers import read_runs
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.runfile import load_recording, save_recording
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.support.errors import RunError

from .mutations import QUICK, damaged, hostile_text

pytestmark = pytest.mark.filterwarnings("error")
PLACE = find("light4")
LIGHTS = b"time,entrance,colour\n0,0,red\n0,1,green\n1.5,0,green\n1.5,1,red\n"
CELLS = (
    st.sampled_from(["", "nan", "inf", "-inf", "1e308", "-1", "0", "1e-300", "9" * 30, "x", "1,2", '"', "\x00"]) | hostile_text
)


def samples(place: Junction) -> list[tuple[float, str, float, float, float, float]]:
    """Return time, id, x, y, heading, speed of two vehicles, the rows of both mixed."""
    rows = []
    for name, key, begin in (("a", (0, 2), -25.0), ("b", (1, 3), -33.0)):
        way = Itinerary.through(place, *key)
        for k in range(50):
            pose = way.pose(begin + 1.6 * k)
            rows.append((0.2 * k, name, pose.x, pose.y, pose.heading, 8.0))
    return sorted(rows)


def csv_seed() -> bytes:
    lines = [",".join(map(str, (*row, 4.6, 1.8))) for row in samples(PLACE)]
    return "\n".join(["time,id,x,y,heading,speed,length,width", *lines]).encode()


def fcd_seed() -> bytes:
    lines = ["<fcd-export>"]
    for time, name, x, y, heading, speed in samples(PLACE):
        angle = 90 - np.degrees(heading)
        vehicle = f'<vehicle id="{name}" x="{x}" y="{y}" angle="{angle}" speed="{speed}" length="4.6" width="1.8"/>'
        lines.append(f'<timestep time="{time}">{vehicle}</timestep>')
    return "\n".join([*lines, "</fcd-export>"]).encode()


def carla_seed() -> bytes:
    actor = {"type": "actor", "type_id": "vehicle.x", "role": "", "extent": [2.3, 0.9, 0.7], "center": [0, 0, 0]}
    records: list[dict[str, Any]] = [{"type": "traffic_light", "id": 9, "opendrive_id": "0"}]
    records += [{**actor, "id": number} for number in (0, 1)]
    for time, name, x, y, heading, _ in samples(PLACE):
        state = ["ab".index(name), x, -y, 0, 0, 0, -np.degrees(heading), 0, 0, 0]
        records.append({"type": "tick", "t": time, "actors": [state], "lights": {"9": "Red"}})
    return "\n".join(map(json.dumps, records)).encode()


def xosc_seed() -> bytes:
    box = '<BoundingBox><Center x="1.1"/><Dimensions length="4.6" width="1.8"/></BoundingBox>'
    objects = "".join(
        f'<ScenarioObject name="{name}"><Vehicle vehicleCategory="car">{box}</Vehicle></ScenarioObject>' for name in "ab"
    )
    groups = ""
    for name in "ab":
        vertices = "".join(
            f'\n<Vertex time="{time}"><Position><WorldPosition x="{x}" y="{y}" h="{heading}"/></Position></Vertex>'
            for time, who, x, y, heading, _ in samples(PLACE)
            if who == name
        )
        timing = '<TimeReference><Timing domainAbsoluteRelative="absolute" scale="1" offset="0"/></TimeReference>'
        action = f"<FollowTrajectoryAction><Polyline>{vertices}</Polyline>{timing}</FollowTrajectoryAction>"
        groups += f'<ManeuverGroup><EntityRef entityRef="{name}"/><Event>{action}</Event></ManeuverGroup>'
    phase = '<Phase duration="3"><TrafficSignalState trafficSignalId="0" state="red"/></Phase>'
    lights = f"<TrafficSignals><TrafficSignalController>{phase}</TrafficSignalController></TrafficSignals>"
    return f"<OpenSCENARIO><RoadNetwork>{lights}</RoadNetwork>{objects}{groups}</OpenSCENARIO>".encode()


SEEDS = {"t.csv": csv_seed(), "t.xml": fcd_seed(), "t.jsonl": carla_seed(), "t.xosc": xosc_seed()}


def survive(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    for strict in (False, True):
        try:
            recording = read_tracks(path, PLACE, strict=strict)
        except RunError as error:
            told(str(error), path)
        else:
            use(recording, path.with_name("kept.npz"))
            for _, why in recording.left_out:
                if not why.startswith("it"):
                    told(why, path)
                    assert "row " in why
                    assert "column " in why


def told(message: str, path: Path) -> None:
    assert path.name in message
    assert "\n" not in message
    assert len(message) < 1000


def use(recording: Recording, path: Path) -> None:
    save_recording(recording, path)
    again = load_recording(path)
    for run, other in zip(recording.periods[:1], again.periods[:1], strict=True):
        assert run == other
    if recording.periods and recording.periods[0].end - recording.periods[0].begin < 100.0:
        for rule in ("p1", "red", "no_collision"):
            str(check(recording[0], rule))


@pytest.mark.extended
@pytest.mark.parametrize("name", SEEDS)
@given(data=st.data())
@QUICK
def test_files_with_other_bytes(name: str, tmp_path: Path, data: st.DataObject) -> None:
    survive(tmp_path / name, data.draw(damaged(SEEDS[name])))


@pytest.mark.extended
@given(data=st.data())
@QUICK
def test_tables_with_other_cells(tmp_path: Path, data: st.DataObject) -> None:
    rows = [line.split(",") for line in SEEDS["t.csv"].decode().splitlines()]
    for _ in range(data.draw(st.integers(1, 3))):
        row = data.draw(st.integers(0, len(rows) - 1))
        what = data.draw(st.sampled_from(["cell", "less", "more", "again", "gone", "column"]))
        cell = data.draw(st.integers(0, 7))
        if what == "cell" and cell < len(rows[row]):
            rows[row][cell] = data.draw(CELLS)
        elif what == "column":
            text = data.draw(CELLS)
            rows = [rows[0], *([*r[:cell], text, *r[cell + 1 :]] for r in rows[1:])]
        elif what in ("less", "more"):
            rows[row] = rows[row][:-1] if what == "less" else [*rows[row], "1"]
        elif what == "again":
            rows.insert(row, rows[row])
        elif len(rows) > 1:
            del rows[row]
    text = "\n".join(map(",".join, rows))
    survive(tmp_path / "t.csv", text.encode("utf-8", "replace"))


@pytest.mark.extended
@given(data=st.data())
@QUICK
def test_files_of_lights(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "lights.csv"
    path.write_bytes(data.draw(damaged(LIGHTS)))
    tracks = tmp_path / "t.csv"
    tracks.write_bytes(SEEDS["t.csv"])
    try:
        read_tracks(tracks, PLACE, lights=path)
    except RunError as error:
        message = str(error)
        if "none of the lights" not in message:
            told(message, path)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("kept")
    (folder / "t.csv").write_bytes(SEEDS["t.csv"])
    (folder / "lights.csv").write_bytes(LIGHTS)
    recording = read_tracks(folder / "t.csv", PLACE, lights=folder / "lights.csv", position_accuracy=0.1)
    save_recording(recording, folder / "kept.npz")
    return (folder / "kept.npz").read_bytes()


def reload(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        runs = read_runs(path)
    except RunError as error:
        told(str(error), path)
    else:
        if isinstance(runs, Recording):
            use(runs, path.with_name("again.npz"))


@pytest.mark.extended
@given(data=st.data())
@QUICK
def test_kept_recordings_with_other_bytes(kept: bytes, tmp_path: Path, data: st.DataObject) -> None:
    reload(tmp_path / "kept.npz", data.draw(damaged(kept)))


@pytest.mark.extended
@given(data=st.data())
@QUICK
def test_kept_recordings_with_other_headers_and_numbers(kept: bytes, tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "kept.npz"
    path.write_bytes(kept)
    with np.load(path) as archive:
        arrays = {name: archive[name].copy() for name in archive.files}
    if data.draw(st.booleans()):
        arrays["header"] = np.frombuffer(data.draw(damaged(arrays["header"].tobytes())), np.uint8)
    else:
        name = data.draw(st.sampled_from(sorted(arrays.keys() - {"header"})))
        what = data.draw(st.sampled_from(["number", "less", "kind"]))
        if what == "number" and arrays[name].size:
            number = data.draw(st.sampled_from([np.nan, np.inf, -1.0, 1e8, 1e9, 1e300]))
            with np.errstate(all="ignore"):
                arrays[name].flat[data.draw(st.integers(0, arrays[name].size - 1))] = (
                    number if arrays[name].dtype.kind == "f" else 7
                )
        else:
            arrays[name] = arrays[name][:-1] if what == "less" else arrays[name].astype("f4")
    np.savez(path, **arrays)
    reload(path, path.read_bytes())

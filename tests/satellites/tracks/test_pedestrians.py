"""A recorded pedestrian is in a recording while it is on a crosswalk or beside the kerbs of the crosswalk, and nowhere else."""

import csv
import json
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.cli import main
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.crosswalks import Crossing, Side
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.validate import validate
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_recording
from pytest_rvads.runs.states import Colour, Kind, Zone
from pytest_rvads.satellites.tracks.importing import read_tracks
from pytest_rvads.satellites.tracks.streaming import Stream
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.pedestrians import Pedestrian
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate

from .drives import LENGTH, WIDTH, Drive, drive

ZEBRA = find("zebra4")
LONG = ZEBRA.crossings[0].path.length
CAR = drive(ZEBRA, (2, 0), "car", start=3.0)


@dataclass(frozen=True, slots=True)
class Person:
    """Samples of a pedestrian; the points are the middle of its body."""

    name: str
    times: np.ndarray
    points: np.ndarray


def person(
    course: Sequence[tuple[float, float, float]], *, number: int = 0, name: str = "p", place: Junction = ZEBRA, dt: float = 0.1
) -> Person:
    """Return a pedestrian who walks straight from point to point.

    Args:
        course: time [s], distance from the near kerb along the crosswalk [m], and distance to the left of its middle [m].
        number: the crosswalk.
        name: name of the pedestrian.
        place: the junction.
        dt: time between two samples [s].
    """
    times = np.arange(course[0][0], course[-1][0] + dt / 2, dt)
    along, left = (np.interp(times, [c[0] for c in course], [c[k] for c in course]) for k in (1, 2))
    x, y, heading = place.crossings[number].path.pose(0.0)
    ahead, beside = np.array([math.cos(heading), math.sin(heading)]), np.array([-math.sin(heading), math.cos(heading)])
    return Person(name, times, np.array([x, y]) + along[:, None] * ahead + left[:, None] * beside)


def table(people: Sequence[Person], vehicles: Sequence[Drive] = (CAR,), noise: float = 0.0) -> dict[str, list[Any]]:
    """Return a table in memory, with the centres of vehicles and pedestrians; pedestrians have no heading, speed or size."""
    rng, columns = np.random.default_rng(1), defaultdict[str, list[Any]](list)
    names = ("time", "id", "x", "y", "heading", "speed", "length", "width", "class")
    for vehicle in vehicles:
        for time, (x, y), heading, speed in zip(
            vehicle.times, vehicle.moved(LENGTH / 2), vehicle.heading, vehicle.speed, strict=True
        ):
            row = time, vehicle.name, x, y, heading, speed, LENGTH, WIDTH, "car"
            for name, value in zip(names, row, strict=True):
                columns[name].append(value)
    for walker in people:
        for time, (x, y) in zip(walker.times, walker.points + noise * rng.standard_normal((len(walker.times), 2)), strict=True):
            row = time, walker.name, x, y, math.nan, math.nan, 0.0, 0.0, "pedestrian"
            for name, value in zip(names, row, strict=True):
                columns[name].append(value)
    return columns


def walks(recording: Recording) -> list[tuple[str, int, str]]:
    """Return names, crosswalks and sides of the recorded pedestrians."""
    ways = [(track.agent.name, track.agent.way) for track in recording.tracks]
    return [(name, way.crosswalk, way.side.value) for name, way in ways if isinstance(way, Crossing)]


STRAIGHT = ((0.0, -10.0, 0.5), (20.0, 10.0 + LONG, 0.5))
"""A walk from 10 m before the near kerb to 10 m behind the far kerb, 0.5 m left of the middle."""
PACE = (20.0 + LONG) / 20.0


@pytest.mark.parametrize("side", Side)
def test_pedestrian_is_recorded_from_sidewalk_to_sidewalk_and_absent_elsewhere(side: Side) -> None:
    course = STRAIGHT if side is Side.NEAR else [(t, LONG - along, -left) for t, along, left in STRAIGHT]
    walker = person(course)
    recording = read_tracks(table([walker]), ZEBRA)
    assert recording.junction == ZEBRA.walked
    assert walks(recording) == [("p", 0, side.value)]
    track = next(track for track in recording.tracks if track.agent.kind is Kind.PEDESTRIAN)
    centre = -10.0 + PACE * track.times
    assert track.agent.size == (0.6, 0.6)
    assert np.allclose(track.station, centre + 0.3)  # the front of a circle of radius 0.3 m
    assert (track.station.min(), track.station.max()) == pytest.approx((-2.1, LONG + 2.7), abs=PACE * 0.1)
    assert np.allclose(track.speed, PACE)
    assert track.offset == pytest.approx(0.5)
    ahead = np.column_stack((np.cos(track.pose[:, 2]), np.sin(track.pose[:, 2])))
    rows = np.isin(walker.times, track.times)
    assert np.allclose(track.pose[:, :2] - 0.3 * ahead, walker.points[rows])
    (run,) = recording
    column = [agent.name for agent in run.agents].index("p")
    here, times = run.zone[:, column] != Zone.ABSENT, run.start + run.times
    assert times[here][[0, -1]] == pytest.approx(track.times[[0, -1]], abs=0.011)
    assert np.isnan(run.station[~here, column]).all()
    assert run.start + run.entry(column) == pytest.approx((10.0 - 0.3) / PACE, abs=0.011)  # the front crosses the kerb


COURSES: dict[str, tuple[list[tuple[float, float, float]], list[str]]] = {
    "turns back": ([(0, -5, 0), (8, 3, 0), (16, -5, 0)], ["near"]),
    "turns back on the far side": ([(0, LONG + 5, 0), (8, LONG - 3, 0), (16, LONG + 5, 0)], ["far"]),
    "waits at the kerb": ([(0, -5, 0), (4, -1, 0), (14, -1, 0), (24, 9, 0)], ["near"]),
    "comes along the sidewalk": ([(0, -1, 20), (15, -1, 1), (25, LONG + 1, 1), (40, LONG + 1, 20)], ["near"]),
    "cuts the corner": ([(0, -2, -3), (10, LONG + 2, 2.9)], ["near"]),
    "first seen on the roadway": ([(0, 2, 0), (5, LONG, 0)], ["near"]),
    "first seen on the roadway, back": ([(0, 5, 0), (5, 1, 0)], ["far"]),
    "there and back": ([(0, -9, 0), (10, LONG + 9, 0), (20, -9, 0)], ["near", "far"]),
    "off the crosswalk for a second": ([(0, -3, 0), (3, 2, 2), (3.5, 2.5, 3), (4, 3, 2), (10, LONG + 3, 0)], ["near"]),
    "along the kerb": ([(0, -0.5, -20), (30, -0.5, 20)], []),
    "stands at the kerb": ([(0, -0.8, 0), (30, -0.8, 0)], []),
    "on the roadway, across the crosswalk": ([(0, 2, -20), (5, 2, 20)], []),
    "beside the crosswalk": ([(0, -9, 6), (20, LONG + 9, 6)], []),
}


@pytest.mark.parametrize("course", COURSES)
def test_way_of_a_pedestrian(course: str) -> None:
    points, sides = COURSES[course]
    recording = read_tracks(table([person(points)]), ZEBRA)
    assert walks(recording) == [(name, 0, side) for name, side in zip(("p", "p#2"), sides, strict=False)]
    assert recording.left_out == (() if sides else (("p", "it is a pedestrian who walks over no crosswalk"),))
    noisy = read_tracks(table([person(points)], noise=0.15), ZEBRA)
    assert walks(noisy) == walks(recording)


def test_pedestrian_on_two_crosswalks_is_two_agents() -> None:
    first, second = person(STRAIGHT, number=1), person([(30.0, -3.0, 0.0), (40.0, LONG + 3.0, 0.0)], number=2)
    both = Person("p", np.concatenate((first.times, second.times)), np.concatenate((first.points, second.points)))
    assert walks(read_tracks(table([both]), ZEBRA)) == [("p", 1, "near"), ("p#2", 2, "near")]


def test_recording_without_a_walk_stays_the_same() -> None:
    alone = read_tracks(table([]), ZEBRA, label="t")
    beside = read_tracks(table([person(COURSES["beside the crosswalk"][0])]), ZEBRA, label="t")
    assert beside.junction == alone.junction == ZEBRA
    assert beside[0].hash == alone[0].hash
    elsewhere = read_tracks(table([person(STRAIGHT)], [drive(find("stop4"), (2, 0))]), "stop4")
    assert elsewhere.left_out == (("p", "it is a pedestrian"),)
    assert not elsewhere.junction.further


def test_pedestrians_do_not_change_what_is_known_of_vehicles() -> None:
    walker = person(STRAIGHT)
    alone, beside = (read_tracks(table(people), ZEBRA) for people in ([], [walker]))
    assert (alone.position_accuracy, alone.speed_accuracy) == (beside.position_accuracy, beside.speed_accuracy) == (0.0, 0.0)
    assert alone[0].excerpt.speed_accuracy == beside[0].excerpt.speed_accuracy == 0.0
    noisy = read_tracks(table([walker], noise=0.1), ZEBRA)
    assert noisy.position_accuracy == 0.0  # of the car
    spreads = {track.agent.name: track.spread for track in noisy.tracks}
    assert spreads["car"] is None
    # Three standard deviations of a parabola through 13 samples (1.2 s), about 1.5 / sqrt(13) of a sample.
    assert np.median(spreads["p"]) == pytest.approx(3 * 0.1 * 1.5 / math.sqrt(13), rel=0.35)


def test_times_with_pedestrians_alone_are_no_runs() -> None:
    late = person([(t + 100.0, along, left) for t, along, left in STRAIGHT], name="late")
    recording = read_tracks(table([person(STRAIGHT), late]), ZEBRA)
    assert [name for name, *_ in walks(recording)] == ["p", "late"]
    assert [[agent.name for agent in run.agents] for run in recording] == [["car", "p"]]
    assert repr(recording) == "<Recording table: 1 vehicles, 1 busy periods>"


@pytest.mark.parametrize(("behaviour", "side"), [("returns", "near"), ("group", "far"), ("stops", "near")])
def test_simulated_pedestrians_come_back_from_a_log(behaviour: str, side: str) -> None:
    scenario = Scenario(ZEBRA, "0200", distance=20, speed=8, subject=1, pedestrians=[Pedestrian(1, Side(side), behaviour, 0.0)])
    run = simulate(Case(scenario, partial(Reference, tie=0.5)))
    ticks = range(0, run.steps, 10)
    people, cars = [], []
    for column, agent in enumerate(run.agents):
        rows = [tick for tick in ticks if run.here[tick, column]]
        times, pose, speed = run.times[rows], run.pose[rows, column], run.speed[rows, column]
        vehicle = Drive(agent.name, times, pose[:, :2], pose[:, 2], speed, 0.0)
        if agent.kind is Kind.PEDESTRIAN:
            people.append(Person(agent.name, times, vehicle.moved(0.3)))
        else:
            cars.append(vehicle)
    recording = read_tracks(table(people, cars), ZEBRA)
    assert {track.agent.name: track.agent.way.key for track in recording.tracks} == {a.name: a.way.key for a in run.agents}
    (again,) = recording
    assert validate(again) == ()
    for track in recording.tracks:
        column = [agent.name for agent in run.agents].index(track.agent.name)
        at = np.round(track.times / run.dt).astype(int)
        assert np.allclose(run.station[at, column], track.station, atol=1e-6)
        assert np.allclose(run.pose[at, column, :2], track.pose[:, :2], atol=1e-6)


def test_one_row_per_person_of_sumo(tmp_path: Path) -> None:
    walker = person(STRAIGHT)
    lines = ["<fcd-export>"]
    for k, time in enumerate(walker.times.tolist()):
        x, y = walker.points[k] + 0.215 / 2 * (walker.points[1] - walker.points[0]) / (PACE * 0.1)  # the front in SUMO
        lines.append(f'<timestep time="{time:.1f}">')
        # A person may have the id of a vehicle, and sit in a vehicle.
        lines.append(f'<person id="1" x="{x}" y="{y}" angle="0" type="DEFAULT_PEDTYPE" speed="1" pos="1" edge="E" vehicle=""/>')
        lines.append(f'<person id="2" x="{x}" y="{y}" angle="0" type="DEFAULT_PEDTYPE" speed="9" pos="1" edge="E" vehicle="1"/>')
        if k < len(CAR.times):
            (u, v), angle = CAR.points[k], math.degrees(math.pi / 2 - CAR.heading[k])
            lines.append(f'<vehicle id="1" x="{u}" y="{v}" angle="{angle}" type="car" speed="8"/>')
        lines.append("</timestep>")
    path = tmp_path / "t.xml"
    path.write_text("\n".join([*lines, "</fcd-export>"]), encoding="utf-8")
    recording = read_tracks(path, ZEBRA, size=(LENGTH, WIDTH), strict=True)
    assert recording.left_out == ()
    assert walks(recording) == [("person 1", 0, "near")]
    track = next(track for track in recording.tracks if track.agent.kind is Kind.PEDESTRIAN)
    assert np.allclose(track.station, -10.0 + PACE * track.times + 0.3, atol=1e-6)


@pytest.mark.parametrize("attributes", ['angle="nan" speed="nan"', 'angle="" speed="-"', 'angle="inf" length="?" width="?"'])
def test_attributes_that_are_read_of_no_person_of_sumo_may_be_wrong(tmp_path: Path, attributes: str) -> None:
    walker = person(STRAIGHT)
    lines = ["<fcd-export>"]
    for k, (time, (x, y)) in enumerate(zip(walker.times.tolist(), walker.points, strict=True)):
        own = attributes if k % 7 == 0 else 'angle="0" speed="1"'
        lines.append(f'<timestep time="{time:.1f}"><person id="1" x="{x}" y="{y}" type="ped" {own}/>')
        if k < len(CAR.times):
            (u, v), angle = CAR.points[k], math.degrees(math.pi / 2 - CAR.heading[k])
            lines.append(f'<vehicle id="1" x="{u}" y="{v}" angle="{angle}" type="car" speed="8"/>')
        lines.append("</timestep>")
    path = tmp_path / "t.xml"
    path.write_text("\n".join([*lines, "</fcd-export>"]), encoding="utf-8")
    recording = read_tracks(path, ZEBRA, size=(LENGTH, WIDTH))
    assert recording.left_out == ()
    assert walks(recording) == [("person 1", 0, "near")]


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300, "n/a"])
@pytest.mark.parametrize("column", ["heading", "speed", "length", "width"])
def test_column_that_is_read_of_no_pedestrian_may_be_wrong(column: str, value: object) -> None:
    rows: dict[str, Any] = {name: list(values) for name, values in table([person(STRAIGHT)], [CAR]).items()}
    rows["speed"] = [1.0] * len(rows["id"])
    pedestrian = [k for k, name in enumerate(rows["id"]) if name == "p"]
    rows[column][pedestrian[3]] = value
    recording = read_tracks(rows, ZEBRA)
    assert recording.left_out == ()
    assert walks(recording) == walks(read_tracks(table([person(STRAIGHT)], [CAR]), ZEBRA))
    rows["x"][pedestrian[5]] = math.nan
    assert [name for name, _ in read_tracks(rows, ZEBRA).left_out] == ["p"], "the place of a pedestrian is read"


def write(path: Path, columns: Mapping[str, Sequence[Any]]) -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(columns)
        rows.writerows(zip(*columns.values(), strict=True))
    return path


def test_pedestrians_of_ind(tmp_path: Path) -> None:
    rows = table([person(STRAIGHT, dt=0.04)], [drive(ZEBRA, (2, 0), "car", start=3.0, dt=0.04)])
    ids = [str(int(name == "p")) for name in rows["id"]]
    columns: dict[str, list[Any]] = {
        "recordingId": [0] * len(ids),
        "trackId": ids,
        "frame": [round(time * 25) for time in rows["time"]],
        "xCenter": rows["x"],
        "yCenter": rows["y"],
        "heading": [0.0 if id == "1" else math.degrees(angle) for id, angle in zip(ids, rows["heading"], strict=True)],
        "width": rows["width"],  # 0 of pedestrians
        "length": rows["length"],
        "xVelocity": [0.0] * len(ids),
        "yVelocity": [0.0] * len(ids),
    }
    path = write(tmp_path / "07_tracks.csv", columns)
    write(tmp_path / "07_tracksMeta.csv", {"trackId": [0, 1], "class": ["car", "pedestrian"]})
    recording = read_tracks(path, ZEBRA, format="ind", strict=True)
    assert [track.agent.name for track in recording.tracks] == ["0", "1"]
    assert walks(recording) == [("1", 0, "near")]


@pytest.mark.parametrize("file", ["pedestrian_tracks_000.csv", "vehicle_tracks_000.csv"])
def test_pedestrians_of_interaction(tmp_path: Path, file: str) -> None:
    """They have a file of their own, or empty cells beside vehicles."""
    for people, vehicles, name in (([], [CAR], "vehicle_tracks_000.csv"), ([person(STRAIGHT, name="P1")], [], file)):
        rows = table(people, vehicles)
        columns = {
            "track_id": rows["id"],
            "timestamp_ms": [round(1000 * time) for time in rows["time"]],
            "agent_type": ["car" if kind == "car" else "pedestrian/bicycle" for kind in rows["class"]],
            "x": rows["x"],
            "y": rows["y"],
            "vx": [0.0] * len(rows["x"]),
            "vy": [0.0] * len(rows["x"]),
        }
        if name == "vehicle_tracks_000.csv":
            empty = [kind != "car" for kind in rows["class"]]
            for field, column in (("heading", "psi_rad"), ("length", "length"), ("width", "width")):
                columns[column] = ["" if none else value for none, value in zip(empty, rows[field], strict=True)]
        path = tmp_path / name
        if path.is_file():
            path.write_text(path.read_text() + "".join(write(tmp_path / "more.csv", columns).read_text().splitlines(True)[1:]))
        else:
            write(path, columns)
    recording = read_tracks(tmp_path / "vehicle_tracks_000.csv", ZEBRA, format="interaction", strict=True)
    assert sorted(track.agent.name for track in recording.tracks) == ["P1", "car"]
    assert walks(recording) == [("P1", 0, "near")]


def test_pedestrians_of_osi(tmp_path: Path) -> None:
    osi = pytest.importorskip("betterosi")
    walker, car = person(STRAIGHT), CAR.moved(LENGTH / 2)
    path = tmp_path / "t.mcap"
    with osi.Writer(path) as out:
        for k, nanos in enumerate(np.round(walker.times * 1e9).astype(int).tolist()):
            truth = osi.GroundTruth(timestamp=osi.Timestamp(seconds=nanos // 10**9, nanos=nanos % 10**9))
            objects = [(1, 3, walker.points[k], 0.0, 0.4), (2, 4, walker.points[k], 0.0, 0.4)]  # a pedestrian with a dog
            objects += [(3, 2, car[k], CAR.heading[k], LENGTH)] if k < len(car) else []
            for id, type, (x, y), heading, length in objects:
                base = osi.BaseMoving(
                    position=osi.Vector3d(x=x, y=y),
                    orientation=osi.Orientation3d(yaw=heading),
                    dimension=osi.Dimension3d(length=length, width=length, height=1.5),
                    velocity=osi.Vector3d(),
                )
                truth.moving_object.append(osi.MovingObject(id=osi.Identifier(value=id), type=type, base=base))
            out.add(truth)
    recording = read_tracks(path, ZEBRA)
    assert walks(recording) == [("1", 0, "near")]
    assert recording.left_out == ()


def test_colours_of_pedestrian_lights(tmp_path: Path) -> None:
    place = find("walk4")
    car = drive(place, (2, 0), "car", start=3.0)
    path = tmp_path / "lights.csv"
    path.write_text("time,signal,colour\n0,0,red\n0,w0,green\n5,w0,red\n0,w1,red\n")
    recording = read_tracks(table([person(STRAIGHT, place=place)], [car]), place, lights=path)
    (run,) = recording
    column = [agent.name for agent in run.agents].index("p")
    colours = run.lights[:, run.agents[column].entrance]
    assert set(colours[run.start + run.times < 4.9].tolist()) == {Colour.GREEN}
    assert set(colours[run.start + run.times > 5.1].tolist()) == {Colour.RED}
    assert len(read_tracks(table([], [car]), place, lights=path).lights) == 1  # nobody walks


def test_command_counts_pedestrians(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "t.csv", table([person(STRAIGHT), person(COURSES["along the kerb"][0], name="by")]))
    command = ["import", str(tmp_path / "t.csv"), "--junction", "zebra4", "-o", str(tmp_path / "t.npz")]
    assert main(command) == 0
    text = capsys.readouterr().out
    assert "t.npz: 1 vehicle and 1 pedestrian at zebra4, 1 busy period" in text
    assert "1 from 2 to 0, straight\n" in text
    assert main([*command, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["left_out"]["by"].startswith("it is a pedestrian who walks over no crosswalk")
    recording = load_recording(tmp_path / "t.npz")
    assert walks(recording) == [("p", 0, "near")]
    assert recording[0].hash == read_tracks(tmp_path / "t.csv", ZEBRA)[0].hash
    main(["check", str(tmp_path / "t.npz"), "--rules", "no_collision"])
    assert "1 run, 1 vehicle judged" in capsys.readouterr().out


def test_followed_log_has_pedestrians() -> None:
    walker, stream = person(STRAIGHT), Stream("t", ZEBRA)
    runs: list[Run] = []
    for k, time in enumerate(walker.times.tolist()):
        x, y = walker.points[k]
        seen: list[dict[str, Any]] = [{"id": "p", "x": x, "y": y, "kind": "pedestrian"}]
        if k < len(CAR.times):
            u, v = CAR.points[k]
            seen.append({"id": "car", "x": u, "y": v, "heading": CAR.heading[k], "speed": 8.0, "length": LENGTH, "width": WIDTH})
        runs += stream.read(json.dumps({"t": time, "vehicles": seen}).encode(), "line")
    (run,) = [*runs, *stream.end()]
    assert {agent.name: agent.kind for agent in run.agents} == {"p": Kind.PEDESTRIAN, "car": Kind.CAR}
    assert stream.judged == 1


def statuses(recording: Recording, rule: str = "crosswalk") -> list[str]:
    """Return the outcomes of a rule on the runs of a recording."""
    return [str(check(run, rule).outcome) for run in recording]


# The car comes onto the painted area of crosswalk 2 at 8.2 s, drives at 8 m/s, and leaves it after 9.1 s.
RULED: dict[str, tuple[list[tuple[float, float, float]], str]] = {
    "on the roadway long before": ([(0, LONG + 5.5, 0), (8, 2.2, 0), (12, -2.5, 0)], "FAIL"),
    "leaves the kerb too late": ([(0, -1, 0), (7.5, -1, 0), (9.5, 5, 0), (12, LONG + 2, 0)], "PROVOKED"),
    "crosses behind the car": ([(0, -1, 0), (10, -1, 0), (17, LONG + 2, 0)], "NA"),
    "has crossed before": ([(0, -2, 0), (6, LONG + 2, 0)], "NA"),
}


@pytest.mark.parametrize("course", RULED)
def test_vehicle_is_judged_at_the_crosswalk_of_a_recorded_pedestrian(course: str) -> None:
    points, outcome = RULED[course]
    recording = read_tracks(table([person(points, number=2)]), ZEBRA)
    assert statuses(recording) == [outcome]
    assert statuses(recording, "no_collision") == ["FAIL" if outcome == "FAIL" else outcome if outcome == "PROVOKED" else "PASS"]


@pytest.mark.parametrize(("front", "exact", "known"), [(-0.5, "NA", "NA"), (0.02, "FAIL", "UNSURE"), (0.7, "FAIL", "FAIL")])
def test_verdict_that_hangs_on_the_place_of_a_pedestrian_is_unsure(front: float, exact: str, known: str) -> None:
    """The pedestrian stands at the kerb of the car's half of the roadway, from 2 s until the car has passed."""
    walker = person([(0, front - 3.3, 0), (2, front - 0.3, 0), (12, front - 0.3, 0), (19, LONG + 2, 0)], number=2)
    for accuracy, outcome in ((0.0, exact), (0.1, known)):
        assert statuses(read_tracks(table([walker]), ZEBRA, position_accuracy=accuracy)) == [outcome]


def test_unrecorded_light_puts_no_blame_on_a_pedestrian() -> None:
    place = find("walk4")
    course = [(0, place.crossings[2].path.length + 5.5, 0), (8, 2.2, 0), (12, -2.5, 0)]
    people, car = [person(course, number=2, place=place)], drive(place, (2, 0), "car", start=3.0)
    (run,) = read_tracks(table(people, [car]), place)
    (verdict,) = [instance for instance in check(run, "no_collision").instances if instance.status == "FAIL"]
    assert verdict.responsible == ("car",)

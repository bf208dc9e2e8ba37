"""Files of other tools: supported trajectories are read, other elements are left out with a reason or refused."""

import gzip
import re
from pathlib import Path

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.states import Colour, Kind
from pytest_rvads.satellites.openscenario.xosc import evaluate
from pytest_rvads.support.errors import MapError, RunError

STOP, LIGHT = rvads.find("stop4"), rvads.find("light4")
BACK = 3.5
"""Distance of the rear axle behind the front of every vehicle [m]."""
LENGTH = 4.4


def trajectory(place: rvads.Junction, key: tuple[int, int], start: float = 0.0, *, heading: bool = True) -> str:
    """Return the vertices, every 0.1 s, of a vehicle that drives a movement at 8 m/s from 40 m before the entrance vertex."""
    way, lines = Itinerary.through(place, *key), []
    for tick in range(round((way.length + 75.0) / 0.8)):
        pose = way.pose(-40.0 + 0.8 * tick)
        x, y = pose.x - BACK * np.cos(pose.heading), pose.y - BACK * np.sin(pose.heading)
        h = f' h="{pose.heading}"' if heading else ""
        lines.append(f'<Vertex time="{start + tick / 10}"><Position><WorldPosition x="{x}" y="{y}"{h}/></Position></Vertex>')
    return "".join(lines)


def vehicle(name: str, category: str = "car") -> str:
    box = f'<Center x="{BACK - LENGTH / 2}" y="0" z="0.7"/><Dimensions width="1.8" length="{LENGTH}" height="1.4"/>'
    body = f'<Vehicle name="v" vehicleCategory="{category}"><BoundingBox>{box}</BoundingBox></Vehicle>'
    return f'<ScenarioObject name="{name}">{body}</ScenarioObject>'


ABSOLUTE = '<Timing domainAbsoluteRelative="absolute" scale="1" offset="0"/>'


def nested(text: str, *tags: str) -> str:
    """Return a text inside of nested elements; the last tag is the innermost."""
    return "".join(f"<{tag}>" for tag in tags) + text + "".join(f"</{tag}>" for tag in reversed(tags))


def follows(name: str, vertices: str, timing: str = ABSOLUTE, begins: float = 0.0) -> str:
    line = nested(vertices, "TrajectoryRef", "Trajectory", "Shape", "Polyline")
    action = nested(line + nested(timing, "TimeReference"), "Action", "PrivateAction", "RoutingAction", "FollowTrajectoryAction")
    condition = f'<SimulationTimeCondition value="{begins}" rule="greaterThan"/>'
    trigger = nested(condition, "StartTrigger", "ConditionGroup", "Condition", "ByValueCondition")
    actors = f'<Actors><EntityRef entityRef="{name}"/></Actors>'
    return nested(actors + nested(action + trigger, "Maneuver", "Event"), "ManeuverGroup")


def document(entities: str, groups: str, *, map: str = "stop4.xodr", lights: str = "", parameters: str = "") -> str:
    roads = f'<RoadNetwork><LogicFile filepath="{map}"/>{lights}</RoadNetwork>'
    story = f"<Storyboard><Init><Actions/></Init><Story><Act>{groups}</Act></Story></Storyboard>"
    return f"<OpenSCENARIO><FileHeader/>{parameters}{roads}<Entities>{entities}</Entities>{story}</OpenSCENARIO>"


def put(folder: Path, text: str, *maps: str) -> Path:
    for name in maps or ("stop4",):
        (folder / f"{name}.xodr").write_bytes(path_of(name).read_bytes())
    path = folder / "drive.xosc"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def rolls(tmp_path: Path) -> Path:
    """A car that rolls straight on over a stop line."""
    return put(tmp_path, document(vehicle("car 1"), follows("car 1", trajectory(STOP, (0, 2)))))


def test_log_that_names_its_map_needs_no_junction(rolls: Path) -> None:
    recording = rvads.files.read_tracks(rolls)
    assert recording.junction.digest == STOP.digest
    (track,) = recording.tracks
    assert (track.agent.name, track.agent.size, track.agent.way.key) == ("car 1", (LENGTH, 1.8), (0, 2))
    assert np.interp(0.0, track.station, track.times) == pytest.approx(5.0, abs=1e-3)  # 40 m at 8 m/s
    assert [rvads.check(run, "full_stop").status.value for run in recording] == ["FAIL"]
    assert [run.hash for run in rvads.files.read_runs(rolls)] == [run.hash for run in recording]


def test_user_may_name_junction_and_map(rolls: Path) -> None:
    assert rvads.files.read_tracks(rolls, "stop4").junction is STOP
    assert rvads.files.read_tracks(rolls, "1").junction.digest == STOP.digest
    assert rvads.files.read_tracks(rolls, "1", map=path_of("stop4")).junction.digest == STOP.digest


def test_check_and_import_read_the_file(rolls: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(rolls), "--rules", "full_stop"]) == 1
    assert "full_stop at t=5.01 s: car 1 entered the junction before it had stopped at the line" in capsys.readouterr().out
    assert main(["import", str(rolls), "-o", str(tmp_path / "kept.npz")]) == 0
    assert "1 vehicle at stop4.1, 1 busy period" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "kept.npz"), "--rules", "full_stop"]) == 1
    assert main(["check", str(tmp_path), "--rules", "full_stop"]) == 1  # the command searches the folder for files
    for name, format in (("LOUD.XOSC", []), ("drive.xml", ["--format", "xosc"])):
        (tmp_path / name).write_bytes(rolls.read_bytes())
        assert main(["import", str(tmp_path / name), "-o", str(tmp_path / "kept.npz"), *format]) == 0


def test_missing_headings_are_those_of_the_way(tmp_path: Path) -> None:
    path = put(tmp_path, document(vehicle("v"), follows("v", trajectory(STOP, (0, 2), heading=False))))
    (track,) = rvads.files.read_tracks(path).tracks
    assert np.interp(0.0, track.station, track.times) == pytest.approx(5.0, abs=0.01)


@pytest.mark.parametrize(
    ("timing", "begins", "crosses"),
    [
        ('<Timing domainAbsoluteRelative="absolute" scale="2" offset="1"/>', 0.0, 11.0),
        ('<Timing domainAbsoluteRelative="relative" scale="1" offset="0"/>', 3.0, 8.0),
    ],
)
def test_times_of_trajectories_are_on_the_clock_of_the_simulation(
    timing: str, begins: float, crosses: float, tmp_path: Path
) -> None:
    path = put(tmp_path, document(vehicle("v"), follows("v", trajectory(STOP, (0, 2)), timing, begins)))
    (track,) = rvads.files.read_tracks(path).tracks
    assert np.interp(0.0, track.station, track.times) == pytest.approx(crosses, abs=1e-3)


def test_parameters_are_replaced(tmp_path: Path) -> None:
    text = document(vehicle("v7"), follows("$who", trajectory(STOP, (0, 2))), parameters=declared(who="v7"))
    assert [track.agent.name for track in rvads.files.read_tracks(put(tmp_path, text)).tracks] == ["v7"]


def declared(**values: str) -> str:
    rows = "".join(f'<ParameterDeclaration name="{name}" parameterType="string" value="{v}"/>' for name, v in values.items())
    return f"<ParameterDeclarations>{rows}</ParameterDeclarations>"


def test_parameter_may_be_declared_with_a_dollar_sign(tmp_path: Path) -> None:
    text = document(vehicle("$ego"), follows("$ego", trajectory(STOP, (0, 2))), parameters=declared(**{"$ego": "v7"}))
    assert [track.agent.name for track in rvads.files.read_tracks(put(tmp_path, text)).tracks] == ["v7"]


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("${$kph / 3.6}", "10"),
        ("${-2 + 3 * (4 - 1)}", "7"),
        ("${7 % 4}", "3"),
        ("${round(2.5) + floor(-0.5) + ceil(0.2)}", "3"),
        ("${sqrt(pow(3, 2) + pow(4, 2))}", "5"),
        ("${sign(-$kph) * max(1, min(2, 3))}", "-2"),
        ("${cos(0)}", "1"),
        ("${not ($wet and false) or false}", "true"),
    ],
)
def test_expression_is_evaluated(expression: str, value: str) -> None:
    """The operators and functions that the user guide of version 1.2 lists; trigonometric functions take radians."""
    assert evaluate(expression, {"kph": "36", "wet": "true"}) == value


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("${1 +}", "can't be evaluated"),
        ("${1 / 0}", "can't be evaluated: float division by zero"),
        ("${pow(10, 400)}", "can't be evaluated"),
        ("${1e308 * 10}", "has no finite value"),
        ("${$none}", "'none', which is no declared parameter"),
        ("${__import__('os')}", "expected only numbers, "),
        ("${2 ** 9}", "expected only numbers, "),
        ("${" + "(" * 500 + "1" + ")" * 480 + "}", "can't be evaluated"),
        ("${1" + " + 1" * 250 + "}", "at most 1,000 characters"),
    ],
)
def test_malformed_expression_is_refused(expression: str, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        evaluate(expression, {})


def test_kind_follows_from_the_category(tmp_path: Path) -> None:
    kinds = {"truck": Kind.TRUCK, "bicycle": Kind.CYCLIST, "bus": Kind.TRUCK, "van": Kind.CAR}
    entities = "".join(vehicle(name, name) for name in kinds)
    groups = "".join(follows(name, trajectory(STOP, (0, 2), 20.0 * k)) for k, name in enumerate(kinds))
    recording = rvads.files.read_tracks(put(tmp_path, document(entities, groups)))
    assert {track.agent.name: track.agent.kind for track in recording.tracks} == kinds


def phase(seconds: float, states: dict[str, str]) -> str:
    shown = "".join(f'<TrafficSignalState trafficSignalId="{id}" state="{state}"/>' for id, state in states.items())
    return f'<Phase name="p" duration="{seconds}">{shown}</Phase>'


def controller(*phases: str) -> str:
    return f'<TrafficSignals><TrafficSignalController name="c">{"".join(phases)}</TrafficSignalController></TrafficSignals>'


def test_phases_of_lights_repeat(tmp_path: Path) -> None:
    lights = controller(phase(2.0, {"0": "red", "1": "off;off;on"}), phase(1.0, {"0": "green", "1": "off;on;off"}))
    text = document(vehicle("v"), follows("v", trajectory(LIGHT, (0, 2))), map="light4.xodr", lights=lights)
    lights_read = rvads.files.read_tracks(put(tmp_path, text, "light4")).lights
    assert lights_read[0].times[:4].tolist() == [0.0, 2.0, 3.0, 5.0]
    assert lights_read[0].colours[:4].tolist() == [Colour.RED, Colour.GREEN] * 2
    assert lights_read[1].colours[:2].tolist() == [Colour.GREEN, Colour.YELLOW]
    assert sorted(lights_read) == [0, 1]


def test_vehicle_without_times_or_trajectory_is_left_out(tmp_path: Path) -> None:
    entities = "".join(map(vehicle, ("v", "timeless", "idle", "curved")))
    timeless = re.sub(r' time="[^"]*"', "", trajectory(STOP, (1, 3)))
    curved = follows("curved", "").replace("<Polyline></Polyline>", '<Clothoid length="3"/>')
    groups = follows("v", trajectory(STOP, (0, 2))) + follows("timeless", timeless) + curved
    recording = rvads.files.read_tracks(put(tmp_path, document(entities, groups)))
    assert dict(recording.left_out) == {
        "timeless": "its trajectory has no times",
        "idle": "it follows no trajectory",
        "curved": "its trajectory is no polyline, and only polylines are read",
    }


GOOD = document(vehicle("v"), follows("v", trajectory(STOP, (0, 2))))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"drive\.xosc: row 1, column 0: not XML: no element found"),
        ("<OpenDRIVE/>", r"drive\.xosc: the root is <OpenDRIVE>, expected <OpenSCENARIO>"),
        (GOOD[: len(GOOD) // 2], r"drive\.xosc: row 1, column \d+: not XML"),
        ('<!DOCTYPE x [<!ENTITY a "b">]>' + GOOD, r"drive\.xosc: it has a document type declaration"),
        (
            GOOD.replace('entityRef="v"', 'entityRef="w"'),
            r"drive\.xosc: row 1: <FollowTrajectoryAction> is for 'w', which is no vehicle",
        ),
        (GOOD.replace('entityRef="v"', 'entityRef="$w"'), r"'\$w' refers to 'w', which is no declared parameter"),
        (GOOD.replace("<WorldPosition", "<LanePosition", 3), r"<LanePosition> .* expected a <WorldPosition>"),
        (re.sub(r'<Center x="[^"]*"', '<Center x="nan"', GOOD), r"<Center> has x='nan', expected a finite number"),
        (GOOD.replace('length="4.4"', ""), r"<Dimensions> has no attribute 'length'"),
        (document(vehicle("v"), ""), r"drive\.xosc: no vehicle follows a trajectory.*rvads\.files\.load_scenario"),
        (GOOD.replace('<LogicFile filepath="stop4.xodr"/>', ""), r"drive\.xosc: the log names no map: name the junction"),
        ("<OpenSCENARIO>" + "<a>" * 100, r"nested deeper than 60 levels"),
        (
            GOOD.replace('absolute"', 'relative"').replace("SimulationTimeCondition", "SpeedCondition"),
            r"<StartTrigger> has no <SimulationTimeCondition>",
        ),
        (GOOD.replace("<LogicFile", controller(phase(0.0, {"0": "red"})) + "<LogicFile"), r"phases of 0 s together"),
        (
            GOOD.replace("<LogicFile", controller(phase(1.0, {"0": "purple"})) + "<LogicFile"),
            r"has the state 'purple', expected red",
        ),
    ],
)
def test_unreadable_file_is_refused_in_one_sentence(text: str, message: str, tmp_path: Path) -> None:
    path = put(tmp_path, text)
    with pytest.raises(RunError, match=message) as refused:
        rvads.files.read_runs(path)
    assert "\n" not in str(refused.value)


@pytest.mark.extended
def test_size_of_the_tree_is_bounded(tmp_path: Path) -> None:
    """The file has attributes of seventy megabytes, stored without compression in a packed file."""
    long = b'<a b="' + b"x" * 2**20 + b'"/>'
    path = tmp_path / "drive.xosc"
    path.write_bytes(gzip.compress(b"<OpenSCENARIO>" + long * 65 + b"</OpenSCENARIO>", 0))
    with pytest.raises(RunError, match=r"more than 200,000 elements, or more than 67,108,864 characters"):
        rvads.files.read_runs(path)


@pytest.mark.parametrize("name", ["drive.xosc", "drive.xml"])
def test_endless_tag_is_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(gzip.compress(b'<a b="' + b"x" * 2**24, 1))
    with pytest.raises(RunError, match=rf"^{name}: row 1: a tag or comment has more than 8 MB$"):
        rvads.files.read_tracks(path, "stop4")


def test_missing_map_of_a_run_is_refused(rolls: Path) -> None:
    rolls.with_name("stop4.xodr").unlink()
    with pytest.raises(MapError, match=r"stop4\.xodr does not exist"):
        rvads.files.read_runs(rolls)
    assert rvads.files.read_tracks(rolls, "1", map=path_of("stop4")).tracks


def test_log_without_a_vehicle_at_the_junction_is_refused(tmp_path: Path) -> None:
    moved = re.sub(r'<WorldPosition x="([^"]*)"', lambda match: f'<WorldPosition x="{float(match[1]) + 500}"', GOOD)
    with pytest.raises(RunError, match=r"no vehicle in drive\.xosc passes junction 'stop4\.1'.*--offset"):
        rvads.files.read_tracks(put(tmp_path, moved))


def test_columns_option_is_refused(rolls: Path) -> None:
    with pytest.raises(RunError, match=r"drive\.xosc: .*leave --columns out"):
        rvads.files.read_tracks(rolls, columns={"x": "x"})

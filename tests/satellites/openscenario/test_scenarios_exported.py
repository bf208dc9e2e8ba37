"""Exported scenarios are read back unchanged, and their visible part also without the note of the export."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.scenarios.classes import Orbits
from pytest_rvads.support.errors import MapError, RvadsError, ScenarioError

from .failures import TRUCK

pytestmark = pytest.mark.usefixtures("library")
QUICK = settings(deadline=None, derandomize=True, max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
PLACES = ["stop4", "stop3", "light4", "light3", "lanes4", "yield4", "left", "five", "setback"]


@st.composite
def scenarios(draw: st.DrawFn, maps: Path) -> rvads.Scenario:
    """Draw a scenario, with distances and speeds rounded to a thousandth."""
    name = draw(st.sampled_from(PLACES))
    place = rvads.find("1", maps / f"{name}.xodr") if name in ("left", "five", "setback") else rvads.find(name)
    lanes = range(len(place.entrances))
    row = draw(st.sampled_from(Orbits.at(place).rows))
    code = [draw(st.sampled_from([0, *place.directions((e + row) % len(lanes))])) for e in lanes]
    if not any(code):
        code[0] = place.directions(row)[0]
    seats = [(e + row) % len(lanes) for e in lanes if code[e]]
    return rvads.Scenario(
        place,
        code,
        distance=[draw(st.integers(0, 40_000)) / 1000 for _ in lanes],
        speed=[draw(st.integers(0, 10_000)) / 1000 for _ in lanes],
        rotation=row,
        duration=draw(st.integers(1, 600)) / 10,
        aggression=draw(st.integers(1, 3)),
        wait=draw(st.integers(0, 30)) / 10,
        subject=draw(st.none() | st.sampled_from(seats)),
        order=draw(st.none() | st.permutations(list(lanes))),
        senses=draw(st.sampled_from([rvads.Senses(), rvads.Senses(delay=0.2, occlusion=True, seed=3)])),
        followers=draw(st.integers(0, 2)),
    )


def foreign(path: Path) -> Path:
    """Return a copy of a file without the note of the export."""
    text, count = re.subn("<Properties>.*?</Properties>", "", path.read_text("utf-8"), count=1, flags=re.DOTALL)
    assert count == 1
    copy = path.with_name("foreign.xosc")
    copy.write_text(text, encoding="utf-8")
    return copy


@given(data=st.data())
@QUICK
def test_scenario_survives_export(maps: Path, tmp_path: Path, data: st.DataObject) -> None:
    scenario = data.draw(scenarios(maps))
    path = tmp_path / "scenario.xosc"
    rvads.files.save_scenario(scenario, path)
    assert rvads.files.load_scenario(path) == scenario


@given(data=st.data())
@QUICK
def test_scenario_comes_back_from_a_foreign_file(maps: Path, tmp_path: Path, data: st.DataObject) -> None:
    scenario = data.draw(scenarios(maps))
    path = tmp_path / "scenario.xosc"
    rvads.files.save_scenario(scenario, path)
    copy = rvads.files.load_scenario(foreign(path))
    assert (copy.placed, copy.creation, copy.followers) == (scenario.placed, scenario.creation, scenario.followers)
    assert copy.duration == scenario.duration
    times = [0.5 * k for k in range(round(2 * scenario.duration))]
    shown = [scenario.signals().colours(time, len(scenario.placed)) for time in times]
    assert [copy.signals().colours(time, len(scenario.placed)) for time in times] == shown
    for start, expected in zip(copy.starts(), scenario.starts(), strict=True):
        assert start == pytest.approx(expected, abs=1e-5)


def test_equal_scenarios_give_equal_files(tmp_path: Path) -> None:
    for name in "ab":
        rvads.files.save_scenario(rvads.Scenario(rvads.find("light4"), "2323", speed=5), tmp_path / name / "s.xosc")
    assert (tmp_path / "a" / "s.xosc").read_bytes() == (tmp_path / "b" / "s.xosc").read_bytes()


def test_imported_scenario_gives_the_same_run(tmp_path: Path) -> None:
    scenario = rvads.Scenario(rvads.find("stop4"), "2030", duration=5.0)
    rvads.files.save_scenario(scenario, tmp_path / "x.xosc")
    run = rvads.simulate(rvads.Case(rvads.files.load_scenario(tmp_path / "x.xosc"), rvads.Reference))
    assert run == rvads.simulate(rvads.Case(scenario, rvads.Reference))


def test_vehicles_are_declared_in_the_order_of_their_creation(tmp_path: Path) -> None:
    rvads.files.save_scenario(rvads.Scenario(rvads.find("stop4"), "2222", order=(2, 0, 3, 1), followers=1), tmp_path / "x.xosc")
    declared = re.findall(r'<ScenarioObject name="([^"]*)"', (tmp_path / "x.xosc").read_text("utf-8"))
    assert declared == ["a2", "a2+1", "a0", "a0+1", "a3", "a3+1", "a1", "a1+1"]


def test_exported_bodies_start_at_their_simulated_places(tmp_path: Path) -> None:
    scenario = rvads.Scenario(rvads.find("stop4"), "2000", duration=0.1)
    fleet = rvads.Fleet(others={"a0": TRUCK})
    rvads.files.save_scenario(scenario, tmp_path / "s.xosc", fleet=fleet)
    rvads.files.export_run(rvads.simulate(rvads.Case(scenario, rvads.Reference, fleet=fleet)), tmp_path / "r.xosc")
    starts = [re.search(r'<WorldPosition x="(\S+)" y="(\S+)"', (tmp_path / n).read_text("utf-8")) for n in ("s.xosc", "r.xosc")]
    exported, simulated = ([float(number) for number in match.groups()] for match in starts if match)
    assert exported == pytest.approx(simulated, abs=1e-9)
    assert 'vehicleCategory="truck"' in (tmp_path / "s.xosc").read_text("utf-8")


def test_position_to_acquire_replaces_a_route(tmp_path: Path) -> None:
    scenario = rvads.Scenario(rvads.find("stop4"), "1000", speed=3)
    rvads.files.save_scenario(scenario, tmp_path / "s.xosc")
    path = foreign(tmp_path / "s.xosc")
    text = path.read_text("utf-8")
    goal = re.findall(r"<Position>\s*<WorldPosition [^>]*>\s*</Position>", text)[-1]
    acquire = f"<AcquirePositionAction>{goal}</AcquirePositionAction>"
    path.write_text(re.sub("<AssignRouteAction>.*</AssignRouteAction>", acquire, text, flags=re.DOTALL), encoding="utf-8")
    assert rvads.files.load_scenario(path).placed == scenario.placed


def test_missing_headings_are_those_of_lanes(tmp_path: Path) -> None:
    scenario = rvads.Scenario(rvads.find("stop4"), "1200", distance=(3, 4, 0, 0))
    rvads.files.save_scenario(scenario, tmp_path / "s.xosc")
    path = foreign(tmp_path / "s.xosc")
    path.write_text(re.sub(r' h="[^"]*"', "", path.read_text("utf-8")), encoding="utf-8")
    assert [start[0] for start in rvads.files.load_scenario(path).starts()] == pytest.approx([3.0, 4.0], abs=1e-5)


def test_named_junction_ignores_the_note(tmp_path: Path) -> None:
    scenario = rvads.Scenario(rvads.find("stop4"), "1133", subject=1)
    rvads.files.save_scenario(scenario, tmp_path / "s.xosc")
    copy = rvads.files.load_scenario(tmp_path / "s.xosc", junction="stop4")
    assert copy.place is scenario.place
    assert copy.subject is None  # the note is ignored


def happens(action: str) -> Callable[[str], str]:
    """Return a change that adds a story."""
    tags = ("Story", "Act", "ManeuverGroup", "Maneuver", "Event", "Action", "PrivateAction")
    story = "".join(f"<{tag}>" for tag in tags) + action + "".join(f"</{tag}>" for tag in reversed(tags))
    return lambda text: text.replace("<StopTrigger>", f"{story}<StopTrigger>")


def without(tag: str) -> Callable[[str], str]:
    """Return a change that removes elements."""
    return lambda text: re.sub(rf"<{tag}\b[^>]*/>|<{tag}\b.*?</{tag}>", "", text, flags=re.DOTALL)


def renamed(old: str, new: str, count: int = -1) -> Callable[[str], str]:
    return lambda text: text.replace(old, new, count)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:500], r"s\.xosc: row \d+, column \d+: not XML"),
        (happens("<LateralAction><LaneChangeAction/></LateralAction>"), r"<LaneChangeAction> in a story is not read"),
        (
            happens("<RoutingAction><FollowTrajectoryAction/></RoutingAction>"),
            r"<FollowTrajectoryAction> in .* rvads check reads",
        ),
        (renamed("AssignRouteAction", "SynchronizeAction"), r"<SynchronizeAction> at the start is not read"),
        (renamed("TeleportAction", "VisibilityAction"), r"<VisibilityAction> at the start is not read"),
        (renamed("WorldPosition", "LanePosition", 1), r"<TeleportAction> must have a <WorldPosition>, got <LanePosition>"),
        (renamed("AbsoluteTargetSpeed", "RelativeTargetSpeed"), r"expected an <AbsoluteTargetSpeed>"),
        (renamed('entityRef="a0"', 'entityRef="b"'), r"'a0' has no start, expected a <Private>"),
        (
            lambda text: re.sub(r"<PrivateAction>\s*<Tele.*?</PrivateAction>", "", text, flags=re.DOTALL),
            "'a0' needs a <TeleportAction>",
        ),
        (without("Waypoint"), r"for 'a0' needs an <AssignRouteAction>"),
        (without("ScenarioObject"), r"s\.xosc: the file has no vehicles"),
        (without("BoundingBox"), r"needs a <BoundingBox> of its own"),
        (without("LogicFile"), r"s\.xosc: <LogicFile> names no map"),
        (lambda text: re.sub(r'length="[^"]*"', 'length="-4"', text), r"s\.xosc: 'a0' is -4 m long, expected more than 0"),
        (renamed('TargetSpeed value="0.0"', 'TargetSpeed value="-3"'), r"s\.xosc: speed must be 0 or more"),
        (renamed('x="1.7', 'x="7.7', 1), r"must start on approaches .* got 'a0'"),
    ],
)
def test_unsupported_elements_are_refused_by_name(change: Callable[[str], str], message: str, tmp_path: Path) -> None:
    path = tmp_path / "s.xosc"
    rvads.files.save_scenario(rvads.Scenario(rvads.find("stop4"), "2000"), path)
    path.write_text(change(foreign(path).read_text("utf-8")), encoding="utf-8")
    with pytest.raises(ScenarioError, match=message) as refused:
        rvads.files.load_scenario(path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda text: text.replace('AbsoluteTargetSpeed value="3.0"', 'AbsoluteTargetSpeed value="4.0"'),
            "start or route of a0",
        ),
        (
            lambda text: text.replace('SimulationTimeCondition value="60.0"', 'SimulationTimeCondition value="50.0"'),
            "an end at 50",
        ),
        (lambda text: text.replace('duration="15.0"', 'duration="10.0"', 1), "colours of the lights"),
        (lambda text: text.replace('"a0"', '"ego"'), "the file has vehicles ego, "),
        (lambda text: text.replace("version&quot;:1", "version&quot;:7"), "has version 7, expected 1"),
        (
            lambda text: text.replace("&quot;aggression&quot;:1", "&quot;aggression&quot;:9"),
            r"s\.xosc: the property rvads\.scenario: aggression must be 1, 2 or 3",
        ),
        (lambda text: text.replace("&quot;wait&quot;:1.5,", ""), "the field 'wait' is missing"),
    ],
)
def test_file_that_contradicts_its_note_is_refused(change: Callable[[str], str], message: str, tmp_path: Path) -> None:
    path = tmp_path / "s.xosc"
    rvads.files.save_scenario(rvads.Scenario(rvads.find("light4"), "2000", speed=3), path)
    path.write_text(change(path.read_text("utf-8")), encoding="utf-8")
    with pytest.raises(ScenarioError, match=message):
        rvads.files.load_scenario(path)


def test_queue_at_other_places_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.xosc"
    rvads.files.save_scenario(rvads.Scenario(rvads.find("stop4"), "2000", followers=1), path)
    copy = foreign(path)
    text = copy.read_text("utf-8")
    y = re.findall(r'<WorldPosition x="\S+" y="(\S+)"', text[text.index('entityRef="a0+1"') :])[0]
    copy.write_text(text.replace(f'y="{y}"', f'y="{float(y) - 2.0}"'), encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"'a0\+1' starts 28\.60 m before its line at 0 m/s, expected 26\.60 m at 0 m/s"):
        rvads.files.load_scenario(copy)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda path: rvads.files.save_scenario(cast(Any, "stop4"), path), ScenarioError, "save_scenario takes a rvads.Scenario"),
        (
            lambda path: rvads.files.save_scenario(_scenario(), path, fleet=cast(Any, TRUCK)),
            ScenarioError,
            "fleet= must be a rvads.Fleet",
        ),
        (lambda path: rvads.files.save_scenario(_scenario(distance=900.0), path), ScenarioError, "does not fit on entrance 0"),
        (lambda path: rvads.files.load_scenario(path), ScenarioError, "No such file"),
        (lambda path: rvads.files.load_scenario(path.parent), ScenarioError, "can't be read"),
    ],
)
def test_misuse_is_refused(make: Callable[[Any], Any], error: type[RvadsError], message: str, tmp_path: Path) -> None:
    with pytest.raises(error, match=message):
        make(tmp_path / "x.xosc")


def _scenario(**more: Any) -> rvads.Scenario:
    return rvads.Scenario(rvads.find("stop4"), "1000", **more)


def test_junction_without_a_map_is_refused(maps: Path, tmp_path: Path) -> None:
    from dataclasses import replace

    place = replace(rvads.find("1", maps / "five.xodr"), map=None)
    with pytest.raises(MapError, match=r"the map file of junction 'five\.1' is not known"):
        rvads.files.save_scenario(rvads.Scenario(place, "10000"), tmp_path / "x.xosc")
    rvads.files.save_scenario(rvads.Scenario(place, "10000"), tmp_path / "x.xosc", map=maps / "five.xodr")
    assert rvads.files.load_scenario(tmp_path / "x.xosc").place == place

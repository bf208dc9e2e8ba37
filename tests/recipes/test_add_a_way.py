"""CONTRIBUTING.md, "Add a way": a crossing from kerb to kerb, added from outside, with a body that walks over it.

All numbers follow from the layout of ``stop4``: the lanes of arm 0 lie 1.75 m beside the line x = 0 and end 15 m south of the
middle, and traffic keeps right, so that vehicles from entrance 0 drive north along x = 1.75.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.crossing import Meetings
from pytest_rvads.drivers.stacks.messages import _map
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.precedence import Reason
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Exit, Further, Key, Way
from pytest_rvads.logic.conduct.validate import validate
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.report.animated import animated
from pytest_rvads.report.scene import picture
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Kind, VehicleState, Zone
from pytest_rvads.satellites.pages.replay import events, replay
from pytest_rvads.support.errors import MapError, RunError

STOP = find("stop4")
HALF = 5.25
"""The kerbs of an arm lie so far from the middle of its road: a lane of 3.5 m and half a lane [m]."""
PACE, BODY, DT = 1.4, 0.6, 0.01
"""Walking speed [m/s], length and width of the body [m], step [s]."""
LANE, CAR = 1.75, 1.86
"""Where the car drives, and how wide it is [m]."""
Make = Callable[..., Any]


@dataclass(frozen=True, slots=True)
class Crossing:
    """A way over arm 0, from the kerb in the east to the kerb in the west."""

    path: Segment
    entrance: int = len(STOP.entrances)
    exit: int = len(STOP.exits)
    kind: str = "crossing"
    turn: Turn = Turn.STRAIGHT
    width: float = BODY

    @property
    def key(self) -> Key:
        return self.entrance, self.exit

    @property
    def length(self) -> float:
        return self.path.length


def crossed(y: float, *, priority: bool = False) -> Junction:
    """Return ``stop4`` with a crossing along a line of equal y; with `priority`, the map says that vehicles give way there."""

    def line(name: str, *x: float) -> Segment:
        return Segment(name, np.array([(east, y) for east in x]))

    way = Crossing(line("crossing", HALF, -HALF))
    further = Further(way, Entrance(0, approach=line("east", 9.0, HALF)), Exit(0, road=line("west", -HALF, -9.0)))
    given = frozenset((key, way.key) for key in STOP.movements if 0 in key) if priority else frozenset()
    return replace(STOP, further=(further,), stated=given)


def scene(drive: Make, y: float, x: float, speed: float = 5.0, start: float = -10.0) -> Run:
    """Return a run of 5 s in which a car drives straight on from entrance 0, and p0 walks to the west.

    Args:
        drive: the fixture.
        y: where p0 walks.
        x: the front of p0 in the first state.
        speed: of the car.
        start: station of the front of the car in the first state.
    """
    place = crossed(y)
    run: Run = drive(place, {0: (2, start, [(0, speed)])}, 500)
    way = itinerary(place, *place.further[0].way.key)
    front = x - PACE * DT * np.arange(run.steps)
    station = HALF - front
    columns: dict[str, Any] = {
        "zone": np.array([way.zone(along) for along in station], dtype=np.int8),
        "station": station,
        "speed": np.full(run.steps, PACE),
        "pose": np.column_stack((front, np.full(run.steps, y), np.full(run.steps, np.pi))),
    }
    both: dict[str, Any] = {name: np.stack((getattr(run, name)[:, 0], column), axis=1) for name, column in columns.items()}
    walker = Agent("p0", place.further[0].way, Kind.PEDESTRIAN, (BODY, BODY))
    return replace(run, agents=(*run.agents, walker), collisions=None, **both)


@pytest.mark.parametrize("y", [-13.0, -18.0], ids=["behind the line", "before the line"])
def test_crossing_is_in_conflict_with_all_movements_of_its_arm_and_no_others(y: float) -> None:
    place = crossed(y)
    over = {one for one, two in place.conflicts or () if two == (4, 4)}
    assert over == {key for key in STOP.movements if 0 in key}
    mine, yours, merges = (place.stretches or {})[(0, 2), (4, 4)]
    reach = (2.6 + BODY) / 2  # perpendicular lines are nearer than this up to so far from where they cross
    assert not merges
    for stretch, crossing in ((mine, y + 15.0), (yours, HALF - LANE)):  # lines are compared every 0.5 m
        assert crossing - reach <= stretch.start < crossing - reach + 0.5
        assert crossing + reach - 0.5 < stretch.end <= crossing + reach


def test_crossing_changes_nothing_between_movements() -> None:
    place = crossed(-13.0)
    between = {pair for pair in place.conflicts or () if (4, 4) not in pair}
    assert between == STOP.conflicts
    assert place.yields == STOP.yields
    assert (place.kind, place.arms, place.control) == (STOP.kind, STOP.arms, STOP.control)
    assert place.digest != STOP.digest
    assert _map(place) == {**_map(STOP), "junction": place.name}, "what stacks get is about movements"


def test_vehicles_give_way_at_the_crossing_where_the_map_says_so() -> None:
    yields = crossed(-13.0, priority=True).yields or {}
    assert {one: why for (one, two), why in yields.items() if two == (4, 4)} == {
        key: Reason.STATED for key in STOP.movements if 0 in key
    }
    assert not any(one == (4, 4) for one, _ in yields)


@pytest.mark.parametrize("priority", [False, True])
def test_drivers_see_where_their_way_meets_the_crossing(priority: bool) -> None:
    place = crossed(-13.0, priority=priority)
    walker = VehicleState("p0", 4, Turn.STRAIGHT, Zone.JUNCTION, 1.0, 4.25, -13.0, np.pi, PACE, 0.0, BODY, BODY, Kind.PEDESTRIAN)
    (meeting,) = Meetings(place, itinerary(place, 0, 2)).of(walker)
    assert (meeting.shared, meeting.mine, meeting.yours) == ((place.stretches or {})[(0, 2), (4, 4)], priority, False)
    assert Meetings(place, itinerary(place, 1, 2)).of(walker) == ()


def test_collision_with_the_walker_fails_when_the_bodies_touch(drive: Make) -> None:
    # The front of the car drives the 11.7 m from y = -25 to the side of p0 at y = -13.3 in 2.34 s.
    # At that time the middle of p0 is at x = 1.75.
    run = scene(drive, -13.0, LANE - BODY / 2 + PACE * 2.34)
    assert validate(run) == ()
    verdict = rvads.check(run, "no_collision")
    assert verdict.status == "FAIL"
    assert verdict.time == pytest.approx(2.34, abs=0.015)
    assert {name for _, name in verdict.instances[0].binding} == {"a0", "p0"}
    assert rvads.check(run, "no_conflict").status == "FAIL"


def test_walker_close_before_the_car_is_a_conflict_and_no_collision(drive: Make) -> None:
    # The rear of p0 leaves the body of the car, 0.93 m beside x = 1.75, 0.1 s before the front of the car comes.
    run = scene(drive, -13.0, LANE - CAR / 2 - BODY + PACE * 2.24)
    assert rvads.check(run, "no_collision").status == "PASS"
    verdict = rvads.check(run, "no_conflict")
    assert verdict.status == "FAIL"
    # The stretch of the car begins 1.6 to 1.1 m before y = -13, to which it drives 2.4 s.
    assert verdict.time is not None
    assert 2.4 - 1.6 / 5 - 0.01 <= verdict.time <= 2.4 - 1.1 / 5 + 0.01
    assert set(verdict.responsible) <= {"a0", "p0"}
    assert "p0 on a crossing of arm 0" in verdict.explanation
    assert "on a crossing of arm +0" in verdict.roles


def test_walker_on_the_approach_is_in_conflict_with_a_car_before_its_line(drive: Make) -> None:
    # The front of the car stays between y = -18 and y = -17 while p0 walks over the lane behind its front.
    run = scene(drive, -18.0, HALF - 1.0, speed=0.0, start=-2.5)
    assert rvads.check(run, "no_conflict").status == "FAIL"


def test_walker_long_after_the_car_breaks_nothing(drive: Make) -> None:
    run = scene(drive, -13.0, LANE + CAR / 2 + 2.0 + PACE * 4.0)
    for rule in ("no_collision", "no_conflict"):
        assert rvads.check(run, rule).status == "PASS"


def test_car_that_waits_for_the_walker_could_not_go(drive: Make) -> None:
    # The front of the car stops 1.8 m before y = -13, short of the stretch, which begins 1.6 m before.
    # p0 stands in the lane of the car.
    moves = {0: (2, -10.0, [(0, 5.0), (204, 0.0)])}
    run: Run = drive(crossed(-13.0), moves, 3000)
    station = np.full(run.steps, HALF - LANE)
    columns: dict[str, Any] = {
        "zone": np.full(run.steps, Zone.JUNCTION, dtype=np.int8),
        "station": station,
        "speed": np.zeros(run.steps),
        "pose": np.column_stack((HALF - station, np.full(run.steps, -13.0), np.full(run.steps, np.pi))),
    }
    both: dict[str, Any] = {name: np.stack((getattr(run, name)[:, 0], column), axis=1) for name, column in columns.items()}
    walker = Agent("p0", run.junction.further[0].way, Kind.PEDESTRIAN, (BODY, BODY))
    assert rvads.check(run, "progress").status == "FAIL"
    assert rvads.check(replace(run, agents=(*run.agents, walker), collisions=None, **both), "progress").status == "PASS"


def test_rules_about_vehicles_have_no_instance_about_the_walker(drive: Make) -> None:
    run = scene(drive, -13.0, LANE + CAR / 2 + 2.0 + PACE * 4.0)
    alone: Run = drive(STOP, {0: (2, -10.0, [(0, 5.0)])}, 500)
    about = set()
    for rule in (*rules_for("road", STOP), *rules_for("paper", STOP)):
        verdict = rvads.check(run, rule)
        named = {name for instance in verdict.instances for _, name in instance.binding}
        about |= {rule.name} if "p0" in named else set()
        if "p0" not in named:
            assert (rule.name, verdict.status) == (rule.name, rvads.check(alone, rule).status)
    assert about == {"no_collision", "no_conflict"}


def test_live_monitors_find_the_same_violation(drive: Make) -> None:
    run = scene(drive, -13.0, LANE - CAR / 2 - BODY + PACE * 2.24)
    monitor = rvads.RuleMonitor(["no_collision", "no_conflict"], run.junction, dt=run.dt)
    found = []
    for tick in range(run.steps):
        seen = [
            rvads.values.Seen(agent, float(run.station[tick, k]), float(run.speed[tick, k]), *map(float, run.pose[tick, k]))
            for k, agent in enumerate(run.agents)
        ]
        found += [(one.rule, one.time) for one in monitor.see(seen, run.lights[tick]) if one.verdict is Truth.FALSE]
    failed = rvads.check(run, "no_conflict").time
    assert found
    assert {rule for rule, _ in found} == {"no_conflict"}
    assert min(time for _, time in found) == pytest.approx(failed, abs=1e-9)


def test_pictures_show_the_crossing_and_the_walker(drive: Make) -> None:
    run = scene(drive, -13.0, HALF + 0.5)
    style = 'fill="none" stroke="#fff" stroke-dasharray=".5" stroke-width="0.6"'
    stripes = f'<polyline class="further" {style} points="5.25,13.00 -5.25,13.00"/>'
    for document in (picture(run, 100, "title"), replay(run, "title"), animated(run)):
        assert document.count(stripes) == 1
        assert document.count('data-agent="p0"') == 1
        assert '<rect x="-0.6" y="-0.3" width="0.6" height="0.6" rx="0.3"' in document
    told = [text for _, text in events(run) if text.startswith("p0")]
    assert told == ["p0 comes to the crossing", "p0 enters the crossing"]


def test_further_way_has_the_number_after_the_lanes() -> None:
    place = crossed(-13.0)
    way: Way = replace(place.further[0].way, entrance=5)  # type: ignore[type-var]
    with pytest.raises(MapError, match=r"needs the key \(4, 4\), got \(5, 4\)"):
        replace(place, further=(place.further[0]._replace(way=way),))


def test_run_files_refuse_a_way_that_they_do_not_hold(drive: Make, tmp_path: Any) -> None:
    with pytest.raises(RunError, match="has ways of the kind crossing that do not follow from its crosswalks"):
        rvads.files.save_run(scene(drive, -13.0, HALF), tmp_path / "one.npz")

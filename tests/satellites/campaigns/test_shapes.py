"""Junctions of one shape: found up to motion and the choice of the first arm, told apart by what a run can depend on."""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.drivers.lgsvl import LgsvlLike
from pytest_rvads.geometry.builtin import LAYOUTS, path_of
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import find, load
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import cross
from pytest_rvads.logic.check import check
from pytest_rvads.report.coverage import ArrivalCoverage
from pytest_rvads.report.run_record import by_rule
from pytest_rvads.satellites.campaigns.campaign import campaign
from pytest_rvads.satellites.campaigns.resultsfile import Judged
from pytest_rvads.satellites.campaigns.shapes import Member, Shape, shapes, twin
from pytest_rvads.satellites.campaigns.town import Twins
from pytest_rvads.satellites.campaigns.town_plan import Plan, Request
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import configuration
from pytest_rvads.scenarios.pedestrians import Pedestrian
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import ScenarioError

BUILT_IN = ("stop4", "stop3", "light4", "light3", "yield4", "right4", "lanes4")


def moved(place: Junction, angle: float, x: float = 0.0, y: float = 0.0, name: str = "moved", mirror: bool = False) -> Junction:
    """Return a junction turned about the origin [rad] and shifted [m]."""
    cos, sin = math.cos(angle), math.sin(angle)
    matrix = np.array([[cos, sin], [-sin, cos]]) * ([1.0, -1.0] if mirror else [1.0, 1.0])

    def line(segment: Segment | None) -> Segment:
        assert segment is not None
        return replace(segment, points=segment.points @ matrix + [x, y])

    return replace(
        place,
        name=name,
        entrances=tuple(replace(lane, approach=line(lane.approach)) for lane in place.entrances),
        exits=tuple(replace(lane, road=line(lane.road)) for lane in place.exits),
        movements={key: replace(way, path=line(way.path)) for key, way in place.movements.items()},
    )


def renumbered(place: Junction, by: int, name: str = "renumbered") -> Junction:
    """Return a junction of one lane per arm whose arm ``i`` has the number ``i + by``; it lies where it lay."""
    count = place.ways

    def on(k: int) -> int:
        return (k + by) % count

    entrances = sorted((replace(lane, arm=on(lane.arm)) for lane in place.entrances), key=lambda lane: lane.arm)
    if place.phase_groups:  # the group of entrance 0 is the first one
        first = entrances[0].phase
        phases = {first: 0, **dict.fromkeys({lane.phase for lane in entrances} - {first}, 1)}
        entrances = [replace(lane, phase=phases[lane.phase]) for lane in entrances]
    return replace(
        place,
        name=name,
        entrances=tuple(entrances),
        exits=tuple(sorted((replace(lane, arm=on(lane.arm)) for lane in place.exits), key=lambda lane: lane.arm)),
        movements={(on(e), on(x)): replace(way, entrance=on(e), exit=on(x)) for (e, x), way in place.movements.items()},
        right_of=frozenset((on(a), on(b)) for a, b in place.right_of),
        opposite=frozenset((on(a), on(b)) for a, b in place.opposite),
    )


def together(*places: Junction) -> list[list[str]]:
    return [[member.junction.name for member in shape.members] for shape in shapes(places)]


@settings(max_examples=20, deadline=None)
@given(
    st.sampled_from(BUILT_IN),
    st.floats(-math.pi, math.pi),
    st.floats(-2000, 2000),
    st.floats(-2000, 2000),
)
def test_a_junction_set_down_elsewhere_is_of_the_same_shape(name: str, angle: float, x: float, y: float) -> None:
    place = find(name)
    (shape,) = shapes([place, moved(place, angle, x, y)])
    assert [member.rotation for member in shape.members] == [0, 0]
    assert shape.members[1].deviation < 1e-6


@pytest.mark.parametrize("name", ["stop3", "light3", "stop4", "light4", "yield4", "right4"])
@pytest.mark.parametrize("by", [1, 2])
def test_which_arm_comes_first_makes_no_shape(name: str, by: int) -> None:
    place = find(name)
    other = moved(renumbered(place, by), 0.3, 5.0, 7.0)
    (shape,) = shapes([place, other])
    member = shape.members[1]
    assert member.deviation < 1e-6
    assert (member.rotation + by) % place.ways in place.rotations


def test_lights_that_can_only_begin_with_another_group_make_another_shape() -> None:
    place = find("light4")
    # With a movement less no rotation keeps it, and runs begin with the group of entrance 0 alone.
    bare = replace(place, movements={key: way for key, way in place.movements.items() if key != (0, 1)})
    assert bare.rotations == (0,)
    assert together(bare, moved(renumbered(bare, 1), 0.3)) == [["light4"], ["moved"]]
    assert together(bare, moved(renumbered(bare, 2), 0.3)) == [["light4", "moved"]]


def test_the_junctions_of_a_roundabout_are_one_shape() -> None:
    map = path_of("roundabout4")
    places = [find(report.id, map) for report in load(map).junctions]
    assert len(places) == 4
    assert len(shapes(places)) == 1


def test_mirror_images_are_two_shapes() -> None:
    place = find("stop4")
    assert together(place, moved(place, 0.0, mirror=True, name="mirrored")) == [["stop4"], ["mirrored"]]


@pytest.mark.parametrize(("metres", "same"), [(0.05, True), (0.2, False)])
@pytest.mark.parametrize("what", ["approach", "road", "path", "setback", "width"])
def test_what_lies_elsewhere_by_more_than_a_decimetre_is_another_shape(what: str, metres: float, same: bool) -> None:
    place = find("stop4")
    first, key = place.entrances[0], (0, 1)
    aside = [metres, 0.0]

    def shifted(line: Segment | None) -> Segment:
        assert line is not None
        return replace(line, points=line.points + aside)

    other = {
        "approach": lambda: replace(place, entrances=(replace(first, approach=shifted(first.approach)), *place.entrances[1:])),
        "road": lambda: replace(place, exits=(replace(place.exits[0], road=shifted(place.exits[0].road)), *place.exits[1:])),
        "path": lambda: replace(
            place, movements={**place.movements, key: replace(place.movements[key], path=shifted(place.movements[key].path))}
        ),
        "setback": lambda: replace(place, entrances=(replace(first, setback=first.setback + metres), *place.entrances[1:])),
        "width": lambda: replace(place, lane_width=place.lane_width + metres),
    }[what]()
    assert (len(shapes([place, other])) == 1) is same


@pytest.mark.parametrize(
    "change",
    [
        lambda place: replace(place, entrances=(replace(place.entrances[0], sign=Sign.YIELD), *place.entrances[1:])),
        lambda place: replace(place, left_hand=True),
        lambda place: replace(place, right_of=frozenset([*place.right_of][1:])),
        lambda place: replace(place, opposite=frozenset()),
        lambda place: replace(place, stated=frozenset({((0, 1), (1, 2))})),
        lambda place: replace(place, movements={**place.movements, (0, 1): replace(place.movements[0, 1], turn=Turn.STRAIGHT)}),
        lambda place: replace(place, movements={k: m for k, m in place.movements.items() if k != (0, 1)}),
    ],
    ids=["sign", "side", "right-of", "opposite", "stated", "turn", "movement"],
)
def test_what_is_regulated_otherwise_is_another_shape(change: Callable[[Junction], Junction]) -> None:
    place = find("stop4")
    assert len(shapes([place, change(place)])) == 2


def test_phases_that_are_shared_otherwise_make_another_shape() -> None:
    place = find("light4")
    groups = {0: 0, 1: 0, 2: 1, 3: 1}
    other = replace(place, entrances=tuple(replace(e, phase=groups[k]) for k, e in enumerate(place.entrances)))
    assert len(shapes([place, other])) == 2


def test_only_what_a_run_can_reach_counts() -> None:
    place = find("stop4")

    def shortened(length: float) -> Junction:
        return replace(
            place, exits=tuple(replace(e, road=e.road.head(length)) for e in place.exits if e.road), name=f"{length:g}"
        )

    assert together(place, shortened(60.5), shortened(40.0)) == [["stop4", "60.5"], ["40"]]
    assert len(shapes([place, shortened(60.5)], reach=80.0)) == 2


def test_shapes_part_the_junctions_whatever_their_order() -> None:
    places = [find(name) for name in BUILT_IN]
    every = [*places, *(moved(place, k, 10.0 * k, name=f"{place.name}_{k}") for k, place in enumerate(places))]
    expected = {frozenset({place.name, f"{place.name}_{k}"}) for k, place in enumerate(places)}
    for order in (every, every[::-1], every[1::2] + every[::2]):
        found = shapes(order)
        assert {frozenset(m.junction.name for m in shape.members) for shape in found} == expected
        names = [place.name for place in order]
        assert [shape.representative.name for shape in found] == sorted(
            (shape.representative.name for shape in found), key=names.index
        )


def test_without_geometry_there_is_no_shape() -> None:
    bare = Junction("bare", "0", *cross([Sign.STOP] * 3), {}, frozenset(), frozenset())
    with pytest.raises(ScenarioError, match="it is not known where its lanes lie"):
        shapes([bare])
    with pytest.raises(ScenarioError, match=r"and rvads\.find"):
        shapes(["stop4"])  # type: ignore[list-item]


def pair(name: str, by: int) -> tuple[Shape, Member]:
    """A built-in junction, and what it is with other numbers somewhere else."""
    (shape,) = shapes([find(name), moved(renumbered(find(name), by), 1.1, 300.0, -20.0)])
    return shape, shape.members[1]


def test_the_twin_of_a_scenario_has_everybody_on_the_same_place_of_the_plane() -> None:
    shape, member = pair("stop3", 1)
    scenario = Scenario(member.junction, "120", distance=(1.0, 2.0, 3.0), speed=(0.0, 4.0, 5.0), subject=1, order=(2, 1, 0))
    other = twin(scenario, member, shape)
    assert other is not None
    assert other.place is shape.representative
    # Arm i of the renumbered one is arm i - 1 of the built-in one.
    assert other.placed == (2, 0, 1)
    assert [other.start(e) for e in (2, 0)] == [(1.0, 0.0), (2.0, 4.0)]
    assert other.subject == 0
    assert other.creation == (0, 2), "entrance 1 was created before entrance 0"


def test_what_reaches_beyond_what_was_compared_has_no_twin() -> None:
    shape, member = pair("stop3", 0)
    assert twin(Scenario(member.junction, "111", distance=49.0), member, shape) is not None
    assert twin(Scenario(member.junction, "111", distance=51.0), member, shape) is None


def test_scenario_with_pedestrians_has_no_twin() -> None:
    shape, member = pair("zebra4", 0)
    assert twin(Scenario(member.junction, "2000", distance=20.0), member, shape) is not None
    scenario = Scenario(member.junction, "2000", distance=20.0, pedestrians=[Pedestrian(0)])
    assert twin(scenario, member, shape) is None


@pytest.mark.extended
@pytest.mark.parametrize(("name", "by"), [("stop3", 1), ("light4", 1), ("light4", 2), ("yield4", 2)])
def test_verdicts_of_twins_are_equal(name: str, by: int) -> None:
    shape, member = pair(name, by)
    place = member.junction
    grid = tuple(configuration(letter, place.ways) for letter in "EJ")
    for scenario in [*Selection(place, grid, cover="conflicts")][:4]:
        other = twin(scenario, member, shape)
        assert other is not None
        here, there = (
            {rule: check(run, rule).status for rule in ("no_collision", "progress", "no_conflict", "keep_lane")}
            for run in (simulate(Case(s.but(duration=12.0), LgsvlLike)) for s in (scenario, other))
        )
        assert here == there, scenario.name


def test_every_built_in_junction_is_a_shape_of_its_own_but_those_that_differ_in_nothing() -> None:
    places = [find(name) for name in LAYOUTS if name != "roundabout4"]
    twins = [names for names in together(*places) if len(names) > 1]
    assert twins == [["light4", "walk4"], ["yield4", "zebra4"]], "vehicles drive alike where nobody walks"


def arrivals(results: Iterable[Judged]) -> dict[tuple[str, str, str], dict[int, int]]:
    """Return how often each difference between arrivals was tried, by junction and movements."""
    coverage = ArrivalCoverage()
    for judged in results:
        for record in by_rule(judged):
            coverage.add(record)
    return {(junction, own, other): dict(tried.counts) for junction, own, other, tried in coverage.rows()}


@pytest.mark.extended
@pytest.mark.parametrize(("name", "by"), [("stop3", 0), ("stop3", 1), ("lanes4", 0)])
def test_results_told_of_a_twin_are_those_that_it_has_itself(name: str, by: int) -> None:
    place = find(name)
    other = place if name == "lanes4" else renumbered(place, by)
    # Creation begins with the first arm, so that runs at arms with other numbers are shared by those that have the same ones.
    places = place, moved(other, 1.1, 300.0, -20.0, "one"), moved(other, -2.0, 0.0, 900.0, "two")
    plan = Plan(places, Request(LgsvlLike, grid=("B",), rules=("no_collision", "full_stop", "progress")), sample=9)
    twins = Twins(plan, shapes(plan.junctions))
    assert len(twins) < len([*plan]), "some are simulated once for several"
    with campaign(twins.cases(), plan.request.rules, executor=1) as simulated:
        told = {judged.name: judged for judged in twins.spread(simulated)}
    with campaign([planned.case for planned in plan], plan.request.rules, executor=1) as each:
        own = {judged.name: judged for judged in each}
    assert told.keys() == own.keys()
    assert arrivals(told.values()) == arrivals(own.values()) != {}
    for name, judged in own.items():
        found = told[name]
        assert [verdict.status for verdict in found.verdicts] == [verdict.status for verdict in judged.verdicts]
        assert [verdict.responsible for verdict in found.verdicts] == [verdict.responsible for verdict in judged.verdicts]
        assert {agent.name: (agent.entrance, agent.exit) for agent in found.agents} == {
            agent.name: (agent.entrance, agent.exit) for agent in judged.agents
        }
        assert (found.junction, found.scenario, found.cls, found.cfg, found.place) == (
            judged.junction,
            judged.scenario,
            judged.cls,
            judged.cfg,
            judged.place,
        )
        assert found.shape == ("" if found.junction == place.name else place.name)

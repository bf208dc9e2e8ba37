"""Pedestrians of scenarios: when they arrive, how ids and records name them, which are refused, and which a test asks for."""

import math
from dataclasses import replace
from itertools import product
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.drivers.walking import BEHAVIOURS, KERB
from pytest_rvads.geometry.crosswalks import SIDEWALK, Side
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Colour
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.ids import from_id, recalled
from pytest_rvads.scenarios.pedestrians import (
    CRUISE,
    DIFFERENCES,
    PULL,
    Crossed,
    Pedestrian,
    Walk,
    arrival,
    cast_of,
    turns,
    walks_of,
)
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.simulators.loop import Walker
from pytest_rvads.support.errors import ScenarioError
from tests.zebras import zebra

ZEBRA = zebra()
STEADY = (rvads.Pedestrian(1),)


def scenario(*walkers: rvads.Pedestrian, **more: Any) -> Scenario:
    start: dict[str, Any] = {"distance": 20, "speed": 8, "subject": 1} | more
    return Scenario(ZEBRA, "0200", pedestrians=walkers, **start)


@pytest.mark.parametrize(
    ("distance", "speed", "seconds"),
    [
        (40.0, 8.0, 5.0),
        (40.0, 10.0, 4.0),  # a faster vehicle keeps its speed
        (0.0, 4.0, 0.0),
        (-16.0, 8.0, -2.0),  # it passed 2 s ago
        (16.0, 0.0, 4.0),  # 4 s at 2 m/s^2 reach 8 m/s and take 16 m
        (4.0, 0.0, 2.0),
        (24.0, 0.0, 5.0),
        (12.0, 4.0, 2.0),  # from 4 to 8 m/s in 2 s at a mean of 6 m/s
        (5.0, 4.0, 1.0),
    ],
)
def test_arrival_of_a_vehicle(distance: float, speed: float, seconds: float) -> None:
    assert (PULL, CRUISE) == (2.0, 8.0)
    assert arrival(distance, speed) == pytest.approx(seconds, abs=1e-12)


def driven(distance: float, speed: float) -> float:
    """Return when a vehicle has driven a distance [s], by steps of 1 ms."""
    time, pace, left = 0.0, max(speed, 8.0), distance
    while left > 0.0:
        faster = min(speed + 0.002, pace)
        left -= (speed + faster) / 2.0 * 0.001
        time, speed = time + 0.001, faster
    return time


@settings(deadline=None)
@given(
    difference=st.floats(-2.0, 6.0),
    side=st.sampled_from(["near", "far"]),
    behaviour=st.sampled_from(["steady", "darts", "against", "group"]),
    distance=st.floats(1.0, 40.0),
    speed=st.floats(0.0, 12.0),
)
def test_pedestrian_arrives_by_the_difference_after_the_vehicle(
    difference: float, side: str, behaviour: str, distance: float, speed: float
) -> None:
    walker = rvads.Pedestrian(1, side, behaviour, difference)
    case = scenario(walker, distance=distance, speed=speed)
    shared = (case.place.stretches or {})[(1, 3), cast_of(case.place, [walker])[0].way.key]
    expected = driven(distance + shared.mine.start, speed) + walker.difference
    if expected < 0.0:
        return  # the pedestrian is on the way of the vehicle at the start, or has crossed
    setting = case.walkers()[0]
    person, time = Walker(case.place, setting, ()), 0.0
    assert person.sample().station >= -SIDEWALK - 1e-9 or setting.speed == 0.0
    lights = (Colour.NONE,) * len(case.place.starts)
    before = person.sample().station
    while before < shared.yours.start and time < 30.0:
        person.walk(time, lights, ())
        time, station = time + DT, person.sample().station
        if station >= shared.yours.start:
            reached = time - DT * (station - shared.yours.start) / (station - before)
            # The vehicle above is late by up to 1 ms. A pedestrian sets out in the first step after the delay.
            assert -0.002 <= reached - expected <= DT + 0.002
        before = station
    assert before >= shared.yours.start


def test_every_pedestrian_starts_where_the_arrival_puts_it() -> None:
    """The vehicle drives 20 m to its line, which is at the vertex, and some metres to the crosswalk, at 8 m/s."""
    for difference in (-1.5, -0.5, 5.0):
        case = scenario(rvads.Pedestrian(1, "near", "steady", difference))
        (setting,) = case.walkers()
        shared = (case.place.stretches or {})[(1, 3), setting.agent.way.key]
        reached = (20.0 + shared.mine.start) / 8.0 + difference
        assert 1.0 < shared.mine.start < 1.7, "the crossing is 2.7 m behind the line, and 1.3 m + 0.3 m reach around the lines"
        if difference < 5.0:  # the pedestrian walks at the start
            assert setting[1:4] == (pytest.approx(shared.yours.start - 1.4 * reached), 1.4, 0.0)
        else:  # setting out at 5 m/s^2 costs 0.14 s against a pedestrian who walks at once
            assert setting[1:3] == (-3.0, 0.0)
            assert setting.delay == pytest.approx(reached - (shared.yours.start + 3.0) / 1.4 - 0.14)


@pytest.mark.parametrize("behaviour", ["waits", "yields"])
def test_pedestrian_who_looks_at_the_kerb_starts_before_it(behaviour: str) -> None:
    # The car is 21.5 m, so 2.7 s, before the crossing: with 2.5 s less, a steady pedestrian would be about to step into its lane.
    (walker,) = scenario(rvads.Pedestrian(1, "near", behaviour, -2.5)).walkers()
    assert walker.station == -KERB


@pytest.mark.parametrize(("behaviour", "waits"), [("steady", True), ("against", False)])
def test_lawful_pedestrian_does_not_start_on_the_roadway_under_dont_walk(behaviour: str, waits: bool) -> None:
    walkers = [rvads.Pedestrian(0, "near", behaviour, -2.5)]  # entrance 0 has green, so nobody may walk over its arm
    (walker,) = Scenario(rvads.find("walk4"), "2000", distance=20, speed=8, subject=0, pedestrians=walkers).walkers()
    assert (walker.station == -KERB) == waits
    assert (walker.station > 0.0) != waits


def test_the_vehicle_under_test_is_met_before_others() -> None:
    """Both vehicles drive over crosswalk 3: the first away from the junction, the second towards it, and much later."""
    both = {"distance": (20.0, 20.0, 20.0, 40.0), "speed": 8.0}
    place = ZEBRA.walked
    delays = {}
    for subject in (1, 3):
        case = Scenario(ZEBRA, "0202", subject=subject, pedestrians=[rvads.Pedestrian(3, difference=4.0)], **both)  # type: ignore[arg-type]
        (setting,) = case.walkers()
        shared = (place.stretches or {})[(subject, (subject + 2) % 4), setting.agent.way.key]
        distance = both["distance"][subject] + shared.mine.start  # type: ignore[index]
        expected = distance / 8.0 + 4.0 - (shared.yours.start + 3.0) / 1.4 - 0.14
        delays[subject] = setting.delay
        assert setting.delay == pytest.approx(expected)
    assert delays[1] != pytest.approx(delays[3])


def test_group_walks_at_a_distance_of_0_8_m_from_each_other() -> None:
    names = [setting.agent.name for setting in scenario(rvads.Pedestrian(1, "far", "group", 3.0)).walkers()]
    assert names == ["p0", "p0+1", "p0+2"]
    for difference in (-1.0, 1.0, 3.0):
        first, *others = scenario(rvads.Pedestrian(1, "far", "group", difference)).walkers()
        assert [first.station - one.station for one in others] == pytest.approx([0.8, 1.6])
        assert {one.delay for one in others} == {first.delay}


def test_pedestrians_who_hide_behind_the_same_vehicle_share_it() -> None:
    two = scenario(rvads.Pedestrian(1, "near", "hidden"), rvads.Pedestrian(1, "near", "hidden", 2.0))
    names = [agent.name for agent in rvads.Case(two, rvads.Reference).agents()]
    assert names == ["a1", "p0", "parked0", "p1"] == ["a1", *(setting.agent.name for setting in two.walkers())]
    run = rvads.simulate(rvads.Case(two, rvads.Reference, traffic=None))
    assert run.fault is None


WALKERS = st.lists(
    st.builds(
        rvads.Pedestrian,
        st.integers(0, 3),
        st.sampled_from(["near", "far"]),
        st.sampled_from([name for name in BEHAVIOURS if name != "hidden"]),
        st.floats(-9.0, 99.0),
    )
    | st.builds(rvads.Pedestrian, st.integers(0, 3), st.just("near"), st.just("hidden"), st.floats(-9.0, 99.0)),
    min_size=1,
    max_size=3,
)


@settings(deadline=None)
@given(walkers=WALKERS)
def test_ids_and_records_name_the_pedestrians(walkers: list[rvads.Pedestrian]) -> None:
    case = scenario(*walkers)
    assert recalled(case.record(), ZEBRA, "record") == case
    label = case.name.split("-w")[1].split("-cfg")[0]
    assert [f"-w{part}" in f"{scenario(one).name}" for part, one in zip(label.split("_"), walkers, strict=True)]
    assert case.name.replace(f"-w{label}", "") == scenario().name


def test_an_id_describes_the_scenario(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pytest_rvads.scenarios.ids.find", lambda *_: ZEBRA)
    case = scenario(rvads.Pedestrian(1, "near", "steady", -0.5), rvads.Pedestrian(3, "far", "darts", 12.0))
    assert case.name == "stop4-class00-as0200-s1-w1n.steady.e0.50_3f.darts.l12.00-cfgd20.00v08.00"
    assert from_id(case.name) == from_id(f"{case.name}-full_stop") == case
    assert from_id(scenario().name) == scenario()


@pytest.mark.parametrize("label", ["1n.steady", "1x.steady.e0.50", "1n.steady.e0", "1n.steady.e0.50_", "_1n.steady.e0.50", "1"])
def test_label_that_names_no_pedestrian_is_refused(label: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pytest_rvads.scenarios.ids.find", lambda *_: ZEBRA)
    with pytest.raises(ScenarioError, match=r"is no label of pedestrians, expected such as 1n\.steady\.e0\.50"):
        from_id(f"stop4-class00-as0200-s1-w{label}-cfgd20.00v08.00")


def test_difference_is_rounded_as_in_ids() -> None:
    assert rvads.Pedestrian(1, difference=-0.004).label == "1n.steady.l0.00"
    assert rvads.Pedestrian(1, difference=0.126) == rvads.Pedestrian(1, difference=0.13)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"crossing": -1}, "crossing must be the number of a crosswalk, 0 or more, got -1"),
        ({"crossing": True}, "crossing must be the number of a crosswalk, 0 or more, got True"),
        ({"crossing": 1.0}, "crossing must be the number of a crosswalk, 0 or more, got 1.0"),
        ({"side": "left"}, "side must be one of near, far, got 'left'"),
        ({"side": None}, "side must be one of near, far, got None"),
        ({"behaviour": "stedy"}, r"got 'stedy'.*steady"),
        ({"behaviour": None}, "pedestrians have the behaviours steady, .*, got None"),
        ({"difference": math.nan}, "difference must be a finite number of seconds, got nan"),
        ({"difference": -math.inf}, "difference must be a finite number of seconds, got -inf"),
        ({"difference": 10**400}, "difference must be a finite number of seconds, got 1000"),
        ({"difference": "1"}, "difference must be a finite number of seconds, got '1'"),
        ({"difference": True}, "difference must be a finite number of seconds, got True"),
        ({"side": "far", "behaviour": "hidden"}, "'hidden' comes from the near side.*say side='near'"),
    ],
)
def test_pedestrian_with_a_wrong_value_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message) as caught:
        rvads.Pedestrian(**{"crossing": 1} | values)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("walkers", "message"),
    [
        ([rvads.Pedestrian(4)], "junction 'stop4' has no crosswalk 4: its crosswalks are 0 to 3"),
        (["1n"], r"pedestrians must be a list of rvads\.Pedestrian\(crossing, side, \.\.\.\), got \['1n'\]"),
        (rvads.Pedestrian(1), r"pedestrians must be a list of rvads\.Pedestrian"),
    ],
)
def test_scenario_with_wrong_pedestrians_is_refused(walkers: Any, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        Scenario(ZEBRA, "0200", pedestrians=walkers)


def test_junction_without_crosswalks_has_no_pedestrians() -> None:
    with pytest.raises(ScenarioError, match="junction 'stop4' has no crosswalk 1: it has no crosswalk"):
        Scenario(rvads.find("stop4"), "0200", pedestrians=STEADY)


@pytest.mark.parametrize(
    ("walker", "message"),
    [
        (rvads.Pedestrian(0), "no vehicle of the scenario drives over crosswalk 0 of junction 'stop4'"),
        (rvads.Pedestrian(1, difference=-9.0), "p0 would have crossed before the run begins, 9 s before the vehicle"),
    ],
)
def test_pedestrian_who_meets_nobody_is_refused(walker: rvads.Pedestrian, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        rvads.simulate(rvads.Case(scenario(walker), rvads.Reference))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"side": "left"}, "run.npz: side must be one of near, far, got 'left'"),
        ({"behaviour": "flies"}, "run.npz: pedestrians have the behaviours .*, got 'flies'"),
        ({"crossing": 9}, "run.npz: junction 'stop4' has no crosswalk 9"),
        ({"crossing": "1"}, r"run.npz: the field 'pedestrians\[0\].crossing' must be a whole number, got '1'"),
    ],
)
def test_record_with_wrong_pedestrians_is_refused(change: dict[str, Any], message: str) -> None:
    record = scenario(*STEADY).record()
    record["pedestrians"][0] |= change
    with pytest.raises(ScenarioError, match=message):
        recalled(record, ZEBRA, "run.npz")


def test_a_start_is_described_with_its_pedestrians() -> None:
    told = scenario(rvads.Pedestrian(1, "near", "hidden", -0.5), rvads.Pedestrian(3, "far")).describe()
    assert told.endswith(
        "  p0 hidden from the near side of crosswalk 1, 0.5 s early  p1 steady from the far side of crosswalk 3, 0 s late"
    )


_Kind = tuple[tuple[int, ...], int | None, int]
"""Directions as they stand on the map, entrance of the subject, arm of the crosswalk."""


def at_arms(name: str, *arms: int) -> Junction:
    """A junction with one lane per arm and a crosswalk over each of the given arms."""
    place = zebra(name)
    return replace(place, crossings=tuple(place.crossings[arm] for arm in arms)).walked


def select(place: Junction, pedestrians: Any, **changes: Any) -> Selection:
    points = grid("C", len(place.entrances), place.control)
    return Selection(place, points, pedestrians=walks_of(pedestrians), **changes)


def kinds(selection: Selection) -> list[_Kind]:
    place = selection.place
    return [(s.placed, s.subject, place.crossings[s.pedestrians[0].crossing].arm) for s in selection]


def everything(ways: int, arms: tuple[int, ...], seats: list[int | None]) -> set[_Kind]:
    """All full scenarios with a crosswalk: digit d at arm a leads to arm a + d, over the crosswalks of both arms."""
    found: set[_Kind] = set()
    for code, seat, arm in product(product(range(1, ways), repeat=ways), seats, arms):
        over = {a for k, d in enumerate(code) for a in (k, (k + d) % ways) if seat in (None, k)}
        if arm in over:
            found.add((code, seat, arm))
    return found


def turned(kind: _Kind, by: int) -> _Kind:
    code, seat, arm = kind
    ways = len(code)
    return tuple(code[(k - by) % ways] for k in range(ways)), None if seat is None else (seat + by) % ways, (arm + by) % ways


@pytest.mark.parametrize("subject", [None, "all", 1])
@pytest.mark.parametrize(
    ("name", "arms"),
    [("stop3", (0,)), ("stop3", (0, 2)), ("stop3", (0, 1, 2)), ("stop4", (0, 2)), ("stop4", (1, 2, 3)), ("stop4", (0, 1, 2, 3))],
)
def test_every_scenario_with_a_crosswalk_has_exactly_one_representative(name: str, arms: tuple[int, ...], subject: Any) -> None:
    place = at_arms(name, *arms)
    ways = place.ways
    keeping = [by for by in range(ways) if {(arm + by) % ways for arm in arms} == set(arms)]
    if isinstance(subject, int):
        keeping = [0]  # every other rotation moves the subject to another entrance
    seats: list[int | None] = [*range(ways)] if subject == "all" else [subject]
    expected = {frozenset(turned(kind, by) for by in keeping) for kind in everything(ways, arms, seats)}
    found = kinds(select(place, {"difference": 0, "side": "near"}, subject=subject))
    orbits = [frozenset(turned(kind, by) for by in keeping) for kind in found]
    assert len(set(orbits)) == len(orbits)
    assert set(orbits) == expected


def test_representatives_are_the_least_and_counted_by_hand() -> None:
    """81 scenarios with 4 crosswalks under 4 rotations, none of which keeps a crosswalk; a subject drives over two of them."""
    place = at_arms("stop4", 0, 1, 2, 3)
    alone, seated = (kinds(select(place, {"difference": 0, "side": "near"}, subject=subject)) for subject in (None, "all"))
    assert (len(alone), len(seated)) == (81 * 4 // 4, 81 * 4 * 2 // 4)
    assert all(kind == min((turned(kind, by) for by in range(4)), key=str) for kind in (*alone, *seated))


def test_rotations_keep_crosswalks_signs_and_lights() -> None:
    quarter = [(k, tuple((number + k) % 4 for number in range(4))) for k in range(4)]
    lit = find("walk4").walked
    assert list(turns(at_arms("stop4", 0, 1, 2, 3))) == quarter
    assert list(turns(lit)) == quarter, "a quarter turn takes each crosswalk to the other phase, and the phase with it"
    assert list(turns(find("zebra4").walked)) == quarter[::2]
    odd = replace(lit.unwalked, crossings=tuple(replace(crosswalk, phase=0) for crosswalk in lit.crossings))
    assert list(turns(odd.walked)) == quarter[::2]
    assert list(turns(at_arms("stop4", 0, 1))) == [(0, (0, 1))]
    assert list(turns(at_arms("stop4", 2, 0))) == [(0, (0, 1)), (2, (1, 0))]


def test_count_is_the_greatest_possible_number() -> None:
    for place, subject, cover in product(
        (at_arms("stop3", 0, 1, 2), at_arms("stop3", 0, 2)), (None, "all", 0), ("class", "conflicts", "scenario", "rotation")
    ):
        selection = select(place, ["steady", Pedestrian(0, Side.FAR, "darts")], subject=subject, cover=cover)
        selection = replace(selection, pedestrians=selection.pedestrians[::9])
        listed = list(selection)
        assert 0 < len(listed) == len({s.name for s in listed}) <= selection.count()
    selection = select(at_arms("stop4", 0, 1, 2, 3), {"difference": [0, 1]}, subject="all")
    assert len(list(selection)) == selection.count() == 162 * 2 * 2


def test_the_order_of_pedestrians_changes_no_item() -> None:
    place = find("zebra4")
    asked: list[Any] = ["darts", Pedestrian(1, Side.NEAR, "steady", 1.25), {"behaviour": ["stops", "waits"], "difference": -0.5}]
    forth, back = ({s.name for s in select(place.walked, order, subject="all", classes=(3, 7))} for order in (asked, asked[::-1]))
    assert forth == back
    assert len(forth) == len([*select(place.walked, asked, subject="all", classes=(3, 7))])


def test_a_named_crosswalk_meets_every_arm_of_a_class() -> None:
    """Three rotations of class 1 bring another arm to the crosswalk; a rotation by hand shows that these four are all."""
    place = at_arms("stop4", 0, 1, 2, 3)
    found = kinds(select(place, Pedestrian(2), classes=(2,)))
    assert sorted(found) == sorted((*turned(((1, 1, 1, 2), None, 2), by)[:2], 2) for by in range(4))


def test_a_pedestrian_walks_where_the_subject_drives() -> None:
    place = find("zebra4").walked
    names = [
        s.name.partition("-as")[2]
        for s in select(place, Pedestrian(1, Side.FAR, "darts", -0.5), subject=0, scenarios=((1, 2, 2, 2), (2, 2, 2, 2)))
    ]
    assert names == ["1222-s0-w1f.darts.e0.50-cfgC"], "only the turn to the right leads over crosswalk 1"


def test_conflicts_cover_every_movement_over_a_crosswalk() -> None:
    """The turn from arm 0 to arm 1 conflicts with nothing, so that only a crosswalk asks for it."""
    place = at_arms("stop4", 0, 1, 2, 3)
    few = replace(place, movements={key: place.movements[key] for key in [(0, 1), (0, 2), (1, 3)]})
    assert [s.placed for s in Selection(few, grid("C", 4, few.control), cover="conflicts")] == [(2, 2, 0, 0)]
    found = {s.placed for s in select(few, {"difference": 0}, cover="conflicts")}
    assert {code[0] for code in found} == {1, 2}
    sides = [
        (s.placed[0], s.pedestrians[0].crossing, s.pedestrians[0].side)
        for s in select(few, "steady", cover="conflicts", subject=0)
    ]
    assert set(sides) == {(turn, arm, side) for turn in (1, 2) for arm in (0, turn) for side in Side}


def test_early_pedestrians_are_left_out() -> None:
    """From rest at the line, 4 s early: the near-side runner needs less than 1 s to the lane and 2.8 s for 7 m."""
    selection = select(find("zebra4").walked, {"behaviour": "darts", "difference": [-4, 4]}, subject=0, scenarios=((2, 2, 2, 2),))
    selection = replace(selection, configurations=grid("A", 4, selection.place.control))
    reasons: list[ScenarioError] = []
    late = list(selection.fitting(reasons.append))
    assert {s.pedestrians[0].difference for s in late} >= {4.0}
    assert reasons
    assert all(isinstance(reason, Crossed) for reason in reasons)
    assert len(late) + len(reasons) == len(list(selection))


def test_asked_pedestrians_in_every_form() -> None:
    assert walks_of(None) == ()
    steady = walks_of("steady")
    assert len(steady) == 2 * len(DIFFERENCES) == 34
    assert all(walk.everywhere for walk in steady)
    assert walks_of(["steady", {"behaviour": "steady"}]) == steady
    assert walks_of(Pedestrian(3, Side.FAR)) == (Walk(Pedestrian(3, Side.FAR)),)
    by_field = walks_of({"crossing": [0, 2], "side": "far", "behaviour": "darts", "difference": 0.5})
    assert by_field == tuple(Walk(Pedestrian(k, Side.FAR, "darts", 0.5)) for k in (0, 2))
    hidden = walks_of({"behaviour": ["hidden", "steady"], "difference": 0})
    assert [(w.pedestrian.behaviour, w.pedestrian.side) for w in hidden] == [
        ("hidden", "near"),
        ("steady", "near"),
        ("steady", "far"),
    ]


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("stedy", "pedestrians have the behaviours steady, .* got 'stedy'; did you mean 'steady'"),
        ([], "pedestrians is empty: name a behaviour, such as 'steady', or leave it out"),
        (3, r"pedestrians takes names of behaviours, rvads.Pedestrian\(...\) or dicts of its fields, one or several, got 3"),
        ([["steady"]], "pedestrians takes names of behaviours"),
        ({"sides": "near"}, "pedestrians have crossing, side, behaviour, difference, got 'sides'; did you mean 'side'"),
        ({"side": []}, r"pedestrians are given by values or lists of at least one value, got \{'side': \[\]\}"),
        ({"side": "left"}, "side must be one of near, far, got 'left'"),
        ({"behaviour": [["steady"]]}, r"pedestrians have the behaviours steady, .* got \['steady'\]"),
        ({"behaviour": "hidden", "side": "far"}, "comes from the near side"),
        ({"difference": "late"}, "difference must be a finite number of seconds, got 'late'"),
        ({"crossing": -1}, "crossing must be the number of a crosswalk, 0 or more, got -1"),
    ],
)
def test_wrong_pedestrians_are_refused_in_a_sentence(value: Any, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        walks_of(value)


def test_missing_crosswalks_are_refused() -> None:
    with pytest.raises(
        ScenarioError, match="junction 'stop4' has no crosswalk for pedestrians: choose a junction with crosswalks"
    ):
        select(find("stop4"), "steady")
    with pytest.raises(ScenarioError, match="junction 'zebra4' has no crosswalk 4: its crosswalks are 0 to 3"):
        select(find("zebra4").walked, Pedestrian(4))

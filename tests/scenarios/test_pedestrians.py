"""Pedestrians of scenarios: when they arrive, how ids and records name them, and which values are refused."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.drivers.walking import BEHAVIOURS, KERB
from pytest_rvads.geometry.crosswalks import SIDEWALK
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Colour
from pytest_rvads.scenarios.ids import from_id, recalled
from pytest_rvads.scenarios.pedestrians import CRUISE, PULL, arrival, cast_of
from pytest_rvads.scenarios.scenario import Scenario
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

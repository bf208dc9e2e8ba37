"""Strategies: what they promise of every example, what they shrink to, and the nominal arrivals from which gaps follow."""

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import find, given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.search import strategies
from pytest_rvads.search.strategies import VehicleStart, nominal_arrival

LAW = settings(deadline=None, derandomize=True, max_examples=60)


@LAW
@given(strategies.junctions(control="stop"))
def test_junctions_by_control(junction: rvads.Junction) -> None:
    assert junction.control is JunctionControl.STOP


@LAW
@given(st.integers(3, 8).flatmap(strategies.abstract_scenarios))
def test_partial_scenarios_have_a_vehicle(code: tuple[int, ...]) -> None:
    assert any(code)
    assert all(0 <= d < len(code) for d in code)


@LAW
@given(strategies.abstract_scenarios(5, partial=False))
def test_full_scenarios_have_a_vehicle_on_each_arm(code: tuple[int, ...]) -> None:
    assert 0 not in code


@LAW
@given(strategies.scenarios("light3", near=0.5, far=12, wait=(1, 2)))
def test_scenarios_stay_in_range_and_inside_the_braking_envelope(scenario: rvads.Scenario) -> None:
    scenario.starts()
    assert 1 <= scenario.wait <= 2
    for entrance in scenario.creation:
        distance, speed = scenario.start(entrance)
        assert 0.5 <= distance <= 12
        assert speed <= rvads.vmax(distance)


@LAW
@given(strategies.scenarios("stop4", subject=2, near=1, far=25))
def test_scenarios_with_a_subject_have_a_vehicle_at_its_entrance(scenario: rvads.Scenario) -> None:
    assert scenario.directions[2] > 0
    assert all(1 <= scenario.start(entrance)[0] <= 25 for entrance in scenario.creation)


@LAW
@given(strategies.scenarios("stop4", partial=False))
def test_scenarios_without_empty_arms_keep_every_vehicle(scenario: rvads.Scenario) -> None:
    assert 0 not in scenario.directions


def test_a_third_of_the_scenarios_has_vehicles_that_arrive_shortly_after_each_other() -> None:
    """Two of five kinds of gap are 0.3 to 2 s, so that more than a third of all vehicles have such a gap to the subject.

    A vehicle near its line can't arrive earlier, and so the gaps of some vehicles are smaller than drawn.
    """
    place = rvads.find("stop4")
    short: list[bool] = []

    @settings(deadline=None, derandomize=True, max_examples=200, database=None)
    @given(strategies.scenarios("stop4", subject=0))
    def look(scenario: rvads.Scenario) -> None:
        times = [
            nominal_arrival(VehicleStart(*scenario.start(entrance)), place.top_limit, stops=True)
            for entrance in scenario.creation
        ]
        short.append(any(0.25 <= abs(time - times[0]) <= 2.05 for time in times[1:]))

    look()
    assert sum(short) >= len(short) / 3


@pytest.mark.parametrize(
    ("start", "stops", "arrival"),
    [
        (VehicleStart(20.0, 0.0), False, 4.0),  # 2.5 m/s^2 for 4 s is 20 m
        (
            VehicleStart(25.0, 10.0),
            False,
            2.0,
        ),  # 10 m/s * 2 s + 2.5 m/s^2 * (2 s)^2 / 2 is 25 m, at 15 m/s: below the limit of 15 m/s
        (VehicleStart(23.0, 0.0), False, math.sqrt(2 * 23.0 / 2.5)),
        (VehicleStart(45.0 + 30.0, 0.0), False, 6.0 + 2.0),  # 15 m/s after 6 s and 45 m, and then 2 s at 15 m/s
        (VehicleStart(4.0, 8.0), True, 1.0),  # an even stop takes twice the time of a drive at 8 m/s
        (VehicleStart(0.0, 0.0), True, 0.0),
    ],
)
def test_arrival_follows_the_laws_of_even_acceleration(start: VehicleStart, stops: bool, arrival: float) -> None:
    assert nominal_arrival(start, 15.0, stops=stops) == pytest.approx(arrival)


def test_vehicle_that_stops_takes_the_times_of_its_acceleration_and_of_its_braking() -> None:
    """From 0 m/s to p at 2.5 m/s^2 and back at 2.3 m/s^2: the vehicle drives at p / 2 on average, so the time is 2 d / p."""
    peak = math.sqrt(2.0 * 20.0 / (1.0 / 2.5 + 1.0 / 2.3))
    assert nominal_arrival(VehicleStart(20.0, 0.0), 15.0, stops=True) == pytest.approx(2.0 * 20.0 / peak)


@pytest.mark.parametrize("name", ["stop4", "light4"])
def test_gaps_are_those_of_the_reference_within_a_fifth_of_a_second(name: str) -> None:
    """A light is green at first for entrances 0 and 2."""
    place = rvads.find(name)
    starts = [VehicleStart(10.0, 0.0), VehicleStart(20.0, 0.0), VehicleStart(20.0, 7.0), VehicleStart(30.0, 5.0)]
    simulated, nominal = [], []
    for start in starts:
        scenario = rvads.Scenario(place, "2000", distance=start.distance, speed=start.speed, duration=8)
        arrived = rvads.simulate(rvads.Case(scenario, rvads.Reference)).zone[:, 0] >= rvads.Zone.ENTRANCE
        simulated.append(float(arrived.argmax()) * 0.01)
        nominal.append(nominal_arrival(start, place.top_limit, stops=name == "stop4"))
    gaps = [time - simulated[0] for time in simulated]
    assert [time - nominal[0] for time in nominal] == pytest.approx(gaps, abs=0.2)


@pytest.mark.extended
def test_scenarios_shrink_to_few_vehicles_and_round_numbers() -> None:
    few = settings(max_examples=100, derandomize=True, deadline=None)
    simplest = find(strategies.scenarios(), lambda scenario: sum(map(bool, scenario.directions)) >= 2, settings=few)
    assert sum(map(bool, simplest.directions)) == 2
    assert set(simplest.speeds) == {0.0}
    assert set(simplest.distances) == {20.0}
    assert simplest.wait == 1.5


@pytest.mark.extended
def test_scenarios_of_a_seed_do_not_depend_on_the_loaded_modules(tmp_path: Path) -> None:
    """Hypothesis draws numbers from the source code of loaded modules, unless a strategy has no room for such numbers."""
    (tmp_path / "numbers_of_a_user.py").write_text(f"NUMBERS = {[*range(100, 400)]}, {[n / 10 for n in range(400)]}", "utf-8")
    script = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "if sys.argv[2] == 'loaded': import numbers_of_a_user\n"
        "from hypothesis import Phase, given, seed, settings\n"
        "from pytest_rvads.search import strategies\n"
        "@settings(max_examples=300, database=None, phases=[Phase.generate])\n"
        "@seed(1)\n"
        "@given(strategies.distances(), strategies.distances(0.3, 8.0), strategies.waits())\n"
        "def drawn(far, near, wait): print(far, near, wait)\n"
        "drawn()\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path)]
    alone, loaded = (subprocess.run([*command, word], capture_output=True, text=True, check=True) for word in ("alone", "loaded"))
    assert alone.stdout == loaded.stdout
    assert alone.stdout.count("\n") >= 300


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: strategies.junctions(ways=5), "no built-in junction"),
        (lambda: strategies.abstract_scenarios(2), "must be 3 to 8"),
        (lambda: strategies.distances(5, 1), "distances must go from"),
        (lambda: strategies.waits(-1, 1), "waits must begin at 0"),
        (lambda: strategies.scenarios("stop5"), "unknown junction 'stop5'"),
        (lambda: strategies.scenarios("stop4", subject=9), "subject must be an entrance of 'stop4', 0 to 3, got 9"),
    ],
)
def test_misuse(call: Callable[[], object], says: str) -> None:
    with pytest.raises(rvads.errors.RvadsError, match=says):
        call()

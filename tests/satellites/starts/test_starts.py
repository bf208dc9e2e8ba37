"""Lines of starts: leads, reach, groups, and starts at the end of green."""

import math
from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import names
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.starts.lines import CHANGED, STEP, Begin, Line, lines_at
from pytest_rvads.support.errors import ScenarioError

LINES = {name: [line for group in lines_at(rvads.find(name)) for line in group] for name in names()}
FOUR = ("stop4", "yield4", "right4", "light4")
UNLIMITED = 1000.0
"""A lead that no line of a built-in junction reaches [s]."""

lines = st.sampled_from(sorted(LINES)).flatmap(lambda name: st.sampled_from(LINES[name]))


def arrival(scenario: rvads.Scenario, entrance: int) -> float:
    """Return the time of a vehicle to its stopping line at its first speed [s]; 0 for a vehicle that stands at its line."""
    distance, speed = scenario.start(entrance)
    return distance / speed if speed else 0.0


def error_of_rounding(scenario: rvads.Scenario, entrance: int) -> float:
    """Return how much an arrival changes when the distance is rounded to 0.01 m [s]."""
    speed = scenario.start(entrance)[1]
    return 0.005 / speed + 1e-9 if speed else 0.0


@given(lines, st.data())
@settings(deadline=None, derandomize=True, max_examples=80)
def test_lead_is_the_time_between_the_arrivals_at_constant_speeds(line: Line, data: st.DataObject) -> None:
    low, high = line.reach()
    # The nearest starts from rest have the other vehicle at 0.01 m, the least distance.
    lead = data.draw(st.integers(low + 10 * (line.begin is Begin.REST), high))
    scenario, subject, other = line.scenario(lead), *(way[0] for way in line.ways)
    assert scenario.subject == subject
    error = error_of_rounding(scenario, subject)
    if line.by_yellow:
        last = 6.0
    else:
        last = arrival(scenario, other)
        error += error_of_rounding(scenario, other)
    assert last - arrival(scenario, subject) == pytest.approx(lead * STEP, abs=error)


@given(lines, st.tuples(*[st.integers(0, 11990)] * 16))
@settings(deadline=None, derandomize=True, max_examples=50)
def test_both_ends_of_the_reach_have_room_and_leads_beyond_have_none(line: Line, shorter: tuple[int, ...]) -> None:
    """Setbacks to 0.01 m shorten the approaches, so that the ends fall between two steps.

    A line leaves 0.01 m of an approach for rounding, and distances are rounded to 0.01 m: a way of some slow steps.
    """
    entrances = [
        replace(lane, setback=cut / 100 if cut / 100 < lane.approach.length else 0.0)
        for lane, cut in zip(line.place.entrances, shorter, strict=False)
        if lane.approach
    ]
    cut_short = replace(line, place=replace(line.place, entrances=tuple(entrances)))
    rooms = [cut_short.place.approach(way[0]) for way in line.ways]
    low, high = cut_short.reach(UNLIMITED)
    slowest = 0.1
    if min(rooms) > 0.3:  # a vehicle at the least speed, 0.1 m/s, needs 0.25 m
        speeds = [speed for lead in (low, high) for speed in cut_short.scenario(lead).speeds if speed]
        slowest = min(speeds, default=slowest)
    beyond = 1 + math.ceil(0.015 / slowest / STEP)
    if line.begin is Begin.REST:
        assert low == 0
    else:
        with pytest.raises(ScenarioError, match="does not fit on entrance"):
            cut_short.scenario(low - beyond)
    if not line.by_yellow:
        with pytest.raises(ScenarioError, match="does not fit on entrance"):
            cut_short.scenario(high + beyond)


def test_reach_ends_at_the_greatest_lead_that_is_asked_for() -> None:
    (moving, *_), (from_rest, *_), *_ = lines_at(rvads.find("stop4"))
    assert [moving.reach(seconds) for seconds in (2.0, 6.0, 12.0)] == [(-200, 200), (-600, 600), (-1200, 1200)]
    assert [from_rest.reach(seconds) for seconds in (2.0, 6.0, 12.0)] == [(0, 200), (0, 600), (0, 1200)]


@given(lines)
@settings(deadline=None, derandomize=True, max_examples=30)
def test_starts_differ_in_distances_alone(line: Line) -> None:
    low, high = line.reach()
    if line.begin is Begin.REST:  # a vehicle nearer than 2.5 s is slower, see below
        low = min(250, high - 2)
    starts = [line.scenario(lead) for lead in (low, (low + high) // 2, high)]
    assert len({(start.directions, start.speeds, start.subject, start.elapsed) for start in starts}) == 1
    assert len({start.distances for start in starts}) == 3


@pytest.mark.parametrize("name", FOUR)
def test_lines_of_a_group_are_images_of_each_other_under_rotation(name: str) -> None:
    for group in lines_at(rvads.find(name)):
        images = set()
        for line in group:
            start = line.scenario(300 if line.begin is Begin.REST else -300)
            seen = [start.directions, start.distances, start.speeds]
            images.add(tuple(tuple(values[(line.seat + k) % 4] for k in range(4)) for values in seen))
        assert len(images) == 1


# A crossing of four roads with one lane each has 16 points where two ways cross, and 3 pairs of ways into each of 4 exits: 28
# pairs. Each pair has two seats. A T has 3 crossings and 1 pair of ways into each of 3 exits: 6 pairs. At a stop sign or a light,
# either vehicle may have to wait. By priority to the right, one of two vehicles has to wait. At each of
# the 2 yield signs of yield4, vehicles have 14 pairs; on the priority road, a vehicle that turns left has to wait: 2 pairs at
# each of 2 entrances.
@pytest.mark.parametrize(
    ("name", "pairs", "rotations", "from_rest"),
    [("stop4", 28, 4, 56), ("right4", 28, 4, 28), ("light4", 28, 4, 56), ("yield4", 28, 2, 32), ("stop3", 6, 1, 12)],
)
def test_every_pair_of_conflicting_ways_has_a_line_per_seat(name: str, pairs: int, rotations: int, from_rest: int) -> None:
    groups = lines_at(rvads.find(name))
    every = [line for group in groups for line in group]
    moving = [line for line in every if line.begin is Begin.MOVING]
    on_red = 4 if name == "light4" else 0
    assert len({line.id for line in every}) == len(every) == 2 * pairs + from_rest + on_red
    assert Counter(frozenset(line.ways) for line in moving) == dict.fromkeys({frozenset(line.ways) for line in moving}, 2)
    assert {replace(line, begin=Begin.MOVING) for line in every} == set(moving)
    if rotations > 1:
        assert {len(group) for group in groups} == {rotations}


@pytest.mark.parametrize("name", ["light4", "light3", "lanes4", "paper_light4"])
def test_light_of_the_subject_turns_yellow_after_six_seconds_and_the_other_gets_green_after_the_clearance(name: str) -> None:
    """At lanes4, left turns have phases of their own, so that another phase may come between."""
    by_light = [line for line in LINES[name] if line.by_yellow]
    greens = []
    for line in by_light:
        subject, other = (way[0] for way in line.ways)
        scenario = line.scenario(0)
        first, last, yellow, red, before, after = (
            scenario.signals().colours(time, len(scenario.place.entrances))
            for time in (0.0, 5.99, 6.0, CHANGED, CHANGED - 0.01, CHANGED)
        )
        turns = [Colour.GREEN, Colour.GREEN, Colour.YELLOW, Colour.RED]
        assert [colours[subject] for colours in (first, last, yellow, red)] == turns
        assert (first[other], before[other]) == (Colour.RED, Colour.RED)
        assert scenario.start(other)[1] == 0.0
        greens.append(after[other] is Colour.GREEN)
    assert any(greens)
    assert all(greens) or len(rvads.find(name).phase_groups) > 2


def test_seats_choose_the_subject() -> None:
    place = rvads.find("stop4")
    assert {line.seat for group in lines_at(place, [1, 3]) for line in group} == {1, 3}
    assert [len(group) for group in lines_at(place, [1])] == [1] * 28
    with pytest.raises(ScenarioError, match="a seat of 'stop4' is one of its entrances, 0 to 3, got 4"):
        lines_at(place, [4])


def test_line_says_what_decides_between_its_vehicles() -> None:
    signs = [lane.sign for lane in rvads.find("yield4").entrances]
    for line in LINES["yield4"]:
        subject, other = (signs[way[0]] for way in line.ways)
        if subject != other:
            assert line.vista == ("subject gives way" if subject is Sign.YIELD else "other vehicle gives way")
    assert {line.vista for line in LINES["stop4"]} == {"all-way stop"}


@given(lines.filter(lambda line: line.begin is Begin.REST), st.data())
@settings(deadline=None, derandomize=True, max_examples=40)
def test_subject_from_rest_stands_at_its_line_and_the_other_vehicle_can_stop_at_its_own(line: Line, data: st.DataObject) -> None:
    """Up to 20 m, the same braking stops the other vehicle: 1.6 m/s^2, with which a vehicle at 8 m/s stops within 20 m."""
    low, high = line.reach()
    scenario, (subject, other) = line.scenario(data.draw(st.integers(low, high))), (way[0] for way in line.ways)
    assert scenario.start(subject) == (0.01, 0.0)
    distance, speed = scenario.start(other)
    assert max(speed - 0.01, 0.0) ** 2 / (2 * 1.6) <= distance + 0.005
    assert not line.by_light or scenario.signals().colours(0.0, len(scenario.place.entrances))[other] is Colour.GREEN


def test_subject_has_a_line_from_rest_if_it_may_have_to_wait() -> None:
    signs = [lane.sign for lane in rvads.find("yield4").entrances]
    waiting = {line.ways for line in LINES["yield4"] if line.begin is Begin.REST}
    for line in LINES["yield4"]:
        assert (line.ways in waiting) == (signs[line.seat] is Sign.YIELD or line.vista == "subject gives way")
    assert LINES["stop4"][4].id == "stop4-s0-0to1-meets-2to1-rest"
    assert str(LINES["stop4"][4]) == "stop4: 0->1 from rest meets 2->1"


@pytest.mark.parametrize("name", ["light4", "light3", "lanes4"])
def test_subject_on_red_comes_to_its_red_light_to_turn_right_while_the_other_vehicle_has_green(name: str) -> None:
    place = rvads.find(name)
    lines_on_red = [line for line in LINES[name] if line.begin is Begin.RED]
    assert lines_on_red
    for line in lines_on_red:
        subject, other = (way[0] for way in line.ways)
        scenario = line.scenario(100)
        assert place.movements[line.ways[0]].turn is Turn.RIGHT
        assert [scenario.start(entrance) for entrance in (subject, other)] == [(20.0, 8.0), (28.0, 8.0)]
        colours = scenario.signals().colours(0.0, len(place.entrances))
        assert (colours[subject], colours[other]) == (Colour.RED, Colour.GREEN)
    assert (lines_on_red[0].vista, lines_on_red[0].id.rsplit("-", 1)[1]) == ("turn on red", "red")

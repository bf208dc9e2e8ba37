"""When the reference autopilot enters the junction, at lights and at stop signs: what it sees, written by hand."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.signs_and_lights import Light, StopSign
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.states import Colour, Vehicle, VehicleState, Zone
from tools.crossings import opendrive
from tools.make_maps import CROSSINGS

LIGHTS, SIGNS = find("light4"), find("stop4")
G, Y, R = Colour.GREEN, Colour.YELLOW, Colour.RED
ACROSS, ALONG = (G, R, G, R), (R, G, R, G)
LEFT, STRAIGHT, RIGHT = Turn.LEFT, Turn.STRAIGHT, Turn.RIGHT
LIMIT = 11.176
LENGTH = 4.6


def at(entrance: int, turn: Turn, station: float = -0.5, speed: float = 0.0, **more: Any) -> VehicleState:
    """A vehicle before the junction, its entrance zone 1 m long."""
    zone = Zone.ENTRANCE if station > -1.0 else Zone.APPROACH
    return VehicleState(f"a{entrance}", entrance, turn, zone, station, 0.0, 0.0, 0.0, speed, 0.0, LENGTH, 1.86)._replace(**more)


def sees(
    me: VehicleState,
    *others: VehicleState,
    lights: tuple[Colour, ...] = ACROSS,
    time: float = 0.0,
    created: int = 0,
    junction: Junction = LIGHTS,
) -> Observation:
    """What the driver of `me` sees."""
    way = Itinerary.through(junction, me.entrance, junction.by_turn[me.entrance, me.turn][0].exit)
    return Observation(time, me, others, lights, way, junction, Vehicle(), LIMIT, created=created)


def enters(me: VehicleState, *others: VehicleState, **more: Any) -> bool:
    return Light().allows(sees(me, *others, **more))


@pytest.mark.parametrize("turn", [LEFT, STRAIGHT, RIGHT])
def test_alone_it_goes_on_green(turn: Turn) -> None:
    assert enters(at(0, turn)) is True
    assert enters(at(0, turn, -20.0, 8.0)) is True
    assert enters(at(0, turn, -20.0, 8.0), lights=ALONG) is False, "and not on red"


def test_yellow_is_passed_if_stopping_takes_more_than_3_2() -> None:
    # 8 m/s: 10 m of braking, 0.96 m of the brake's lag, 0.15 m to spare.
    for station, goes in ((-11.0, True), (-11.2, False)):
        assert enters(at(0, STRAIGHT, station, 8.0), lights=(Y, R, Y, R)) is goes


def test_right_turn_on_red_requires_a_stop_at_the_line() -> None:
    light = Light()
    for station, speed, goes in ((-20.0, 0.0, False), (-0.9, 0.02, False), (-0.4, 0.005, True), (-0.3, 1.0, True)):
        assert light.allows(sees(at(0, RIGHT, station, speed), lights=ALONG)) is goes
    for turn in (LEFT, STRAIGHT):
        assert enters(at(0, turn), lights=ALONG) is False
    assert enters(at(0, RIGHT), lights=ALONG, junction=replace(LIGHTS, left_hand=True)) is False, "where one keeps left"


# The own vehicle sets off after 0.35 s with 2.5 m/s^2 and drives at 5 m/s; the other one comes at the speed limit.
@pytest.mark.parametrize(
    ("mine", "other", "lights", "farthest"),
    [
        # Clear of the common place after 14.5 + 4.6 + 0.5 m and 5.27 s; a second later the other one, 16 m on, is there.
        (at(0, LEFT), at(2, STRAIGHT), ACROSS, 16.0 - LIMIT * 6.27),
        # Into the same exit: clear of it after 26.31 + 4.6 + 0.5 m and 7.632 s.
        (at(0, LEFT), at(2, RIGHT), ACROSS, 14.5 - LIMIT * 8.632),
        (at(1, RIGHT), at(0, STRAIGHT), ACROSS, 21.5 - LIMIT * 7.532),
        # No common place; but it must not be at its entrance within half a second of the own entry after 0.982 s.
        (at(1, RIGHT), at(0, RIGHT), ACROSS, -1.0 - LIMIT * 1.482),
        # Already under way at 5 m/s, without delay: 29.1 m.
        (at(0, LEFT, -10.0, 5.0), at(2, STRAIGHT), ACROSS, 16.0 - LIMIT * 6.82),
    ],
)
def test_vehicle_enters_before_priority_traffic_if_the_gap_is_long_enough(
    mine: VehicleState, other: VehicleState, lights: tuple[Colour, ...], farthest: float
) -> None:
    for before, goes in ((0.2, True), (-0.2, False)):
        comes = other._replace(zone=Zone.APPROACH, station=farthest - before, speed=LIMIT)
        assert enters(mine, comes, lights=lights) is goes


@pytest.mark.parametrize(
    ("mine", "other", "goes"),
    [
        (at(0, LEFT), at(2, STRAIGHT), False),
        (at(0, LEFT), at(2, RIGHT), False),
        (at(0, LEFT), at(2, LEFT), True),  # they pass each other
        (at(0, LEFT), at(1, STRAIGHT), True),  # it has red
        (at(0, STRAIGHT), at(2, LEFT), True),
        (at(0, RIGHT), at(2, LEFT), True),
        (at(0, RIGHT), at(2, STRAIGHT), True),
        (at(1, RIGHT), at(0, STRAIGHT), False),  # on red: it comes from the left and has green
        (at(1, RIGHT), at(2, STRAIGHT), True),
        (at(0, RIGHT), at(3, STRAIGHT), True),  # on green: it comes from the left and has red
    ],
)
def test_waiting_vehicle_at_the_line(mine: VehicleState, other: VehicleState, goes: bool) -> None:
    assert enters(mine, other) is goes


@pytest.mark.parametrize(
    ("other", "goes"),
    [
        (at(1, STRAIGHT, 20.0, 5.0, zone=Zone.JUNCTION), False),
        (at(3, STRAIGHT, 2.0, 5.0, zone=Zone.JUNCTION), False),
        (at(1, RIGHT, 2.0, 5.0, zone=Zone.JUNCTION), False),  # into the same exit
        (at(2, STRAIGHT, 2.0, 5.0, zone=Zone.JUNCTION), True),
        (at(3, RIGHT, 2.0, 5.0, zone=Zone.JUNCTION), True),
        (at(1, STRAIGHT, 40.0, 5.0, zone=Zone.EXIT), True),
        # Who would have to brake with more than 4.5 m/s^2 at red is not going to stop.
        (at(3, STRAIGHT, -7.0, 8.0), False),
        (at(3, STRAIGHT, -20.0, 8.0), True),
        (at(3, RIGHT, -7.0, 8.0), True),  # its way is another one
        # Who stands behind the junction leaves no room: 4.6 m and 2.5 m.
        (at(0, STRAIGHT, 30.0 + 7.0 + LENGTH, 0.9, zone=Zone.EXIT), False),
        (at(0, STRAIGHT, 30.0 + 7.2 + LENGTH, 0.9, zone=Zone.EXIT), True),
        (at(0, STRAIGHT, 30.0 + 7.0 + LENGTH, 1.0, zone=Zone.EXIT), True),
        (at(0, RIGHT, 30.0, 0.0, zone=Zone.EXIT), True),  # another exit
    ],
)
def test_straight_on_at_green_waits_for_vehicles_in_the_way(other: VehicleState, goes: bool) -> None:
    assert enters(at(0, STRAIGHT), other._replace(name="other")) is goes


def test_a_right_turn_on_red_owes_a_vehicle_the_way_until_its_own_light_is_green() -> None:
    """The vehicle a0 came from the left on green, and its light turned yellow at its line."""
    light, stands = Light(), at(0, STRAIGHT)
    assert light.allows(sees(at(1, RIGHT), stands)) is False
    assert light.allows(sees(at(1, RIGHT), stands, lights=(Y, R, Y, R), time=3.0)) is False
    assert light.allows(sees(at(1, RIGHT), stands, lights=(R, R, R, R), time=6.0)) is False
    assert light.allows(sees(at(1, RIGHT), stands, lights=ALONG, time=8.0)) is True, "its own light is green, the other red"


def test_a_left_turn_owes_oncoming_traffic_the_way_on_its_own_green() -> None:
    light, stands = Light(), at(2, STRAIGHT)
    assert light.allows(sees(at(0, LEFT), stands, lights=ALONG)) is False
    assert light.allows(sees(at(0, LEFT), stands, time=1.0)) is False


def waits(gate: Light | StopSign, seen: Callable[[int], Observation]) -> float | None:
    """From when on a vehicle would go, in tenths of a second of ten seconds [s]."""
    told = [gate.allows(seen(tick)) for tick in range(100)]
    assert sorted(told) == told
    return told.index(True) / 10 if any(told) else None


@pytest.mark.parametrize(("paper", "goes"), [(False, 3.5), (True, None)])
def test_oncoming_traffic_that_stands_at_green_for_3_5_s_is_not_waited_for(paper: bool, goes: float | None) -> None:
    """By the paper's rules it goes first whenever it goes; a queue behind it waits for it itself."""
    oncoming = at(2, STRAIGHT), at(2, STRAIGHT, -7.0, name="next", zone=Zone.APPROACH)
    assert waits(Light(paper=paper), lambda tick: sees(at(0, LEFT), *oncoming, time=tick / 10)) == goes
    if not paper:
        light = Light(paper=False)
        assert [light.allows(sees(at(0, LEFT), *oncoming, time=time)) for time in (0.0, 3.4)] == [False, False]
        sets_off = oncoming[0]._replace(speed=0.5)
        assert light.allows(sees(at(0, LEFT), sets_off, time=3.5)) is False, "it has set off"


@pytest.mark.parametrize("paper", [True, False])
@pytest.mark.parametrize(("station", "goes"), [(-60.0, True), (-0.5, False)])
def test_a_right_turn_on_red_lets_pass_a_left_turn_on_green_into_the_same_exit(station: float, goes: bool, paper: bool) -> None:
    light, me = Light(paper=paper), at(0, RIGHT)
    comes = at(2, LEFT, station, 5.0)
    assert (comes.entrance, me.entrance) not in LIGHTS.right_of
    assert light.allows(sees(me, comes, lights=(R, R, G, R))) is goes
    assert light.allows(sees(me, comes._replace(speed=0.0), lights=(R, R, R, R))) is True, "as long as that one has green"


def test_a_left_turn_reckons_with_its_bend_however_fast_it_comes() -> None:
    """From 8 m before the line the way is 27.1 m: 5.4 s at 5 m/s, and a second to spare; at 8.7 m/s it would be 3.1 s."""
    for before, goes in ((0.3, True), (-0.3, False)):
        comes = at(2, STRAIGHT, 16.0 - LIMIT * (27.1 / 5.0 + 1.0) - before, LIMIT)
        assert enters(at(0, LEFT, -8.0, 8.7), comes) is goes


@pytest.fixture
def narrow(tmp_path: Path) -> Junction:
    """A junction in which two left turns from opposite sides cross each other."""
    path = tmp_path / "wide.xodr"
    path.write_text(opendrive(replace(CROSSINGS["light4"], stop=8.0, lane_offset=3.6)))
    return find("1", str(path))


@pytest.mark.parametrize(
    ("station", "created", "goes"), [(-0.5, 0, True), (-0.5, 1, False), (-0.2, 0, False), (-0.8, 1, True), (-0.2, 1, False)]
)
def test_nearer_of_two_crossing_left_turns_goes_first(narrow: Junction, station: float, created: int, goes: bool) -> None:
    """Of two that are equally near it is who was created first."""
    assert (narrow.stretches or {}).get(((0, 3), (2, 1))) is not None
    mine, other = at(0, LEFT), at(2, LEFT, station)
    assert enters(mine, other, junction=narrow, created=created) is goes
    assert enters(mine, other, created=created) is True, "where they do not cross nobody waits"
    if not goes:
        assert enters(mine, other._replace(zone=Zone.EXIT), junction=narrow, created=created) is True
        assert enters(mine, other._replace(turn=RIGHT, station=-90.0, zone=Zone.APPROACH), junction=narrow) is True


def test_ambiguous_indicator_counts_as_the_crossing_movement() -> None:
    """From entrance 2 one may turn left into two exits; only the way to exit 0 crosses the own one."""
    across = replace(LIGHTS.movements[2, 0], turn=LEFT)
    forked = replace(LIGHTS, movements={**LIGHTS.movements, (2, 0): across})
    assert [m.exit for m in forked.by_turn[2, LEFT]] in ([0, 1], [1, 0])
    assert enters(at(0, LEFT), at(2, LEFT, -0.2), junction=forked) is False
    assert enters(at(0, LEFT), at(2, LEFT, -0.2)) is True

    # From entrance 0 straight on into two exits; only the way to exit 2 joins that of a turn to the right from entrance 1.
    forked = replace(LIGHTS, movements={**LIGHTS.movements, (0, 1): replace(LIGHTS.movements[0, 1], turn=STRAIGHT)})
    assert [m.exit for m in forked.by_turn[0, STRAIGHT]] == [1, 2]
    assert enters(at(1, RIGHT), at(0, STRAIGHT, -40.0, LIMIT), junction=forked) is False
    assert enters(at(1, RIGHT), at(0, STRAIGHT, -70.0, LIMIT), junction=forked) is True


def at_sign(sign: StopSign, time: float, me: VehicleState, *others: VehicleState, created: int = 0, **more: Any) -> bool:
    return sign.allows(
        sees(me, *others, lights=more.pop("lights", (Colour.NONE,) * 4), time=time, created=created, junction=SIGNS)
    )


def test_alone_it_stands_for_half_a_second_at_the_sign() -> None:
    sign = StopSign()
    told = [
        at_sign(sign, time, at(0, STRAIGHT, station, speed))
        for time, station, speed in ((0.0, -5.0, 0.0), (0.6, -0.9, 0.5), (1.0, -0.4, 0.0), (1.49, -0.4, 0.0), (1.5, -0.4, 0.0))
    ]
    assert told == [False] * 4 + [True]
    assert at_sign(sign, 1.6, at(0, STRAIGHT, -0.2, 0.8)) is True, "and goes on"


def test_vehicle_away_from_its_entrance_has_no_turn() -> None:
    sign = StopSign()
    assert at_sign(sign, 0.0, at(0, STRAIGHT)) is False
    assert at_sign(sign, 1.0, at(0, STRAIGHT, -1.1)) is False
    assert at_sign(sign, 2.0, at(0, STRAIGHT)) is True


@pytest.mark.parametrize(
    ("other", "goes"),
    [
        (at(1, STRAIGHT, -30.0, 5.0), True),
        (at(2, STRAIGHT, 2.0, 5.0, zone=Zone.JUNCTION), False),  # whatever its way
        (at(2, STRAIGHT, 40.0, 5.0, zone=Zone.EXIT), True),
        (at(1, STRAIGHT, -7.0, 8.0), False),  # it does not stop
        (at(0, STRAIGHT, 30.0 + 7.0 + LENGTH, 0.9, zone=Zone.EXIT), False),  # no room behind the junction
        (at(0, STRAIGHT, 30.0 + 7.2 + LENGTH, 0.9, zone=Zone.EXIT), True),
    ],
)
def test_stop_sign_waits_for_vehicles_in_the_way(other: VehicleState, goes: bool) -> None:
    sign, other = StopSign(), other._replace(name="other")
    assert at_sign(sign, 0.0, at(0, STRAIGHT), other) is False
    assert at_sign(sign, 1.0, at(0, STRAIGHT), other) is goes


@pytest.mark.parametrize(("colour", "goes"), [(Y, False), (R, False), (G, True), (Colour.NONE, True)])
def test_a_light_at_some_entrances_is_obeyed_as_well(colour: Colour, goes: bool) -> None:
    sign, lights = StopSign(), (colour, *[Colour.NONE] * 3)
    assert at_sign(sign, 0.0, at(0, STRAIGHT), lights=lights) is False
    assert at_sign(sign, 1.0, at(0, STRAIGHT), lights=lights) is goes


@pytest.mark.parametrize(
    ("others", "created", "goes"),
    [
        ((at(1, STRAIGHT),), 0, None),  # to the right: it goes first, however long it takes
        ((at(3, STRAIGHT),), 0, 0.5),
        ((at(2, STRAIGHT),), 0, 0.5),  # opposite, and created later
        ((at(2, STRAIGHT),), 1, 2.2),  # created first: it has 1 s, and 0.7 s, to make use of its turn
        ((at(1, STRAIGHT), at(2, STRAIGHT), at(3, STRAIGHT)), 0, 1.5),  # everybody waits for somebody
        ((at(1, STRAIGHT), at(2, STRAIGHT), at(3, STRAIGHT)), 2, 2.9),
    ],
)
def test_order_of_simultaneous_arrivals(others: tuple[VehicleState, ...], created: int, goes: float | None) -> None:
    """Nobody moves; from when on it would go [s]."""
    sign = StopSign()
    told = [at_sign(sign, tick / 10, at(0, STRAIGHT), *others, created=created) for tick in range(100)]
    assert told == [goes is not None and tick / 10 >= goes for tick in range(100)]


@pytest.mark.parametrize(
    ("tie", "others", "goes"),
    [
        (0.5, (at(1, STRAIGHT),), 0.5 + 3.5 + 0.7),  # it stands for 3.5 s, and 0.7 s more for each in front
        (0.0, (at(1, STRAIGHT),), None),  # the paper knows no waiver
        (0.5, (at(1, STRAIGHT), at(2, STRAIGHT)), None),  # it is itself held by the one opposite, which waives its right alone
        (0.5, (at(2, STRAIGHT, -3.0),), 0.5),  # their ways do not meet
        (0.5, (at(1, STRAIGHT, -3.0),), 0.5 + 3.5 + 0.7),  # it has stopped in the stop place
        (0.5, (at(1, STRAIGHT, -6.0),), 0.5),  # it has not come there
    ],
)
def test_how_long_a_vehicle_at_a_stop_sign_waits_for_one_with_the_better_right(
    tie: float, others: tuple[VehicleState, ...], goes: float | None
) -> None:
    seen = [sees(at(0, STRAIGHT), *others, lights=(Colour.NONE,) * 4, time=tick / 10, junction=SIGNS) for tick in range(100)]
    assert waits(StopSign(tie), seen.__getitem__) == (None if goes is None else pytest.approx(goes, abs=0.11))


def test_farther_of_two_simultaneous_starts_goes_on() -> None:
    for station, goes in ((-0.3, True), (-0.1, False)):
        sign, other = StopSign(), at(3, STRAIGHT)
        assert [at_sign(sign, time, at(0, STRAIGHT), other) for time in (0.0, 0.5)] == [False, True]
        assert at_sign(sign, 0.6, at(0, STRAIGHT, -0.2, 0.5), other._replace(station=station, speed=0.5)) is goes


def test_its_patience_begins_anew_after_somebody_else_was_to_go_first() -> None:
    """It waits for who is opposite, then for who came just in time to the right, and from 3 s on, when that one is gone, anew."""
    sign = StopSign(tie=0.5)

    def goes(tick: int) -> bool:
        right = at(1, STRAIGHT, -0.5 if 6 <= tick < 30 else -9.0)
        return at_sign(sign, tick / 10, at(0, STRAIGHT), at(2, STRAIGHT), right, created=1)

    assert [goes(tick) for tick in range(100)] == [tick / 10 >= 3.0 + 1.0 + 0.7 for tick in range(100)]


def test_who_sets_off_out_of_turn_is_let_in() -> None:
    sign, other = StopSign(), at(3, STRAIGHT)
    assert [at_sign(sign, time, at(0, STRAIGHT), other) for time in (0.0, 0.5)] == [False, True]
    assert at_sign(sign, 0.6, at(0, STRAIGHT), other._replace(speed=0.5)) is False
    assert at_sign(sign, 0.7, at(0, STRAIGHT), other._replace(zone=Zone.JUNCTION, speed=2.0)) is False
    assert at_sign(sign, 2.0, at(0, STRAIGHT), other._replace(zone=Zone.EXIT, station=50.0, speed=5.0)) is True

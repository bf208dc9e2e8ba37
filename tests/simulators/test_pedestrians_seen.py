"""What vehicles see of pedestrians: behind vehicles, out of range, late and with noise."""

import math
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Command, Observation
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Kind, VehicleState, Zone
from pytest_rvads.simulators.seat import hidden
from tests.zebras import zebra

ZEBRA = zebra()
SEEN: list[Observation] = []


class Notes:
    """Stands, and notes what it sees."""

    def __init__(self) -> None:
        SEEN.clear()

    def control(self, seen: Observation) -> Command:
        SEEN.append(seen)
        return rvads.Control(brake=1.0)


def look(behaviour: str = "hidden", distance: float = 20.0, **senses: Any) -> tuple[list[Observation], Run]:
    """Return what the standing vehicle a1 sees of the pedestrian on crosswalk 1, and the run."""
    scenario = rvads.Scenario(
        ZEBRA,
        "0200",
        distance=distance,
        speed=0.0,
        subject=1,
        senses=rvads.Senses(**senses),
        duration=12.0,
        pedestrians=[rvads.Pedestrian(1, "near", behaviour, 1.0)],
    )
    run = rvads.simulate(rvads.Case(scenario, Notes))
    assert run.fault is None
    return list(SEEN), run


def states(seen: list[Observation], name: str = "p0") -> list[VehicleState | None]:
    return [next((other for other in one.others if other.name == name), None) for one in seen]


def test_drivers_see_pedestrians_and_parked_vehicles() -> None:
    seen, run = look()
    assert [other.name for other in seen[0].others] == ["p0", "parked0"]
    assert seen[0].created == 0
    person, parked = seen[0].others
    assert (person.kind, parked.kind) == (Kind.PEDESTRIAN, Kind.CAR)
    assert person.entrance >= len(ZEBRA.entrances)
    place = seen[0].junction
    assert place.starts[person.entrance].arm == place.starts[parked.entrance].arm == 1
    for tick, one in enumerate(states(seen)):
        if run.zone[tick, 1] == Zone.GONE:
            assert one is None
        else:
            assert one is not None
            assert (one.station, one.speed) == (run.need("station")[tick, 1], run.need("speed")[tick, 1])


def test_parked_vehicle_hides_the_pedestrian_until_the_line_of_sight_is_free() -> None:
    """Seen from the front of a1, the corner of the parked vehicle and then the pedestrian, whose front leads.

    The eye is 21.2 m before the area of the crosswalk, and its line of walking is 1.5 m farther. The side of the parked vehicle
    is 1.2 m - 0.93 m = 0.27 m beside the kerb and so 1.75 m + 0.27 m = 2.02 m beside the eye. Its front is 1 m before the area.
    """
    corner = 2.02 * (21.2 + 1.5) / (21.2 - 1.0)  # where the ray past the corner meets the line of walking, beside the eye
    free = -(corner - 1.75)  # this far before the kerb
    assert -0.6 < free < -0.4
    seen, run = look(occlusion=True)
    station = run.need("station")[:, 1]
    there = run.zone[:, 1] != Zone.GONE
    for tick, one in enumerate(states(seen)):
        if there[tick] and abs(station[tick] - free) > 0.02:
            assert (one is None) == (station[tick] < free), (tick, station[tick])
    assert all(states(seen, "parked0")), "nobody hides the parked vehicle"
    plain, _ = look()
    assert all(one is not None for one, here in zip(states(plain), there, strict=False) if here)
    steady, _ = look("steady", occlusion=True)
    assert states(steady)[0] is not None


def person(name: str, x: float, y: float) -> VehicleState:
    return VehicleState(name, 4, Turn.STRAIGHT, Zone.JUNCTION, 1.0, x, y, math.pi / 2, 1.4, 0.0, 0.6, 0.6, Kind.PEDESTRIAN)


@pytest.mark.parametrize(("ahead", "gone"), [(Kind.CAR, True), (Kind.TRUCK, True), (Kind.PEDESTRIAN, False)])
def test_vehicles_hide_pedestrians_and_pedestrians_hide_nobody(ahead: Kind, gone: bool) -> None:
    """Looking east from the origin at a pedestrian 20 m away; another body as wide as a car stands between."""
    me, other = person("me", 0.0, 0.0), person("p0", 20.0, 0.3)
    between = person("p1", 11.0, 0.93)._replace(length=1.86, width=1.86, kind=ahead)
    assert hidden(me, other, (me, other, between)) is gone


def test_pedestrian_beyond_the_range_is_not_seen() -> None:
    """a1 stands 22.7 m before the line of walking, on which p0 comes nearer from the right side."""
    seen, run = look("steady", range=23.0)
    pose, place = run.need("pose"), states(seen)
    for tick, one in enumerate(place):
        near = math.dist(pose[tick, 0, :2], pose[tick, 1, :2]) <= 23.0
        assert (one is not None) == (near and run.zone[tick, 1] != Zone.GONE)
    assert None in place[:100]
    assert any(place)


def test_delay_shows_an_earlier_pedestrian() -> None:
    seen, run = look("steady", delay=0.5)
    late = round(0.5 / DT)
    for tick, one in enumerate(states(seen)[late:]):
        if run.zone[tick, 1] != Zone.GONE:
            assert one is not None
            assert one.station == run.need("station")[tick, 1]


@pytest.mark.parametrize("behaviour", ["steady", "returns"])
def test_noise_moves_the_pedestrian_that_is_seen(behaviour: str) -> None:
    seen, run = look(behaviour, position_noise=0.3, speed_noise=0.1)
    zones, errors, speeds = set(), [], []
    for tick, one in enumerate(states(seen)):
        if one is None:
            continue
        zones.add(one.zone)
        assert (one.zone is Zone.JUNCTION) == (0.0 < one.station < 7.0)
        assert (one.zone is Zone.ENTRANCE) == (-1.0 <= one.station <= 0.0)
        errors.append(one.station - run.need("station")[tick, 1])
        speeds.append(one.speed - run.need("speed")[tick, 1])
    assert {Zone.APPROACH, Zone.ENTRANCE, Zone.JUNCTION} <= zones
    # Six standard deviations of the mean, and of the deviation, of so many draws.
    count = len(errors)
    assert abs(math.fsum(errors) / count) < 6 * 0.3 / math.sqrt(count)
    assert math.sqrt(math.fsum(error**2 for error in errors) / count) == pytest.approx(0.3, rel=6 / math.sqrt(2 * count))
    walking = [error for error, one in zip(speeds, (s for s in states(seen) if s), strict=True) if abs(one.speed) > 0.7]
    assert abs(math.fsum(walking) / len(walking)) < 6 * 0.1 / math.sqrt(len(walking)), "who walks backwards is seen to do so"

"""A border between zones is crossed once, in the same state in a recording and while the recording is being made."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.runs.itineraries import ENTRANCE_ZONE, Itinerary, itinerary
from pytest_rvads.runs.recording import Before, Recording, Track, zones
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.satellites.live.instant import Seen
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor

PLACE = find("stop4")
WAYS = itinerary(PLACE, 0, 2), itinerary(PLACE, 1, 3)
STAND, NOISE = 5.0, 0.03
RATE = 0.01


def drive(way: Itinerary, stops: Sequence[tuple[float, float, float]], end: float) -> NDArray[np.float64]:
    """Return the stations of a vehicle at 100 Hz that comes at 5 m/s, stands at some stations, and goes on at 5 m/s.

    Args:
        way: of the vehicle.
        stops: station [m], when the vehicle comes there [s], and when the vehicle sets off again [s].
        end: of the drive [s].
    """
    times, stations = [0.0], [stops[0][0] - 5.0 * stops[0][1]]
    for station, arrival, departure in stops:
        times += [arrival, departure]
        stations += [station, station]
    times.append(end)
    stations.append(stations[-1] + 5.0 * (end - times[-2]))
    return np.minimum(np.interp(np.arange(0.0, end, RATE), times, stations), way.leave + 1.0)


def recording(in_turn: bool) -> Recording:
    """Return two vehicles without a stated accuracy, the first of which stands on the border of its entrance zone.

    The first vehicle comes at 4 s and is measured 3 cm before and behind the border until 9 s. The second vehicle comes to its
    line at 6 s. The first vehicle then drives to its line. It enters before the second vehicle if they go in turn, else after.
    """
    border = WAYS[0].line - ENTRANCE_ZONE
    leave = (11.0, 13.0) if in_turn else (13.0, 11.0)
    stops = [(border, 4.0, 4.0 + STAND), (WAYS[0].line, 9.5, leave[0])], [(WAYS[1].line, 6.0, leave[1])]
    tracks = []
    for number, (way, places) in enumerate(zip(WAYS, stops, strict=True)):
        station = drive(way, places, 18.0)
        speed: NDArray[np.float64] = np.clip(np.gradient(station, RATE), 0.0, 5.0)
        if number == 0:
            stands = np.flatnonzero(station == border)
            station[stands] += NOISE * (-1.0) ** np.arange(len(stands))
        pose = np.array([way.pose(float(s)) for s in station])
        agent = Agent(f"v{number}", PLACE.movements[way.entrance, way.exit], size=(4.6, 1.8))
        tracks.append(Track(agent, np.arange(len(station), dtype=np.float64) * RATE, station, speed, pose))
    return Recording("stands on the border", PLACE, tuple(tracks))


@pytest.mark.parametrize("in_turn", [True, False])
def test_a_car_on_the_border_of_its_entrance_zone_is_judged_alike_recorded_and_live(in_turn: bool) -> None:
    (run,) = recording(in_turn)
    monitor = RuleMonitor(("paper", "full_stop", "first_come", "right_first"), PLACE)
    live: dict[tuple[object, ...], int] = {}
    station, speed, pose = (run.need(name).tolist() for name in ("station", "speed", "pose"))
    for tick, here in enumerate(run.here.tolist()):
        there = [k for k, present in enumerate(here) if present]
        for decided in monitor.see([Seen(run.agents[k], station[tick][k], speed[tick][k], *pose[tick][k]) for k in there]):
            if decided.verdict is Truth.FALSE:
                live[decided.rule, *sorted(decided.binding.items())] = tick
    judged = ((rule.name, i) for rule in monitor.rules for i in check(run, rule).instances)
    recorded = {(rule, *sorted(i.binding)): i.failed for rule, i in judged if i.status is Status.FAIL}
    assert live == recorded
    assert any(rule == "p3" for rule, *_ in recorded) is not in_turn
    assert np.flatnonzero(run.zone[:, 0] == Zone.ENTRANCE)[0] == pytest.approx(4.0 / RATE, abs=1)


@settings(max_examples=200, deadline=None)
@given(
    stations=st.lists(st.floats(-3.0, 12.0), min_size=1, max_size=12),
    spreads=st.lists(st.sampled_from([0.0, 0.1, 1.0]), min_size=12, max_size=12),
    block=st.integers(1, 5),
)
def test_zones_block_by_block_are_those_of_all_states(stations: list[float], spreads: list[float], block: int) -> None:
    borders = np.stack([way.borders for way in WAYS])
    station = np.stack([stations, stations[::-1]], axis=1)
    spread = np.stack([spreads, spreads[::-1]], axis=1)[: len(station)]
    parts, before = [], None
    for begin in range(0, len(station), block):
        part = slice(begin, begin + block)
        parts.append(zones(borders, station[part], spread[part], before))
        before = Before(parts[-1][-1], station[part][-1], spread[part][-1])
    whole = zones(borders, station, spread)
    assert np.array_equal(np.concatenate(parts), whole)
    assert (np.diff(whole, axis=0) >= 0).all()
    assert np.array_equal(whole[:, 0], zones(borders[0], station[:, 0], spread[:, 0]))


def test_noise_crosses_no_border_and_a_drive_does() -> None:
    borders, border = WAYS[0].borders, WAYS[0].line - ENTRANCE_ZONE
    to_and_fro = border + np.array([-0.05, 0.05, -0.05, 0.05, 0.11])
    assert zones(borders, to_and_fro, 0.1).tolist() == [0, 0, 0, 0, 1]
    assert zones(borders, to_and_fro).tolist() == [0, 1, 1, 1, 1]
    assert zones(borders, border + np.array([-0.2, 0.05]), 0.1).tolist() == [0, 1]

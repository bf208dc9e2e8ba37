"""Looking again only after somebody has moved far enough finds the same as looking in every instant."""

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.conduct.bodies import overlap
from pytest_rvads.conduct.clearance import Bodies, Course
from pytest_rvads.conduct.instant import Instant
from pytest_rvads.conduct.lane import off_lane, off_route
from pytest_rvads.junctions.finder import find
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.recording import zones
from pytest_rvads.runs.run import Facts, Run
from pytest_rvads.runs.states import Agent

JUNCTION = find("stop4")
WAYS = sorted(JUNCTION.movements)
STEPS = 150


def wander(seed: int, wide: float) -> Run:
    """Return a run of two vehicles that drive along their ways, stand, turn and stray by chance."""
    rng = np.random.default_rng(seed)
    columns: list[tuple[Any, ...]] = []
    for key in (WAYS[k] for k in rng.integers(len(WAYS), size=2)):
        way = itinerary(JUNCTION, *key)
        pace = np.repeat(rng.choice([0.0, 0.1, 0.4], 10), STEPS // 10)
        station = rng.uniform(-12.0, 8.0) + np.cumsum(pace)
        pose = np.array([way.pose(float(s)) for s in station])
        aside = wide * np.sin(station / 3 + rng.uniform(0, 6))
        pose[:, 0] -= aside * np.sin(pose[:, 2])
        pose[:, 1] += aside * np.cos(pose[:, 2])
        pose[:, 2] += 0.3 * wide * np.sin(station / 2)
        size = (float(rng.uniform(1, 12)), float(rng.uniform(0.5, 2.5)))
        zone = zones(way.borders, station)
        columns.append((Agent(f"v{len(columns)}", JUNCTION.movements[key], size=size), zone, station, pace / 0.01, pose))
    agents, *arrays = zip(*columns, strict=True)
    zone, station, speed, pose = (np.stack(values, axis=1) for values in arrays)
    lights = np.zeros((STEPS, 4), dtype=np.int8)
    return Run("wander", JUNCTION, agents, zone, lights, station=station, speed=speed, pose=pose)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32), wide=st.sampled_from([0.0, 0.5, 2.0, 5.0]))
def test_it_finds_what_looking_in_every_instant_finds(seed: int, wide: float) -> None:
    run = wander(seed, wide)
    now = Instant(JUNCTION, run.dt, Facts())
    one, two = (now.add(agent, slot) for slot, agent in enumerate(run.agents))
    bodies, courses = Bodies(one, two), (Course(now, one), Course(now, two))
    found = []
    for k in range(STEPS):
        station, speed, pose = (run.need(name)[k].tolist() for name in ("station", "speed", "pose"))
        now.move(run.zone[k].tolist(), station, speed, pose, run.lights[k].tolist())
        found.append((bodies.look(now), *(c.off_lane(now) for c in courses), *(c.off_route(now) for c in courses)))
    whole = (overlap(run, 0, 1), *(off_lane(run, k) for k in (0, 1)), *(off_route(run, k) for k in (0, 1)))
    assert np.array_equal(np.array(found), np.stack(whole, axis=1))


def test_these_vehicles_touch_and_stray() -> None:
    """What the law above compares: each of it happens, and ceases to."""
    runs = [wander(seed, 2.0) for seed in range(12)]
    for happens in ([overlap(run, 0, 1) for run in runs], [off_lane(run, 0) for run in runs]):
        values = np.concatenate(happens)
        assert values.any()
        assert not values.all()

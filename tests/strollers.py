"""Pedestrians for tests, who walk over a crosswalk at speeds that are given by hand."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pytest_rvads.geometry.crosswalks import PERSON, Side
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Kind


def stroll(run: Run, crosswalk: int, side: Side, start: float, speeds: Sequence[tuple[int, float]], name: str = "p0") -> Run:
    """Return a run with a further agent: a pedestrian on a crosswalk; contacts are computed from the bodies.

    Args:
        run: a run at a walked junction.
        crosswalk: number of the crosswalk.
        side: side from which the pedestrian comes.
        start: station of the pedestrian in the first state [m].
        speeds: ticks, and the speeds from these ticks on [m/s]; a negative speed leads back.
        name: name of the pedestrian.
    """
    way = run.junction.further[2 * crosswalk + (side is Side.FAR)].way
    speed = np.zeros(run.steps)
    for tick, value in speeds:
        speed[tick:] = value
    station = start + np.concatenate(([0.0], np.cumsum(speed[:-1]))) * run.dt
    course = itinerary(run.junction, *way.key)
    zone = np.array([course.zone(along) for along in station], dtype=np.int8)
    pose = np.array([course.pose(along) for along in station])
    columns: dict[str, Any] = {"zone": zone, "station": station, "speed": speed, "pose": pose}
    arrays: dict[str, Any] = {
        key: np.concatenate((getattr(run, key), column[:, None]), axis=1) for key, column in columns.items()
    }
    agent = Agent(name, way, Kind.PEDESTRIAN, (PERSON, PERSON))
    return replace(run, agents=(*run.agents, agent), collisions=None, **arrays)

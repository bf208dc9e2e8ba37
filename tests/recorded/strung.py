"""Simulated runs as recorded traffic: one after the other, or at the same time, in one run whose vehicles come and go."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from pytest_rvads.drivers.follower import Follower
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.rules.book import get_rule, rulebook
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.recording import Period, Recording, Track
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.satellites.lgsvl import LgsvlLike
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate

RULES = tuple(dict.fromkeys((*rulebook("paper"), *rulebook("road"), get_rule("p6g"))))


class Racer(Follower):
    """Stops for nobody."""

    def target_speed(self, seen: Any) -> float:
        return 8.0


Told = dict[tuple[Any, ...], dict[str, Any]]
"""What instances say, by their bindings."""
DRIVERS = {"reference": Reference, "lgsvl": LgsvlLike, "racer": Racer}


@cache
def driven(junction: str, directions: str, driver: str, distances: tuple[float, ...]) -> Run:
    """Return a simulated run as a recording has it: nobody watched for collisions."""
    scenario = Scenario(find(junction), directions, distance=distances, speed=5.0, duration=20)
    return replace(simulate(Case(scenario, DRIVERS[driver])), collisions=None, controls=None, fault=None)


def concerning(run: Run) -> list[Rule]:
    return [rule for rule in RULES if rule.concerns(run.junction)]


def strung(runs: Sequence[Run], starts: Sequence[int]) -> Run:
    """Return one run in which the given ones take place from these ticks on; vehicles of each are named after its number.

    Lights are those of the last run that has begun.
    """
    steps = max(start + run.steps for start, run in zip(starts, runs, strict=True))
    agents: list[Agent] = []
    arrays: dict[str, list[np.ndarray]] = {name: [] for name in ("zone", "station", "speed", "pose")}
    lights = np.zeros((steps, runs[0].lights.shape[1]), dtype=np.int8)
    for number, (run, start) in enumerate(zip(runs, starts, strict=True)):
        agents += [replace(agent, name=f"{number}-{agent.name}") for agent in run.agents]
        lights[start:] = run.lights[-1]
        lights[start : start + run.steps] = run.lights
        for name, columns in arrays.items():
            values = getattr(run, name)
            whole = np.full((steps, *values.shape[1:]), Zone.ABSENT if name == "zone" else np.nan, dtype=values.dtype)
            whole[start : start + run.steps] = values
            columns.append(whole)
    zone, station, speed, pose = (np.concatenate(columns, axis=1) for columns in arrays.values())
    return Run("strung", runs[0].junction, tuple(agents), zone, lights, runs[0].dt, station, speed, pose)


def recorded(run: Run, every: int = 10) -> Recording:
    """Return what a recording of every n-th state of a run says."""
    tracks = []
    for column, agent in enumerate(run.agents):
        ticks = np.flatnonzero(run.here[:, column])[::every]
        values = (array[ticks, column] for array in (run.station, run.speed, run.pose))
        tracks.append(Track(agent, np.asarray(ticks * run.dt, dtype=np.float64), *values))
    return Recording("strung", run.junction, tuple(tracks))


def uncut(recording: Recording) -> Recording:
    """Return the recording with all of its time as one period."""
    whole = replace(recording)
    everybody = tuple(range(len(recording.tracks)))
    begin, end = min(t.times[0] for t in recording.tracks), max(t.times[-1] for t in recording.tracks)
    whole.__dict__["periods"] = (Period(begin, end, begin, everybody, everybody),)
    return whole


def instances(run: Run, rule: Rule, after: float = 0.0, prefix: str = "") -> Told:
    """Return what every instance says, by its binding; times count from `after`, and names get a prefix."""
    names = {agent.name for agent in run.agents}

    def named(text: str) -> str:
        return f"{prefix}{text}" if text in names else text

    found: Told = {}
    for instance in check(run, rule).instances:
        binding = tuple((variable, named(name)) for variable, name in instance.binding)
        times = (
            None if tick is None else round(run.start + after + tick * run.dt, 9) for tick in (instance.trigger, instance.failed)
        )
        key = (*binding, len([k for k in found if k[:-1] == binding]))
        found[key] = {
            "status": instance.status,
            "responsible": [named(name) for name in instance.responsible],
            "times": list(times),
            "how many broken": len(instance.broken),
            "margin": instance.margin,
        }
    return found

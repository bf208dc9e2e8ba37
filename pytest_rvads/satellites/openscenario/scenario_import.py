"""Scenarios in OpenSCENARIO XML: the subset that we write, with or without what an export of ours says beside."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pytest_rvads.decoding import decode
from pytest_rvads.errors import RunError, ScenarioError
from pytest_rvads.junctions.finder import find, load, names
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.states import Colour
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.satellites.openscenario.intentions import Drive, Intention, intentions, matched
from pytest_rvads.satellites.openscenario.played import lights_of, map_of, note_of
from pytest_rvads.satellites.openscenario.playedfile import site_of
from pytest_rvads.satellites.openscenario.scenario_export import VERSION, ScenarioNote
from pytest_rvads.satellites.openscenario.xosctree import Node, read_tree
from pytest_rvads.satellites.tracks.lightlog import lights_at
from pytest_rvads.scenarios.ids import recalled
from pytest_rvads.scenarios.orbits import Orbits, rotate
from pytest_rvads.scenarios.scenario import QUEUE_GAP, QUEUE_TIME, Scenario, usual_duration

__all__ = ["load_scenario"]

_NEAR = 1e-3
"""Places and speeds of two sources are the same within this [m], [m/s]."""
_EVERY, _WITHIN = 0.25, 0.1
"""Lights are compared so often, so long after changes that fall on a quarter of a second [s]."""


def load_scenario(path: str | Path, *, junction: str | None = None, map: str | os.PathLike[str] | None = None) -> Scenario:
    """Read a scenario that `save_scenario` wrote, or one of others that consists of the same elements.

    Of a file of others every vehicle is projected on an approach, and its route on a movement; what stands in it and is not read
    is refused. Their names and bodies are not kept: a scenario has neither.

    Args:
        path: of the file.
        junction: what `find` takes; by default the only one of the map through which all routes lead.
        map: OpenDRIVE file; by default the one that the file names, from beside it.

    Raises:
        ScenarioError: it can't be read, or holds what no `Scenario` does; the message names file, line and element.
        MapError: its map can't be read, or has no such junction.
    """
    path = Path(path)
    try:
        root = read_tree(path)
        note, beside = note_of(root, "scenario"), map_of(root, path)
        found = intentions(root, path.name)
        own = note is not None and junction is None
        if own:
            said = decode(str(note).encode(), ScenarioNote, f"{path.name}: the property rvads.scenario", RunError)
            if said.version != VERSION:
                raise ScenarioError(f"{path.name}: written in version {said.version} of rvads.scenario, expected {VERSION}")
            place = site_of(said.site, beside if map is None else Path(map), path.name)
            scenario = recalled(said.scenario, place, f"{path.name}: the property rvads.scenario")
            _check_alike(scenario, found, root, path.name)
            return scenario
        return _projected(found, root, _places(junction, beside if map is None else Path(map), path.name), path.name)
    except RunError as error:
        raise ScenarioError(str(error)) from error


def _check_alike(scenario: Scenario, found: Mapping[str, Intention], root: Node, where: str) -> None:
    """Check that the elements of a file of ours still say what its property does."""
    agents = scenario.agents()
    if {agent.name for agent in agents} != found.keys():
        raise _contradiction(where, f"vehicles {', '.join(sorted(found))}")
    lengths = {name: _body(intention.length) for name, intention in found.items()}
    starts = scenario.starts(lengths.__getitem__)
    for agent, start in zip(agents, starts, strict=True):
        drive = matched(found[agent.name], scenario.place)
        told = None if drive is None else (drive.distance, drive.speed)
        if drive is None or drive.key != agent.way.key or not np.allclose(told or (), start, rtol=0.0, atol=_NEAR):
            raise _contradiction(where, f"the start or route of {agent.name}")
    duration = _duration(root)
    if duration is None or abs(duration - scenario.duration) > _NEAR:
        raise _contradiction(where, f"an end at {duration} s")
    if not _lit(scenario, root):
        raise _contradiction(where, "what the lights show")


def _contradiction(where: str, what: str) -> ScenarioError:
    return ScenarioError(
        f"{where}: {what} is not what the property rvads.scenario says: take that property out where the file was changed "
        "on purpose"
    )


def _body(length: float | None) -> Vehicle:
    """Return a vehicle of a length [m]; nothing else of it counts where vehicles queue."""
    usual = Vehicle()
    share = usual.length if length is None else length
    return Vehicle(length=share, front_axle=share / 4, rear_axle=share / 4)


def _places(junction: str | None, map: Path | None, where: str) -> list[Junction]:
    if junction is not None:
        return [find(junction, None if junction in names() else map)]
    if map is None:
        raise ScenarioError(f"{where}: it names no map in <LogicFile>: give one (map=), or a built-in junction (junction=)")
    return [find(report.id, map) for report in load(map).junctions if report.usable]


def _projected(found: Mapping[str, Intention], root: Node, places: list[Junction], where: str) -> Scenario:
    """Return the scenario of a file of others."""
    fitting: list[tuple[Junction, list[Drive]]] = []
    lost = next(iter(found))
    for place in places:
        drives = {name: matched(intention, place) for name, intention in found.items()}
        lost = next((name for name, drive in drives.items() if drive is None), lost)
        if None not in drives.values():
            fitting.append((place, [drive for drive in drives.values() if drive is not None]))
    if not fitting:
        raise ScenarioError(
            f"{where}: {lost!r:.60} must start on an approach and have a route down an exit road of one junction, the same for "
            f"everybody: the map has none such among {len(places)} that can be used"
        )
    if len(fitting) > 1:
        named = ", ".join(place.id for place, _ in fitting)
        raise ScenarioError(f"{where}: all routes lead through {len(fitting)} junctions ({named:.100}): name one (junction=)")
    return _assembled(*fitting[0], root, where)


def _assembled(place: Junction, drives: list[Drive], root: Node, where: str) -> Scenario:
    queues: dict[int, list[Drive]] = defaultdict(list)
    for drive in drives:
        queues[drive.key[0]].append(drive)
    order = [*queues, *(e for e in range(len(place.entrances)) if e not in queues)]
    heads = {entrance: min(queue, key=lambda drive: drive.distance) for entrance, queue in queues.items()}
    counts = {len(queue) for queue in queues.values()}
    if len(counts) > 1 or any(drive.key != heads[drive.key[0]].key for drive in drives):
        raise ScenarioError(f"{where}: vehicles behind each other must be as many at every entrance, and go the same way")
    by_key = {movement.key: direction for (_, direction), movement in place.by_direction.items()}
    lanes = range(len(place.entrances))
    spare = next(iter(heads.values()))
    alike = {(head.distance, head.speed) for head in heads.values()} == {(spare.distance, spare.speed)}
    at = {e: (head.distance, head.speed) for e, head in heads.items()}
    starts = [at.get(e, (spare.distance, spare.speed) if alike else (0.0, 0.0)) for e in lanes]
    code = tuple(by_key[heads[e].key] if e in heads else 0 for e in lanes)
    duration = _duration(root)
    for row in Orbits.at(place).rows:
        try:
            scenario = Scenario(
                place,
                rotate(code, -row),
                distance=rotate(tuple(distance for distance, _ in starts), -row),
                speed=rotate(tuple(speed for _, speed in starts), -row),
                rotation=row,
                duration=usual_duration(place) if duration is None else duration,
                followers=max(counts) - 1,
            )
        except ScenarioError as error:
            raise ScenarioError(f"{where}: {error}") from error
        if scenario.creation != (*queues,):
            scenario = scenario.but(order=tuple((entrance - row) % len(lanes) for entrance in order))
        if _lit(scenario, root):
            break
    else:
        raise ScenarioError(f"{where}: its lights follow none of the plans that junction {place.name!r} has here")
    _check_queues(scenario, queues, where)
    return scenario


def _check_queues(scenario: Scenario, queues: Mapping[int, list[Drive]], where: str) -> None:
    """Check that queued vehicles start where `Scenario` puts followers."""
    rows = [drive for entrance in sorted(queues) for drive in sorted(queues[entrance], key=lambda drive: drive.distance)]
    lengths = {agent.name: _body(drive.length) for agent, drive in zip(scenario.agents(), rows, strict=True)}
    for drive, start in zip(rows, scenario.starts(lengths.__getitem__), strict=True):
        if not np.allclose((drive.distance, drive.speed), start, rtol=0.0, atol=_NEAR):
            raise ScenarioError(
                f"{where}: {drive.name!r:.60} starts {drive.distance:.2f} m before its line at {drive.speed:g} m/s, expected "
                f"{start[0]:.2f} m at {start[1]:g} m/s: who follows starts as fast, {QUEUE_GAP:g} m and {QUEUE_TIME:g} s behind"
            )


def _duration(root: Node) -> float | None:
    end = root.first("StopTrigger", "SimulationTimeCondition")
    return None if end is None else end.number("value")


def _lit(scenario: Scenario, root: Node) -> bool:
    """Return whether the controllers of a file, if it has any, do as the signal plan of a scenario."""
    place, plan = scenario.place, scenario.signals()
    shown = lights_of(root, scenario.duration)
    known = lights_at(place, shown) if shown else {}
    if not known:
        return not shown
    times = np.arange(0.0, scenario.duration, _EVERY) + _WITHIN
    expected = np.array([plan.colours(time, len(place.entrances)) for time in times.tolist()], dtype=np.int8)
    for entrance, light in known.items():
        colours = np.concatenate(([Colour.NONE], light.colours))[np.searchsorted(light.times, times, side="right")]
        if not np.array_equal(colours, expected[:, entrance]):
            return False
    return True

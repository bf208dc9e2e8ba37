"""Reads runs from OpenSCENARIO XML: files of `export_run` as simulated runs, files of other tools as recorded traffic.

An exported file has a note (`Note`) with the facts that trajectories can't hold: the ways of all vehicles, the collisions and
faults of the simulation, and the vehicle under test. Positions, times and speeds are read from the trajectories. A zone in the
note counts only if a station is at the border of a zone to within rounding.

A file of another tool is a log. Its vehicles are matched to ways, and a vehicle without a known way is left out.
"""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.builtin import LAYOUTS
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.bounds import FARTHEST, Name, Size, Step, check_size
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.junctionfile import Key
from pytest_rvads.runs.run import Collision, Facts, Fault, Run
from pytest_rvads.runs.states import Agent, Colour, Zone
from pytest_rvads.satellites.openscenario.xosc import FORMAT, Entity, TrajectoryFile, log_of, read_trajectories
from pytest_rvads.satellites.tracks.importing import recordings_in
from pytest_rvads.satellites.tracks.lightlog import lights_at
from pytest_rvads.satellites.tracks.logformats import check_facing
from pytest_rvads.support.decoding import decode, typed
from pytest_rvads.support.errors import RunError

__all__ = ["VERSION", "Judged", "Note", "Site", "read_played", "site_of"]

VERSION = 1
"""Version of the note."""
_SEARCH_RANGE = 0.75
"""Distance around the last station within which the next station is searched [m]; simulators use the same range."""
_STATION_TOLERANCE = 1e-6
"""Largest change of a station by rounding when a file is written and read [m]."""
_SLOWEST_REVERSE = 0.01
"""Slowest backward motion that counts [m/s]. A slower one is an artefact of lanes that overlap at a joint."""


class Site(msgspec.Struct, frozen=True):
    """The junction of an exported run or scenario."""

    name: Name
    id: Name
    """Id of the junction in its map."""
    digest: str
    """`Junction.digest`, which shows whether the map file has changed since the export."""


class Judged(msgspec.Struct, frozen=True):
    """The verdict that an exported file quotes."""

    rule: str
    status: str
    message: str


class _Way(msgspec.Struct, frozen=True, omit_defaults=True):
    name: Name
    route: Key
    """Entrance and exit."""
    zones: list[tuple[int, Zone]]
    """Run-length encoded: ticks, and the zone from there on. It counts where a station is at a border, within `_TIE`."""
    sized: bool = True
    """Whether its size is known; else the box in the file is that of a usual car, which no rule may judge."""


class Note(msgspec.Struct, frozen=True):
    """The facts about an exported run that its trajectories don't hold."""

    version: int
    label: Name
    dt: Step
    steps: Annotated[int, msgspec.Meta(ge=1, le=10_000_000)]
    site: Site
    agents: list[_Way]
    facts: Facts
    collisions: list[Collision] | None
    fault: Fault | None
    hash: str
    """Hash of the exported run."""
    verdict: Judged | None = None

    @classmethod
    def of(cls, run: Run, verdict: Judged | None) -> Note:
        """Return the note about a run."""
        return cls(
            VERSION,
            run.label,
            run.dt,
            run.steps,
            Site(run.junction.name, run.junction.id, run.junction.digest),
            [_Way(a.name, a.way.key, _run_lengths(run.zone[:, k]), a.size is not None) for k, a in enumerate(run.agents)],
            run.facts,
            None if run.collisions is None else list(run.collisions),
            run.fault and replace(run.fault, detail=""),
            run.hash,
            verdict,
        )


def _run_lengths(zone: NDArray[np.int8]) -> list[tuple[int, Zone]]:
    starts = [0, *(np.flatnonzero(np.diff(zone)) + 1).tolist()]
    return [(tick, Zone(int(zone[tick]))) for tick in starts]


def read_played(path: str | Path) -> Sequence[Run]:
    """Read the runs of a file; the path of its map is relative to the file's folder.

    Raises:
        RunError: the file can't be read, no entity follows a trajectory, or the junction of the traffic is ambiguous.
        MapError: the map can't be read.
    """
    path = Path(path)
    file = read_trajectories(path)
    if file.note is None:
        log = log_of(file)
        check_facing(log)
        recordings = recordings_in(log, FORMAT.point)
        return recordings[0] if len(recordings) == 1 else [run for recording in recordings for run in recording]
    note = decode(file.note.encode(), Note, f"{file.where}: the property rvads.run", RunError)
    if note.version != VERSION:
        raise RunError(f"{file.where}: the property rvads.run has version {note.version}, expected {VERSION}: export it again")
    return [_simulated_run(file, note, site_of(note.site, file.map, file.where))]


def site_of(site: Site, map: Path | None, where: str) -> Junction:
    """Return the junction of an export.

    Raises:
        RunError: the junction differs from the junction that was exported.
        MapError: the junction can't be found.
    """
    if site.name in LAYOUTS and (builtin := find(site.name)).digest == site.digest:
        return builtin
    if map is None:
        raise RunError(f"{where}: the file names no map in <LogicFile>, expected the map of junction {site.name!r}")
    junction = _with_name(find(site.id, map), site.name)
    if junction.digest != site.digest:
        raise RunError(
            f"{where}: junction {site.name!r} of map file {map} has changed since the export: put the original map into the "
            "folder, or remove the property rvads.run or rvads.scenario, and the file is read like a file of another tool"
        )
    return junction


@lru_cache(maxsize=16)
def _with_name(junction: Junction, name: str) -> Junction:
    """Return a junction with another name. Equal arguments give the same object, and its cached results are computed once."""
    return junction if junction.name == name else replace(junction, name=name)


def _simulated_run(file: TrajectoryFile, note: Note, junction: Junction) -> Run:
    check_size(file.where, [(note.steps, len(note.agents), len(junction.entrances))])
    if not junction.drivable:
        raise RunError(f"{file.where}: the geometry of junction {junction.name!r} is not known")
    entities = {entity.name: entity for entity in file.entities}
    agents, columns = [], []
    for way in note.agents:
        entity, vertices = entities.get(way.name), file.ways.get(way.name)
        if entity is None or vertices is None or entity.ahead is None or way.route not in junction.movements:
            route = f"entrance {way.route[0]} to exit {way.route[1]}"
            why = (
                "the junction has no such movement" if way.route not in junction.movements else "the file has no such trajectory"
            )
            raise RunError(f"{file.where}: the property rvads.run sends {way.name!r} from {route}, and {why}")
        agents.append(Agent(way.name, junction.movements[way.route], entity.kind, _size(file, entity) if way.sized else None))
        columns.append(_motion(file, note, entity, itinerary(junction, *way.route), way.zones))
    names = [agent.name for agent in agents]
    named_vehicles = [note.facts.subject, *note.facts.strayed, *(name for c in note.collisions or () for name in c.agents)]
    if len({*names}) < len(names) or not {*named_vehicles} <= {None, *names}:
        raise RunError(f"{file.where}: the property rvads.run names a vehicle twice, or a vehicle that is not in the file")
    if not all(0 <= round(collision.time / note.dt) < note.steps for collision in note.collisions or ()):
        raise RunError(f"{file.where}: the property rvads.run has a collision after the end of the run")
    pose, station, speed, zone = (np.stack(parts, axis=1) for parts in zip(*columns, strict=True))
    return Run(
        note.label,
        junction,
        tuple(agents),
        zone,
        _lights(file, note, junction),
        note.dt,
        station,
        speed,
        pose,
        collisions=None if note.collisions is None else tuple(note.collisions),
        fault=note.fault,
        facts=note.facts,
        provenance={"openscenario": file.where},
    )


def _size(file: TrajectoryFile, entity: Entity) -> tuple[float, float]:
    """Return the size of a vehicle, within the bounds for sizes in files of runs."""
    return typed(entity.size, tuple[Size, Size], f"{file.where}: length and width of {entity.name!r}", RunError)


def _lights(file: TrajectoryFile, note: Note, junction: Junction) -> NDArray[np.int8]:
    lights = np.zeros((note.steps, len(junction.entrances)), dtype=np.int8)
    ticks = np.arange(note.steps)
    for entrance, changes in (lights_at(junction, file.lights) if file.lights else {}).items():
        colours = np.concatenate(([Colour.NONE], changes.colours)).astype(np.int8)
        lights[:, entrance] = colours[np.searchsorted(np.round(changes.times / note.dt), ticks, side="right")]
    return lights


def _motion(
    file: TrajectoryFile, note: Note, entity: Entity, way: Itinerary, zones: Sequence[tuple[int, Zone]]
) -> tuple[NDArray[Any], ...]:
    """Return pose, station, speed and zone of a vehicle in every state, as a `Run` has them.

    The speed in a state is the distance of the rear axle in the step before, along the heading, divided by the duration of the
    step. This holds for rolling without slipping.
    """
    starts = [tick for tick, _ in zones]
    if not starts or starts[0] != 0 or any(b <= a for a, b in pairwise(starts)) or starts[-1] >= note.steps:
        raise RunError(
            f"{file.where}: the zones of {entity.name!r} in the property rvads.run must begin at tick 0, increase and stay "
            f"below {note.steps}, got {reprlib.repr(starts)}"
        )
    vertices, ahead = file.ways[entity.name], entity.ahead or 0.0
    numbers = np.round(vertices[:, 1] / note.dt)
    if len(numbers) < 2 or np.isnan(vertices).any() or (np.diff(numbers) <= 0.0).any() or numbers[0] != 0.0:
        raise RunError(
            f"{file.where}: the trajectory of {entity.name!r} must begin at 0 s, have times at multiples of {note.dt:g} s, and "
            "have a heading at every vertex"
        )
    if numbers[-1] < note.steps - 1 and zones[-1][1] is not Zone.GONE:
        raise RunError(
            f"{file.where}: the trajectory of {entity.name!r} must last to the end of the run at "
            f"{(note.steps - 1) * note.dt:g} s, or until the vehicle is gone, got an end at {vertices[-1, 1]:g} s"
        )
    first_speed = file.speeds.get(entity.name)
    if max(np.abs(vertices[:, 2:]).max(), abs(first_speed or 0.0)) > FARTHEST:
        raise RunError(f"{file.where}: {entity.name!r} has a position, heading or speed beyond {FARTHEST:g}")
    ticks = np.arange(note.steps)
    axle = np.stack([np.interp(ticks, numbers, vertices[:, k]) for k in (2, 3)], axis=1)
    heading = np.interp(ticks, numbers, np.unwrap(vertices[:, 4]))
    front = axle + ahead * np.column_stack((np.cos(heading), np.sin(heading)))
    middle = (heading[1:] + heading[:-1]) / 2
    moved = (np.diff(axle, axis=0) * np.column_stack((np.cos(middle), np.sin(middle)))).sum(axis=1) / note.dt
    speed = np.concatenate(([moved[:1].sum() if first_speed is None else first_speed], moved))
    station = _stations(way, front, speed)
    stated_zone = np.repeat(np.array([zone for _, zone in zones], dtype=np.int8), np.diff([*starts, note.steps]))
    low, high = (
        np.array([way.zone(value) for value in (station + shift).tolist()], dtype=np.int8)
        for shift in (-_STATION_TOLERANCE, _STATION_TOLERANCE)
    )
    zone = np.clip(stated_zone, low, high)
    return np.column_stack((front, heading)), station, speed, zone


def _stations(way: Itinerary, front: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the station of a vehicle in every state; each station is searched around the station before."""
    path, stations = way.path, np.empty(len(front))
    points = front.tolist()
    along, _ = path.project(points[0][0], points[0][1], path.length / 2, path.length)
    stations[0] = along
    for k, (x, y) in enumerate(points[1:], start=1):
        if x != front[k - 1, 0] or y != front[k - 1, 1]:
            ahead, _ = path.project(x, y, along, _SEARCH_RANGE)
            along = ahead if ahead >= along or speed[k] <= -_SLOWEST_REVERSE else along
        stations[k] = along
    return stations - way.origin

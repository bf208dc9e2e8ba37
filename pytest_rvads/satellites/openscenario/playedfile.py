"""Reads runs from OpenSCENARIO XML: files of `export_run` as simulated runs, files of other tools as recorded traffic.

An exported file has a note (`Note`) with the facts that trajectories can't express: the ways of all vehicles, the collisions and
faults of the simulation, and the vehicle under test. Positions, times and speeds are read from the trajectories. The zones in the
note are used only where a vehicle is so close to the border of two zones that rounding decides on its zone.

In a file of another tool, each vehicle is matched to a way through a junction; a vehicle that fits no way is left out.
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
from pytest_rvads.runs.archive import FARTHEST, Name, Size, Step, check_size
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.junctionfile import Key
from pytest_rvads.runs.run import Collision, Facts, Fault, Run
from pytest_rvads.runs.states import Agent, Colour, Zone
from pytest_rvads.satellites.openscenario.xosc import FORMAT, Entity, TrajectoryFile, log_of, read_trajectories
from pytest_rvads.satellites.tracks.facing import with_headings
from pytest_rvads.satellites.tracks.importing import recordings_in
from pytest_rvads.satellites.tracks.lightlog import lights_at
from pytest_rvads.support.decoding import decode, typed
from pytest_rvads.support.errors import RunError

VERSION = 1
"""Version of the fields of `Note`; a file with another version is refused."""
_SEARCH_RANGE = 0.75
"""Distance around the station of a vehicle within which its station in the next state is searched [m], as in simulators."""
_STATION_TOLERANCE = 1e-6
"""Largest change of a station by rounding when a file is written and read [m]."""
_SLOWEST_REVERSE = 0.01
"""Least backward speed at which a station decreases [m/s]; slower backward motion is an artefact of lanes that overlap."""


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
    """Pairs of a tick and the zone of the vehicle from this tick on.

    These zones are used only for stations within `_STATION_TOLERANCE` of the border of two zones.
    """
    sized: bool = True
    """Whether the size of the vehicle is known. If not, the box in the file is the box of a usual car, and no rule uses it."""


class Note(msgspec.Struct, frozen=True):
    """The facts about an exported run that trajectories can't express; a property in the header of the file holds the note."""

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
        """Return the note about a run, with a verdict that the exported file quotes."""
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
    """Return the run of an exported file, or the runs into which the traffic in a file of another tool is cut."""
    path = Path(path)
    file = read_trajectories(path)
    if file.note is None:
        log = with_headings(log_of(file))
        recordings = recordings_in(log, FORMAT.point)
        return recordings[0] if len(recordings) == 1 else [run for recording in recordings for run in recording]
    note = decode(file.note.encode(), Note, f"{file.where}: the property rvads.run", RunError)
    if note.version != VERSION:
        raise RunError(f"{file.where}: the property rvads.run has version {note.version}, expected {VERSION}: export it again")
    return [_simulated_run(file, note, site_of(note.site, file.map, file.where))]


def site_of(site: Site, map: Path | None, where: str) -> Junction:
    """Return the junction of an exported run or scenario, from the built-in maps or from the map of the file.

    Args:
        map: path of the map that the file names; None if the file names no map.
    """
    if site.name in LAYOUTS and (builtin := _as_exported(find(site.name), site.digest)).digest == site.digest:
        return builtin
    if map is None:
        raise RunError(f"{where}: the file names no map in <LogicFile>, expected the map of junction {site.name!r}")
    junction = _as_exported(_with_name(find(site.id, map), site.name), site.digest)
    if junction.digest != site.digest:
        raise RunError(
            f"{where}: junction {site.name!r} of map file {map} has changed since the export: put the original map into the "
            "folder, or remove the property rvads.run or rvads.scenario, and the file is read like a file of another tool"
        )
    return junction


def _as_exported(junction: Junction, digest: str) -> Junction:
    """Return the junction with the ways of pedestrians if the exported junction had these ways."""
    return junction.walked if junction.walked.digest == digest else junction


@lru_cache(maxsize=16)
def _with_name(junction: Junction, name: str) -> Junction:
    """Return a junction with another name; equal arguments give the same object, so that values cached in the object are kept."""
    return junction if junction.name == name else replace(junction, name=name)


def _simulated_run(file: TrajectoryFile, note: Note, junction: Junction) -> Run:
    check_size(file.where, [(note.steps, len(note.agents), len(junction.starts))])
    if not junction.drivable:
        raise RunError(f"{file.where}: the geometry of junction {junction.name!r} is not known")
    entities = {entity.name: entity for entity in file.entities}
    agents, columns = [], []
    for way in note.agents:
        entity, vertices = entities.get(way.name), file.ways.get(way.name)
        if entity is None or vertices is None or entity.ahead is None or way.route not in junction.every_way:
            route = f"entrance {way.route[0]} to exit {way.route[1]}"
            why = "the junction has no such way" if way.route not in junction.every_way else "the file has no such trajectory"
            raise RunError(f"{file.where}: the property rvads.run sends {way.name!r} from {route}, and {why}")
        agents.append(Agent(way.name, junction.every_way[way.route], entity.kind, _size(file, entity) if way.sized else None))
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
    """Return length and width of a vehicle; raise RunError if they are outside of the bounds for sizes in files of runs."""
    return typed(entity.size, tuple[Size, Size], f"{file.where}: length and width of {entity.name!r}", RunError)


def _lights(file: TrajectoryFile, note: Note, junction: Junction) -> NDArray[np.int8]:
    lights = np.zeros((note.steps, len(junction.starts)), dtype=np.int8)
    ticks = np.arange(note.steps)
    for entrance, changes in (lights_at(junction, file.lights) if file.lights else {}).items():
        if entrance >= len(junction.starts):
            continue  # a pedestrian light in the file of a run in which nobody walks
        colours = np.concatenate(([Colour.NONE], changes.colours)).astype(np.int8)
        lights[:, entrance] = colours[np.searchsorted(np.round(changes.times / note.dt), ticks, side="right")]
    return lights


def _motion(
    file: TrajectoryFile, note: Note, entity: Entity, way: Itinerary, zones: Sequence[tuple[int, Zone]]
) -> tuple[NDArray[Any], ...]:
    """Return pose, station, speed and zone of a vehicle in every state, in the form of the columns of a `Run`.

    The speed in a state is the distance that the rear axle moved along the heading since the state before, divided by the time
    between the states. This speed is exact if the wheels roll without slipping.
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
    """Return the station of a vehicle in every state; each station is searched around the station in the state before."""
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

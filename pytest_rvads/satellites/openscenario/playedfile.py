"""Reads runs from OpenSCENARIO XML: files of `export_run` as simulated runs, files of other tools as recorded traffic.

An exported file has a note (`Note`) with the facts that trajectories can't hold: the ways of the vehicles, the collisions and
faults of the simulation, and the vehicle under test. Positions, times and speeds are read from the trajectories.

A zone in the note counts only where a station is at a border to within rounding. Files of other tools are logs: their vehicles
are matched, and a vehicle whose way can't be told is left out. Files of an export also hold the ways of vehicles that never move.
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

from pytest_rvads.decoding import decode, typed
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.builtin import LAYOUTS
from pytest_rvads.junctions.finder import find
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.bounds import FARTHEST, Name, Size, Step, check_size
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.junctionfile import Key
from pytest_rvads.runs.run import Collision, Facts, Fault, Run
from pytest_rvads.runs.states import Agent, Colour, Zone
from pytest_rvads.satellites.openscenario.played import Entity, Played, played
from pytest_rvads.satellites.openscenario.xosc import FORMAT, log_of
from pytest_rvads.satellites.tracks.importing import recordings_in
from pytest_rvads.satellites.tracks.lightlog import lights_at
from pytest_rvads.satellites.tracks.logformats import check_facing

__all__ = ["VERSION", "Judged", "Note", "Site", "read_played", "site_of"]

VERSION = 1
_WINDOW = 0.75
"""How far around its last station a vehicle is looked for [m], as where it was simulated."""
_TIE = 1e-6
"""Stations are rounded to less than this when they are written and read [m]."""
_BACK = 0.01
"""Whoever moves backwards no faster than this only seems to, where lanes overlap at a joint [m/s]."""


class Site(msgspec.Struct, frozen=True):
    """The junction that somebody drove, or is to drive, through."""

    name: Name
    id: Name
    """In its map."""
    digest: str
    """See `Junction.digest`: the map beside must be that which it was exported with."""


class Judged(msgspec.Struct, frozen=True):
    """What a run was exported for."""

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
    """What an export says of a run beside its trajectories."""

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
    """Of the run that was exported."""
    verdict: Judged | None = None

    @classmethod
    def of(cls, run: Run, verdict: Judged | None) -> Note:
        """Return what there is to say of a run."""
        return cls(
            VERSION,
            run.label,
            run.dt,
            run.steps,
            Site(run.junction.name, run.junction.id, run.junction.digest),
            [_Way(a.name, a.route.key, _encoded(run.zone[:, k]), a.size is not None) for k, a in enumerate(run.agents)],
            run.facts,
            None if run.collisions is None else list(run.collisions),
            run.fault and replace(run.fault, detail=""),
            run.hash,
            verdict,
        )


def _encoded(zone: NDArray[np.int8]) -> list[tuple[int, Zone]]:
    starts = [0, *(np.flatnonzero(np.diff(zone)) + 1).tolist()]
    return [(tick, Zone(int(zone[tick]))) for tick in starts]


def read_played(path: str | Path) -> Sequence[Run]:
    """Read the runs of a file; the path of its map is relative to the file's folder.

    Raises:
        RunError: the file can't be read, no entity follows a trajectory, or the junction of the traffic is ambiguous.
        MapError: the map can't be read.
    """
    path = Path(path)
    found = played(path)
    if found.note is None:
        log = log_of(found)
        check_facing(log)
        recordings = recordings_in(log, FORMAT.point)
        return recordings[0] if len(recordings) == 1 else [run for recording in recordings for run in recording]
    note = decode(found.note.encode(), Note, f"{found.where}: the property rvads.run", RunError)
    if note.version != VERSION:
        raise RunError(f"{found.where}: exported in version {note.version} of the property rvads.run, expected {VERSION}")
    return [_exact(found, note, site_of(note.site, found.map, found.where))]


def site_of(site: Site, map: Path | None, where: str) -> Junction:
    """Return the junction of an export.

    Raises:
        RunError: the junction differs from the junction that was exported.
        MapError: the junction can't be found.
    """
    if site.name in LAYOUTS and (known := find(site.name)).digest == site.digest:
        return known
    if map is None:
        raise RunError(f"{where}: it names no map in <LogicFile>, expected that of junction {site.name!r}")
    found = _named(find(site.id, map), site.name)
    if found.digest != site.digest:
        raise RunError(
            f"{where}: junction {site.name!r} of map file {map} is not as it was when the file was exported: put the map of then "
            "beside it, or take out the property rvads.run or rvads.scenario, so that it is read as somebody else's"
        )
    return found


@lru_cache(maxsize=16)
def _named(junction: Junction, name: str) -> Junction:
    """Return a junction under another name. Equal arguments give the same object, so its cached results are computed once."""
    return junction if junction.name == name else replace(junction, name=name)


def _exact(found: Played, note: Note, junction: Junction) -> Run:
    check_size(found.where, [(note.steps, len(note.agents), len(junction.entrances))])
    if not junction.drivable:
        raise RunError(f"{found.where}: it is not known where the lanes of junction {junction.name!r} lie")
    entities = {entity.name: entity for entity in found.entities}
    agents, columns = [], []
    for way in note.agents:
        entity, vertices = entities.get(way.name), found.ways.get(way.name)
        if entity is None or vertices is None or entity.ahead is None or way.route not in junction.movements:
            why = "no movement leads there" if way.route not in junction.movements else "it has no vehicle with such a trajectory"
            raise RunError(f"{found.where}: {way.name!r} was to go from entrance {way.route[0]} to exit {way.route[1]}: {why}")
        agents.append(Agent(way.name, junction.movements[way.route], entity.kind, _size(found, entity) if way.sized else None))
        columns.append(_column(found, note, entity, itinerary(junction, *way.route), way.zones))
    names = [agent.name for agent in agents]
    told = [note.facts.subject, *note.facts.strayed, *(name for c in note.collisions or () for name in c.agents)]
    if len({*names}) < len(names) or not {*told} <= {None, *names}:
        raise RunError(f"{found.where}: the property rvads.run names a vehicle twice, or one that is not in it")
    if not all(0 <= round(collision.time / note.dt) < note.steps for collision in note.collisions or ()):
        raise RunError(f"{found.where}: the property rvads.run has a collision after the end of the run")
    pose, station, speed, zone = (np.stack(parts, axis=1) for parts in zip(*columns, strict=True))
    return Run(
        note.label,
        junction,
        tuple(agents),
        zone,
        _lights(found, note, junction),
        note.dt,
        station,
        speed,
        pose,
        collisions=None if note.collisions is None else tuple(note.collisions),
        fault=note.fault,
        facts=note.facts,
        provenance={"openscenario": found.where},
    )


def _size(found: Played, entity: Entity) -> tuple[float, float]:
    """Return the size of a vehicle, within the bounds of every file of runs."""
    return typed(entity.size, tuple[Size, Size], f"{found.where}: length and width of {entity.name!r}", RunError)


def _lights(found: Played, note: Note, junction: Junction) -> NDArray[np.int8]:
    lights = np.zeros((note.steps, len(junction.entrances)), dtype=np.int8)
    ticks = np.arange(note.steps)
    for entrance, changes in (lights_at(junction, found.lights) if found.lights else {}).items():
        known = np.concatenate(([Colour.NONE], changes.colours)).astype(np.int8)
        lights[:, entrance] = known[np.searchsorted(np.round(changes.times / note.dt), ticks, side="right")]
    return lights


def _column(
    found: Played, note: Note, entity: Entity, way: Itinerary, zones: Sequence[tuple[int, Zone]]
) -> tuple[NDArray[Any], ...]:
    """Return pose, station, speed and zone of one vehicle in every state, see `Run`.

    Speed is what the middle of its rear axle, which moves as the body heads, made in the step before: rolling without slipping.
    """
    starts = [tick for tick, _ in zones]
    if not starts or starts[0] != 0 or any(b <= a for a, b in pairwise(starts)) or starts[-1] >= note.steps:
        raise RunError(
            f"{found.where}: the zones of {entity.name!r} in the property rvads.run must begin at tick 0, increase and stay "
            f"below {note.steps}, got {reprlib.repr(starts)}"
        )
    vertices, ahead = found.ways[entity.name], entity.ahead or 0.0
    numbers = np.round(vertices[:, 1] / note.dt)
    if len(numbers) < 2 or np.isnan(vertices).any() or (np.diff(numbers) <= 0.0).any() or numbers[0] != 0.0:
        raise RunError(
            f"{found.where}: the trajectory of {entity.name!r} must begin at 0 s, go on in steps of {note.dt:g} s, and have a "
            "heading at every vertex"
        )
    if numbers[-1] < note.steps - 1 and zones[-1][1] is not Zone.GONE:
        raise RunError(
            f"{found.where}: the trajectory of {entity.name!r} must last to the end of the run at "
            f"{(note.steps - 1) * note.dt:g} s, or until it is gone, got an end at {vertices[-1, 1]:g} s"
        )
    first = found.speeds.get(entity.name)
    if max(np.abs(vertices[:, 2:]).max(), abs(first or 0.0)) > FARTHEST:
        raise RunError(f"{found.where}: {entity.name!r} has a place, heading or speed beyond {FARTHEST:g}")
    ticks = np.arange(note.steps)
    axle = np.stack([np.interp(ticks, numbers, vertices[:, k]) for k in (2, 3)], axis=1)
    heading = np.interp(ticks, numbers, np.unwrap(vertices[:, 4]))
    front = axle + ahead * np.column_stack((np.cos(heading), np.sin(heading)))
    middle = (heading[1:] + heading[:-1]) / 2
    moved = (np.diff(axle, axis=0) * np.column_stack((np.cos(middle), np.sin(middle)))).sum(axis=1) / note.dt
    speed = np.concatenate(([moved[:1].sum() if first is None else first], moved))
    station = _stations(way, front, speed)
    stated = np.repeat(np.array([zone for _, zone in zones], dtype=np.int8), np.diff([*starts, note.steps]))
    low, high = (np.array([way.zone(value) for value in (station + shift).tolist()], dtype=np.int8) for shift in (-_TIE, _TIE))
    zone = np.clip(stated, low, high)
    return np.column_stack((front, heading)), station, speed, zone


def _stations(way: Itinerary, front: NDArray[np.float64], speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where a vehicle is along its way in every state, each looked for around the one before."""
    path, found = way.path, np.empty(len(front))
    points = front.tolist()
    along, _ = path.project(points[0][0], points[0][1], path.length / 2, path.length)
    found[0] = along
    for k, (x, y) in enumerate(points[1:], start=1):
        if x != front[k - 1, 0] or y != front[k - 1, 1]:
            ahead, _ = path.project(x, y, along, _WINDOW)
            along = ahead if ahead >= along or speed[k] <= -_BACK else along
        found[k] = along
    return found - way.origin

"""Runs recorded elsewhere: the JSON format in which the authors of the paper's runs were decoded.

A file holds the topology of one junction and many runs; a series is run-length encoded as ``[[tick, value], ...]``.
Positions and speeds are not recorded, so they are None in the runs read here.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import MapError, RunError
from pytest_rvads.junctions.junction import Junction, JunctionControl, Movement, Sign, cross
from pytest_rvads.maps.segment import Turn
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Colour, Zone

__all__ = ["read_recorded"]

_MOST_TICKS = 10_000_000
"""Over a day in steps of 10 ms; more is a mistake in the file, not a run."""
_ROTATION = re.compile(r"_r=(\d+)$")
_SIGNS = {"stop_sign": Sign.STOP, "traffic_light": Sign.LIGHTS}
_NUMBER = re.compile(r"(\d+)$")
"""Of a vehicle, in its name: c0, c1, ..."""


def read_recorded(path: str | Path) -> list[Run]:
    """Read all runs of a file.

    Args:
        path: of a JSON file.

    Returns:
        The runs in the order of the file; ``provenance["verdicts"]`` holds the published verdicts as they stand there,
        ``provenance["starts"]`` per vehicle how far before its entrance [m] and how fast [m/s] it started, where that is told.

    Raises:
        RunError: the file is not of this format; the message names the run and the field.
    """
    path = Path(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RunError(f"{path}: can't be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path}: not a JSON file: {error}") from error
    file = _Fields(data, path.name)
    runs = file.array("runs")
    topology = _Topology.read(file, [_Fields(r, f"{path.name}: run {k}") for k, r in enumerate(runs)])
    return [topology.run(_Fields(r, f"{path.name}: run {k}")) for k, r in enumerate(runs)]


class _Fields:
    """A JSON object whose fields are asked for by type, so that every error names the place."""

    def __init__(self, data: object, where: str) -> None:
        if not isinstance(data, dict):
            raise RunError(f"{where}: expected an object, got {type(data).__name__}")
        self._data: Mapping[str, Any] = data
        self.where = where

    def _get(self, name: str, kind: type | tuple[type, ...], what: str) -> Any:
        if name not in self._data:
            raise RunError(f"{self.where}: the field {name!r} is missing")
        value = self._data[name]
        if not isinstance(value, kind) or isinstance(value, bool):
            raise RunError(f"{self.where}: the field {name!r} must be {what}, got {type(value).__name__}")
        return value

    def text(self, name: str) -> str:
        return str(self._get(name, str, "a text"))

    def array(self, name: str) -> list[Any]:
        found: list[Any] = self._get(name, list, "a list")
        return found

    def number(self, name: str) -> float:
        value = float(self._get(name, (int, float), "a number"))
        if not np.isfinite(value):
            raise RunError(f"{self.where}: the field {name!r} must be a finite number, got {value}")
        return value

    def object(self, name: str) -> _Fields:
        return _Fields(self._get(name, dict, "an object"), f"{self.where}: {name}")

    def optional(self, name: str) -> Any:
        return self._data.get(name)

    def plain(self) -> dict[str, Any]:
        return dict(self._data)

    def items(self) -> list[tuple[str, _Fields]]:
        return [(key, _Fields(value, f"{self.where}: {key}")) for key, value in self._data.items()]

    def series(self, name: str, ticks: int, kind: type) -> list[tuple[int, Any]]:
        """Return a run-length encoded series after checking that it covers the run in order."""
        found = self.array(name)
        pairs = [(p[0], p[1]) for p in found if isinstance(p, list) and len(p) == 2]
        starts = [p[0] for p in pairs]
        if len(pairs) != len(found) or any(type(t) is not int or type(v) is not kind for t, v in pairs):
            what = "text" if kind is str else "number"
            raise RunError(f"{self.where}: the series {name!r} must be a list of [tick, {what}]")
        if not pairs or starts[0] != 0 or any(b <= a for a, b in pairwise(starts)) or starts[-1] >= ticks:
            raise RunError(f"{self.where}: the ticks of the series {name!r} must start at 0, increase, and stay below {ticks}")
        return pairs


@dataclass(frozen=True, slots=True)
class _Topology:
    junction: Junction
    entrances: Mapping[str, int]
    """Number of the entrance at a node."""
    edges: Mapping[str, Movement]
    signals: Mapping[str, int]

    @classmethod
    def read(cls, file: _Fields, runs: Sequence[_Fields]) -> _Topology:
        graph = file.object("graph")
        nodes, exits = [str(v) for v in graph.array("entrances")], [str(v) for v in graph.array("exits")]
        edges = [_Fields(e, f"{graph.where}: edge {k}") for k, e in enumerate(graph.array("edges"))]
        ways = [(e.text("id"), e.text("source"), e.text("target"), e.text("turn"), e.number("length")) for e in edges]
        right_of = _pairs(file, "right_of", nodes)
        numbers = _count(nodes, ways, right_of, runs)
        # An exit belongs to the arm from whose entrance no movement leads to it: there are no U-turns.
        arms = {}
        for node in exits:
            own = [n for n in nodes if not any(s == n and t == node for _, s, t, _, _ in ways)]
            if len(own) != 1:
                raise RunError(f"{graph.where}: exit {node!r} must be reached from all entrances but one, not from {len(own)}")
            arms[node] = numbers[own[0]]
        movements = {}
        for name, source, target, turn, length in ways:
            if source not in numbers or target not in arms or turn not in set(Turn):
                raise RunError(
                    f"{graph.where}: edge {name!r} must lead from an entrance to an exit and turn left, straight or right"
                )
            movements[name] = Movement(numbers[source], arms[target], Turn(turn), length, name)
        signals = [_Fields(s, f"{graph.where}: signal {k}") for k, s in enumerate(graph.array("signals"))]
        kinds = {node: s.text("kind") for s in signals if (node := s.text("node")) in numbers}
        opposite = _pairs(file, "opposite", nodes)
        pairs = frozenset((numbers[a], numbers[b]) for a, b in opposite)
        signs = [_SIGNS.get(kinds.get(node, ""), Sign.NONE) for node in sorted(nodes, key=numbers.__getitem__)]
        groups = _groups(len(nodes), pairs) if set(signs) == {Sign.LIGHTS} else ()
        entrances, exits_ = cross(signs, phase_groups=groups)
        try:
            junction = Junction(
                graph.text("junction"),
                graph.text("junction"),
                entrances,
                exits_,
                {m.key: m for m in movements.values()},
                frozenset((numbers[a], numbers[b]) for a, b in right_of),
                pairs,
            )
        except MapError as error:
            raise RunError(f"{graph.where}: {error}") from error
        lights = {s.text("id"): numbers[s.text("node")] for s in signals if s.text("node") in numbers}
        return cls(junction, numbers, movements, lights)

    def run(self, record: _Fields) -> Run:
        """Decode one run."""
        name = record.text("name")
        record.where = f"{record.where.rpartition(': ')[0]}: run {name!r}"
        ticks = record.number("ticks")
        if not 1 <= ticks <= _MOST_TICKS or ticks != int(ticks):
            raise RunError(f"{record.where}: a run must have at least one tick and at most {_MOST_TICKS:,}, got {ticks:g}")
        dt = record.number("dt")
        if dt <= 0:
            raise RunError(f"{record.where}: the field 'dt' must be positive, got {dt:g}")
        steps = int(ticks)
        agents, zones, starts = [], [], {}
        for vehicle, fields in record.object("vehicles").items():
            movement, zone = self._vehicle(fields, steps)
            agents.append(Agent(vehicle, movement))
            zones.append(zone)
            if fields.optional("init_offset") is not None and fields.optional("init_speed") is not None:
                starts[vehicle] = (fields.number("init_offset"), fields.number("init_speed"))
        lights = np.full((steps, len(self.junction.entrances)), Colour.NONE, dtype=np.int8)
        if self.junction.control in (JunctionControl.LIGHTS, JunctionControl.PARTIAL) or record.optional("lights"):
            self._lights(record.object("lights"), lights)
        zone = np.column_stack(zones) if zones else np.zeros((steps, 0), dtype=np.int8)
        verdicts = record.object("verdicts").plain() if record.optional("verdicts") else {}
        provenance = {"verdicts": verdicts, "starts": starts}
        return Run(name, self.junction, tuple(agents), zone, lights, dt, provenance=provenance)

    def _vehicle(self, fields: _Fields, steps: int) -> tuple[Movement, NDArray[np.int8]]:
        itinerary = [str(e) for e in fields.array("itinerary")]
        ways = [k for k, e in enumerate(itinerary) if e in self.edges]
        if len(ways) != 1:
            raise RunError(f"{fields.where}: the itinerary {itinerary} must pass the junction once, it does {len(ways)} times")
        movement = self.edges[itinerary[ways[0]]]
        order = {e: Zone.APPROACH if k < ways[0] else Zone.EXIT for k, e in enumerate(itinerary)}
        order[itinerary[ways[0]]] = Zone.JUNCTION
        zone = np.empty(steps, dtype=np.int8)
        for tick, edge in fields.series("edge", steps, str):
            if edge not in order:
                raise RunError(f"{fields.where}: edge {edge!r} at tick {tick} is not on its itinerary {itinerary}")
            zone[tick:] = order[edge]
        at = np.zeros(steps, dtype=np.bool_)
        for tick, node in fields.series("at_entrance", steps, str):
            if node and self.entrances.get(node) != movement.entrance:
                raise RunError(f"{fields.where}: at entrance {node!r} at tick {tick}, which is not on its itinerary")
            at[tick:] = bool(node)
        # The entrance vertex belongs to the road: once on the movement, a vehicle is in the junction and nowhere else.
        zone[at & (zone == Zone.APPROACH)] = Zone.ENTRANCE
        return movement, zone

    def _lights(self, records: _Fields, lights: NDArray[np.int8]) -> None:
        for name, fields in records.items():
            entrance = self.entrances.get(fields.text("node"))
            for tick, colour in fields.series("color", len(lights), int):
                if colour not in (1, 2, 3):
                    raise RunError(f"{fields.where}: the color at tick {tick} must be 1, 2 or 3, got {colour!r}")
                if entrance is not None:
                    lights[tick:, entrance] = colour
            if entrance is None and name in self.signals:
                raise RunError(f"{fields.where}: node {fields.text('node')!r} is not an entrance")


def _pairs(file: _Fields, name: str, nodes: Sequence[str]) -> list[tuple[str, str]]:
    pairs = [tuple(p) if isinstance(p, list) else () for p in file.array(name)]
    if any(len(p) != 2 or p[0] not in nodes or p[1] not in nodes for p in pairs):
        raise RunError(f"{file.where}: the field {name!r} must hold pairs of entrances")
    return [(p[0], p[1]) for p in pairs]


def _count(
    nodes: Sequence[str],
    ways: Sequence[tuple[str, str, str, str, float]],
    right_of: Sequence[tuple[str, str]],
    runs: Sequence[_Fields],
) -> dict[str, int]:
    """Number the entrances: vehicle i of a run in rotation r stands at entrance (i + r) mod n.

    Where no vehicles tell all of them, they follow each other by right-of; where that doesn't tell either, as in the file.
    """
    told = _told(nodes, ways, runs)
    if sorted(told.values()) == list(range(len(nodes))):
        return told
    follows = {left: right for right, left in right_of}
    first = next((n for n in nodes if n not in follows.values()), nodes[0] if nodes else "")
    order = [first]
    while order[-1] in follows and follows[order[-1]] not in order:
        order.append(follows[order[-1]])
    order = order if len(order) == len(nodes) else list(nodes)
    shift = next((number - order.index(node) for node, number in told.items()), 0)
    return {n: (k + shift) % len(nodes) for k, n in enumerate(order)}


def _told(nodes: Sequence[str], ways: Sequence[tuple[str, str, str, str, float]], runs: Sequence[_Fields]) -> dict[str, int]:
    """Return the numbers of the entrances at which a vehicle of a run that names its rotation starts."""
    starts = {name: source for name, source, *_ in ways if source in nodes}
    told: dict[str, int] = {}
    for run in runs:
        rotation = _ROTATION.search(run.text("name"))
        for vehicle, fields in run.object("vehicles").items() if rotation else ():
            number = _NUMBER.search(vehicle)
            source = next((starts[str(e)] for e in fields.array("itinerary") if str(e) in starts), None)
            if rotation and number and source is not None:
                told.setdefault(source, (int(number[1]) + int(rotation[1])) % len(nodes))
    return told


def _groups(ways: int, opposite: frozenset[tuple[int, int]]) -> tuple[frozenset[int], ...]:
    """Return the connected components of `opposite`, that of entrance 0 first."""
    groups: list[set[int]] = []
    for i in range(ways):
        home = next((g for g in groups if any((i, k) in opposite or (k, i) in opposite for k in g)), None)
        if home is None:
            groups.append({i})
        else:
            home.add(i)
    return tuple(map(frozenset, groups))

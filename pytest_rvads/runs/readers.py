"""Finds and reads files of runs: the suffix of a file selects its reader in the table `READERS`.

The JSON format of the published runs of the paper holds the topology of a junction and many runs. A series is run-length encoded
as ``[[tick, value], ...]``. The format has no positions and speeds, so the runs hold None instead of positions and speeds.
"""

from __future__ import annotations

import os
import re
import reprlib
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from glob import glob
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from pytest_rvads.geometry.control import Sign, phase_groups
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Movement, cross
from pytest_rvads.runs.archive import MOST_LANES, Name, Size, Step, check_size, peek
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import RECORDING, load_recording, load_run
from pytest_rvads.runs.states import Agent, Colour, Kind, Zone
from pytest_rvads.support.decoding import decode, typed
from pytest_rvads.support.errors import MapError, RunError
from pytest_rvads.support.installed import by_suffix
from pytest_rvads.support.storage import read_file

_MOST_BYTES = 16 * 2**20
"""Largest file [bytes]; a run takes a few kilobytes."""
_MOST_RUNS = 2000
_MOST_TICKS = 10_000_000
"""Most ticks of a run: over a day in steps of 10 ms."""
_ROTATION = re.compile(r"_r=(\d+)$")
_SIGNS = {"stop_sign": Sign.STOP, "yield_sign": Sign.YIELD, "priority_sign": Sign.PRIORITY}
"""Per kind of a signal its sign; signals of other kinds are lights."""
_COLOURS = {int(colour): colour for colour in (Colour.GREEN, Colour.YELLOW, Colour.RED)}
_NUMBER = re.compile(r"(\d+)$")
"""Pattern of the number of a vehicle in its name: c0, c1, ..."""
_LARGEST = sys.float_info.max
_Id = Annotated[str, Meta(max_length=1000)]
_Finite = Annotated[float, Meta(ge=-_LARGEST, le=_LARGEST)]
_Value = TypeVar("_Value")
_Lanes = Annotated[list[_Id], Meta(max_length=MOST_LANES)]
_Pairs = Annotated[list[tuple[_Id, _Id]], Meta(max_length=MOST_LANES**2)]
_Series = list[tuple[int, _Value]]
"""Run-length encoded series: ticks, and the value from each tick on."""


class Edge(Struct, frozen=True):
    """A movement of a recorded junction."""

    source: _Id
    """Node of the entrance."""
    target: _Id
    """Node of the exit."""
    turn: Turn
    length: Annotated[float, Meta(ge=0.0, le=_LARGEST)]
    """Length of the movement [m]."""


class _Edge(Edge, frozen=True, kw_only=True):
    id: _Id


class _Signal(Struct, frozen=True):
    id: _Id
    kind: str
    node: _Id


class _Graph(Struct, frozen=True):
    junction: Name
    entrances: _Lanes
    exits: _Lanes
    edges: Annotated[list[_Edge], Meta(max_length=MOST_LANES**2)]
    signals: list[_Signal]


class _Vehicle(Struct, frozen=True):
    itinerary: list[str]
    edge: _Series[str]
    at_entrance: _Series[str]
    init_offset: _Finite | None = None
    init_speed: _Finite | None = None
    kind: Kind = Kind.CAR
    size: tuple[Size, Size] | None = None
    """Length and width [m]."""


class _Light(Struct, frozen=True):
    node: _Id
    color: _Series[Annotated[int, Meta(ge=1, le=3)]]


class _Record(Struct, frozen=True):
    name: Name
    ticks: Annotated[float, Meta(ge=1, le=_MOST_TICKS, multiple_of=1)]
    dt: Step
    vehicles: dict[str, _Vehicle]
    lights: dict[str, _Light] | None = None
    verdicts: dict[str, Any] | None = None


class _File(Struct, frozen=True):
    graph: _Graph
    right_of: _Pairs
    opposite: _Pairs
    runs: Annotated[list[_Record], Meta(max_length=_MOST_RUNS)]


def read_recorded(path: str | Path) -> list[Run]:
    """Read all runs of a file in the format of the published runs.

    Args:
        path: path of a JSON file.

    Returns:
        The runs in the order of the file. ``provenance["verdicts"]`` holds the published verdicts of the file.
        ``provenance["starts"]`` holds, per vehicle, its distance before its entrance [m] and its speed [m/s] at the start, if the
        file states them.

    Raises:
        RunError: the file is not of this format, or too large; the message names the run and the field.
    """
    path = Path(path)
    try:
        text = read_file(path, _MOST_BYTES)
    except OSError as error:
        raise RunError(f"{path}: can't be read: {error.strerror}") from error
    file = decode(text, _File, path.name, RunError)
    lanes = len(file.graph.entrances)
    check_size(path.name, ((int(record.ticks), len(record.vehicles), lanes) for record in file.runs))
    topology = _Topology.read(file, path.name)
    return [topology.run(record, f"{path.name}: run {record.name!r}") for record in file.runs]


def _read_npz(path: str | Path) -> Sequence[Run]:
    is_recording = f'"format": "{RECORDING.format}"'.encode() in peek(Path(path), "header")
    return load_recording(path) if is_recording else [load_run(path)]


READERS: dict[str, Callable[[str | Path], Sequence[Run]]] = {
    ".json": read_recorded,
    ".npz": _read_npz,
    **by_suffix("runs"),
}
"""Per suffix, in lower case, a reader, which raises `RunError` for a file that it can't read. Readers of other packages are entry
points ``rvads.runs``, named by the suffix."""


def read_runs(path: str | Path) -> Sequence[Run]:
    """Read the runs of a file.

    A file is a table of recorded runs (``.json``), a run or a recording of this library (``.npz``), or trajectories in
    OpenSCENARIO XML (``.xosc``), which are recorded traffic at all junctions of the named map that a vehicle passes.

    A run of a recording is built when the run is indexed.

    Raises:
        RunError: the file is of another kind, or damaged.
        MapError: the map of a ``.xosc`` file can't be read.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in READERS:
        fault = f"expected a file of runs ({', '.join(READERS)}), got one ending in {suffix or 'nothing'!r}"
        raise RunError(f"{path}: {fault}; rvads import makes a recording (.npz) of a log of tracks")
    return READERS[suffix](path)


def files_of(path: Path) -> list[Path]:
    """Return the files of runs in a folder and its subfolders, sorted, without hidden files; a path of a file gives this file."""
    if not path.is_dir():
        return [path]
    run_files: list[Path] = []
    for folder, subfolders, names in os.walk(path):
        subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        files = (Path(folder, name) for name in names if not name.startswith("."))
        run_files += [file for file in files if file.suffix.lower() in READERS and file.is_file()]
    return sorted(run_files)


def matching(pattern: str, folder: Path | None = None) -> list[Path]:
    """Return the files that a pattern matches in a folder, sorted by match; a matched folder stands for its files of runs."""
    base = folder or Path()
    matches = sorted(base / name for name in glob(pattern, root_dir=folder, recursive=True))
    return [file for match in matches for file in files_of(match)]


@dataclass(frozen=True, slots=True)
class _Topology:
    junction: Junction
    entrances: Mapping[str, int]
    """Number of the entrance at a node."""
    edges: Mapping[str, Movement]
    signals: frozenset[str]
    """Ids of the signals at entrances."""

    @classmethod
    def read(cls, file: _File, where: str) -> _Topology:
        graph, nodes = file.graph, file.graph.entrances
        if any(node not in nodes for pair in (*file.right_of, *file.opposite) for node in pair):
            raise RunError(
                f"{where}: the fields 'right_of' and 'opposite' must hold pairs of the entrances {reprlib.repr(nodes)}"
            )
        numbers = _entrance_numbers(file)
        # An exit belongs to the arm of the only entrance without a movement to the exit, because there are no U-turns.
        arms = {}
        ways = {(edge.source, edge.target) for edge in graph.edges}
        for node in graph.exits:
            own = [n for n in nodes if (n, node) not in ways]
            if len(own) != 1:
                raise RunError(f"{where}: graph: exit {node!r} must be reached from all entrances but one, not from {len(own)}")
            arms[node] = numbers[own[0]]
        movements = {}
        for edge in graph.edges:
            if edge.source not in numbers or edge.target not in arms:
                raise RunError(f"{where}: graph: edge {edge.id!r} must lead from an entrance to an exit")
            movements[edge.id] = Movement(numbers[edge.source], arms[edge.target], edge.turn, edge.length, edge.id)
        signals = [s for s in graph.signals if s.node in numbers]
        kinds = {s.node: _SIGNS.get(s.kind, Sign.LIGHTS) for s in signals}
        signs = [kinds.get(node, Sign.NONE) for node in sorted(nodes, key=numbers.__getitem__)]
        pairs = frozenset((numbers[a], numbers[b]) for a, b in file.opposite)
        try:
            junction = Junction(
                graph.junction,
                graph.junction,
                *cross(signs, phase_groups=phase_groups(range(len(nodes)), pairs) if set(signs) == {Sign.LIGHTS} else ()),
                {m.key: m for m in movements.values()},
                frozenset((numbers[a], numbers[b]) for a, b in file.right_of),
                pairs,
            )
        except MapError as error:
            raise RunError(f"{where}: graph: {error}") from error
        return cls(junction, numbers, movements, frozenset(s.id for s in signals))

    def run(self, record: _Record, where: str) -> Run:
        """Return the run that a record of the file describes."""
        steps = int(record.ticks)
        agents, zones, starts = [], [], {}
        for name, vehicle in record.vehicles.items():
            typed(name, Name, f"{where}: the name of a vehicle", RunError)
            itinerary, of_vehicle = vehicle.itinerary, f"{where}: vehicle {name!r}"
            crossings = [k for k, edge in enumerate(itinerary) if edge in self.edges]
            if len(crossings) != 1:
                listed = reprlib.repr(itinerary)
                raise RunError(
                    f"{of_vehicle}: the itinerary {listed} must pass the junction once, it does {len(crossings)} times"
                )
            movement = self.edges[itinerary[crossings[0]]]
            codes = {edge: Zone.APPROACH if k < crossings[0] else Zone.EXIT for k, edge in enumerate(itinerary)}
            codes[itinerary[crossings[0]]] = Zone.JUNCTION
            zone = _expanded(vehicle.edge, steps, codes, f"{of_vehicle}: the series 'edge'")
            flags = {"": 0} | {node: 1 for node, number in self.entrances.items() if number == movement.entrance}
            waits = _expanded(vehicle.at_entrance, steps, flags, f"{of_vehicle}: the series 'at_entrance'").astype(np.bool_)
            # The entrance vertex belongs to the road: on the movement, a vehicle is in the junction, not at the entrance.
            zone[waits & (zone == Zone.APPROACH)] = Zone.ENTRANCE
            agents.append(Agent(name, movement, vehicle.kind, vehicle.size))
            zones.append(zone)
            if vehicle.init_offset is not None and vehicle.init_speed is not None:
                starts[name] = (vehicle.init_offset, vehicle.init_speed)
        lights = np.full((steps, len(self.junction.entrances)), Colour.NONE, dtype=np.int8)
        if record.lights is None and any(entrance.sign is Sign.LIGHTS for entrance in self.junction.entrances):
            raise RunError(f"{where}: the field 'lights' is missing")
        for name, light in (record.lights or {}).items():
            entrance = self.entrances.get(light.node)
            if entrance is None and name in self.signals:
                raise RunError(f"{where}: light {reprlib.repr(name)}: node {light.node!r} is not an entrance")
            colours = _expanded(light.color, steps, _COLOURS, f"{where}: light {reprlib.repr(name)}: the series 'color'")
            if entrance is not None:
                lights[:, entrance] = colours
        zone = np.column_stack(zones) if zones else np.zeros((steps, 0), dtype=np.int8)
        provenance = {"verdicts": record.verdicts or {}, "starts": starts}
        return Run(record.name, self.junction, tuple(agents), zone, lights, record.dt, provenance=provenance)


def _expanded(series: _Series[_Value], steps: int, codes: Mapping[_Value, int], where: str) -> NDArray[np.int8]:
    """Return the codes of the values of a series in every state."""
    ticks = [tick for tick, _ in series]
    if not ticks or ticks[0] != 0 or any(b <= a for a, b in pairwise(ticks)) or ticks[-1] >= steps:
        raise RunError(f"{where} must start at tick 0, increase, and stay below {steps}, got the ticks {reprlib.repr(ticks)}")
    for tick, value in series:
        if value not in codes:
            raise RunError(f"{where}: {reprlib.repr(value)} at tick {tick} is not on its itinerary {reprlib.repr([*codes])}")
    return np.repeat(np.array([codes[value] for _, value in series], dtype=np.int8), np.diff([*ticks, steps]))


def _entrance_numbers(file: _File) -> dict[str, int]:
    """Return the number of every entrance: vehicle i of a run in rotation r starts at entrance (i + r) mod n.

    If the vehicles don't determine all numbers, the relation ``right-of`` orders the entrances. If this relation is ambiguous,
    the entrances keep the order of the file.
    """
    nodes = file.graph.entrances
    starts = {edge.id: edge.source for edge in file.graph.edges if edge.source in nodes}
    numbers: dict[str, int] = {}
    for run in file.runs:
        rotation = _ROTATION.search(run.name)
        for name, vehicle in run.vehicles.items() if rotation else ():
            number_of_vehicle = _NUMBER.search(name)
            source = next((starts[e] for e in vehicle.itinerary if e in starts), None)
            if rotation and number_of_vehicle and source is not None:
                numbers.setdefault(source, (int(number_of_vehicle[1]) + int(rotation[1])) % len(nodes))
    if sorted(numbers.values()) == list(range(len(nodes))):
        return numbers
    follows = {left: right for right, left in file.right_of}
    first = next((n for n in nodes if n not in follows.values()), nodes[0] if nodes else "")
    order = [first]
    while order[-1] in follows and follows[order[-1]] not in order:
        order.append(follows[order[-1]])
    order = order if len(order) == len(nodes) else nodes
    shift = next((number - order.index(node) for node, number in numbers.items()), 0)
    return {n: (k + shift) % len(nodes) for k, n in enumerate(order)}

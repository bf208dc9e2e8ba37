"""Reads recorded traffic lights: when each signal changed its colour, and which entrances of a junction each signal controls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np

from pytest_rvads.geometry.control import ObjectKind, Sign, phase_groups
from pytest_rvads.geometry.finder import load
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.recording import Changes
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.tracks.csvfile import rows_of, wrong_cells
from pytest_rvads.satellites.tracks.source import opened
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.storage import number_in, read_xml
from pytest_rvads.support.wording import one_line

_COLOURS = {
    Colour.GREEN: ("green", "g", "1"),
    Colour.YELLOW: ("yellow", "amber", "y", "2"),
    Colour.RED: ("red", "r", "3", "u", "s"),  # SUMO: red and yellow before green; red with an arrow to the right
    Colour.NONE: ("off", "none", "unknown", "o", "0"),
}
_COLOUR = {word: colour for colour, words in _COLOURS.items() for word in words}
_MOST_CHANGES, _MOST_SIGNALS = 5_000_000, 100_000
ENTRANCE = "entrance "
"""Prefix of the name of an entrance, so that the name differs from the id of a signal."""


def read_lights(path: Path) -> dict[str, Changes]:
    """Return the changes of colour in a file, by name of the signal.

    A CSV file has the columns time [s], signal or entrance, and colour. A colour holds until a later row gives the signal another
    colour. A column ``signal`` holds ids of signals of the map, or names of entrances (``0``, ``0.1``), which are returned
    unchanged. A column ``entrance`` holds names of entrances, to which `ENTRANCE` is prefixed, as in ``entrance 0``.

    A file ending in ``.xml`` holds elements ``<tlsState>`` of SUMO, written by ``SaveTLSStates``. Link ``k`` of the traffic light
    ``C`` gets the name ``C_k``, which is the id of its signal in an OpenDRIVE file that SUMO writes.
    """
    if path.suffix.lower() == ".xml":
        return _read_sumo_lights(path)
    colours: dict[str, list[tuple[float, Colour]]] = {}
    with opened(path) as source:
        rows = rows_of(source)
        names = [name.strip().lower() for name in next(rows, (0, []))[1]]
        signal = next((name for name in ("signal", "entrance") if name in names), None)
        colour = next((name for name in ("colour", "color", "state") if name in names), None)
        if "time" not in names or signal is None or colour is None:
            column_list = one_line(", ".join(names), 200)
            raise RunError(f"{source.where}: row 1 must have the columns time, signal or entrance, and colour, got {column_list}")
        prefix = ENTRANCE if signal == "entrance" else ""
        for number, (line, cells) in enumerate(rows):
            if len(cells) != len(names):
                raise RunError(f"{source.where}: row {line}: {wrong_cells(cells, names)}")
            row = dict(zip(names, (cell.strip() for cell in cells), strict=True))
            _add_colour(colours, row["time"], prefix + row[signal], row[colour], f"{source.where}: row {line}")
            limit_lights(number, len(colours), source.where)
    if not colours:
        raise RunError(f"{path.name}: the file has only the names of columns, expected a row per change of colour")
    return changes_of(colours)


def changes_of(rows: Mapping[str, list[tuple[float, Colour]]]) -> dict[str, Changes]:
    """Return the changes of colour of each signal, given pairs of a time [s] and the colour from then on, sorted by time."""
    changes = {}
    for name, colours in rows.items():
        new_colours = [now for k, now in enumerate(colours) if k == 0 or now[1] is not colours[k - 1][1]]
        changes[name] = Changes(
            np.array([time for time, _ in new_colours]), np.array([colour for _, colour in new_colours], dtype=np.int8)
        )
    return changes


def signals_at(junction: Junction) -> dict[str, tuple[int, ...]]:
    """Return the numbers of the entrances, or other starts of ways, that each signal of a junction controls.

    The keys are ids of signals, names of entrances such as ``0.1``, names with prefix such as ``entrance 0.1``, and names of
    pedestrian lights: ``w0`` is the light of crosswalk 0, which controls the starts of its two crossings, see `Junction.walked`.
    """
    labels = {junction.vehicle_at(number).removeprefix("a"): (number,) for number in range(len(junction.entrances))}
    named = {f"{ENTRANCE}{label}": numbers for label, numbers in labels.items()}
    first = len(junction.entrances)
    lit = (number for number, crosswalk in enumerate(junction.crossings) if crosswalk.phase is not None)
    walks = {f"w{number}": (first + 2 * number, first + 2 * number + 1) for number in lit}
    return {**labels, **named, **walks, **signal_ids(junction)}


def signal_ids(junction: Junction) -> dict[str, tuple[int, ...]]:
    """Return the numbers of the entrances that each traffic light controls, by id of the light; empty without a map."""
    entrances: dict[str, tuple[int, ...]] = {}
    if junction.map_file is not None:
        report = load(junction.map_file).report(junction.id)
        for item in report.objects:
            numbers = tuple(number for number, end in enumerate(report.entrances) if end.edge == item.edge)
            if item.kind is ObjectKind.LIGHT:
                entrances[item.id] = tuple(sorted({*entrances.get(item.id, ()), *numbers}))
    return entrances


def lights_at(junction: Junction, recorded_lights: Mapping[str, Changes]) -> dict[int, Changes]:
    """Return the changes of colour at each entrance of a junction and each walked crossing; NONE while its signals differ."""
    signals = signals_at(junction)
    by_entrance: dict[int, list[Changes]] = {}
    for name, changes in recorded_lights.items():
        for entrance in (number for number in signals.get(name, ()) if number < len(junction.starts)):
            by_entrance.setdefault(entrance, []).append(changes)
    common: dict[int, Changes] = {}
    for entrance, lights in sorted(by_entrance.items()):
        common[entrance] = lights[0]
        if len(lights) > 1:
            times = np.unique(np.concatenate([light.times for light in lights]))
            with_none = [np.concatenate(([Colour.NONE], light.colours)) for light in lights]
            places = [np.searchsorted(light.times, times, side="right") for light in lights]
            colours = np.stack([known[place] for known, place in zip(with_none, places, strict=True)])
            equal = (colours == colours[0]).all(axis=0)
            common[entrance] = Changes(times, np.where(equal, colours[0], Colour.NONE).astype(np.int8))
    return common


def with_lights(junction: Junction, recorded_lights: Mapping[str, Changes]) -> Junction:
    """Return the junction with a light at each entrance that has a recorded light, also where the map shows no light.

    Entrances that face each other, or are on one arm, are taken to have green together. The colours at each time are recorded.
    """
    lit = [k for k in lights_at(junction, recorded_lights) if k < len(junction.entrances)]
    if all(junction.entrances[k].sign is Sign.LIGHTS for k in lit):
        return junction
    lit = sorted({*lit, *(k for k, lane in enumerate(junction.entrances) if lane.sign is Sign.LIGHTS)})
    opposite = frozenset((lit.index(a), lit.index(b)) for a, b in junction.opposite if {a, b} <= {*lit})
    groups = phase_groups([junction.entrances[k].arm for k in lit], opposite)
    phases = {lit[k]: phase for phase, group in enumerate(groups) for k in group}
    lanes = enumerate(junction.entrances)
    lights = (replace(lane, sign=Sign.LIGHTS, phase=phases[k], sign_setback=None) if k in phases else lane for k, lane in lanes)
    return replace(junction, entrances=tuple(lights))


def _add_colour(colours_by_signal: dict[str, list[tuple[float, Colour]]], time: str, name: str, colour: str, where: str) -> None:
    seconds = number_in(time)
    if not abs(seconds) <= 1e12:
        raise RunError(f"{where}, column time: {time!r:.60} is no time in seconds")
    if colour.lower() not in _COLOUR:
        colours = ", ".join(words[0] for words in _COLOURS.values())
        raise RunError(f"{where}, column colour: {colour!r:.60} is no colour, expected {colours}, their first letters, or SUMO's")
    earlier_colours = colours_by_signal.setdefault(name, [])
    if earlier_colours and seconds <= earlier_colours[-1][0]:
        raise RunError(
            f"{where}, column time: {seconds:g} s is too early for {name!r:.60}, expected more than {earlier_colours[-1][0]:g} s"
        )
    earlier_colours.append((seconds, _COLOUR[colour.lower()]))


def limit_lights(changes: int, signals: int, where: str) -> None:
    """Check that a file has no more changes of colour and signals than fit in memory."""
    if changes >= _MOST_CHANGES or signals > _MOST_SIGNALS:
        raise RunError(
            f"{where}: the file has more than {_MOST_CHANGES:,} changes of colour, or more than {_MOST_SIGNALS:,} signals: "
            "leave out rows that repeat a colour"
        )


def _read_sumo_lights(path: Path) -> dict[str, Changes]:
    colours: dict[str, list[tuple[float, Colour]]] = {}
    last: dict[str, str] = {}
    numbers = count()

    def start(tag: str, attributes: dict[str, str], row: int) -> None:
        if tag != "tlsState":
            return
        name, state = attributes.get("id", ""), attributes.get("state", "")
        before = last.get(name, "")
        for link, letter in enumerate(state):
            if letter != before[link : link + 1]:
                _add_colour(colours, attributes.get("time", ""), f"{name}_{link}", letter, f"{path.name}: row {row}")
                limit_lights(next(numbers), len(colours), path.name)
        last[name] = state

    with opened(path) as source:
        read_xml(source.chunks(), "light states of SUMO", start)
    if not colours:
        raise RunError(f"{path.name}: <tlsState> is missing, expected light states of SUMO, written by SaveTLSStates")
    return changes_of(colours)

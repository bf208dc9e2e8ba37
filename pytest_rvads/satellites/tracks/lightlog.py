"""Recorded lights: the changes of colour of each signal, and the entrances of a junction that each signal controls."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import count
from pathlib import Path

import numpy as np

from pytest_rvads.geometry.builtin import LAYOUTS, path_of
from pytest_rvads.geometry.control import ObjectKind
from pytest_rvads.geometry.finder import load
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.recording import Changes
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.tracks.csvfile import rows_of, wrong_cells
from pytest_rvads.satellites.tracks.source import opened
from pytest_rvads.support.boundedxml import read_xml
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import one_line

__all__ = ["ENTRANCE", "changes_of", "lights_at", "limit_lights", "read_lights", "signal_ids", "signals_at"]

_COLOURS = {
    Colour.GREEN: ("green", "g", "1"),
    Colour.YELLOW: ("yellow", "amber", "y", "2"),
    Colour.RED: ("red", "r", "3", "u", "s"),  # SUMO: red and yellow before green; red with an arrow to the right
    Colour.NONE: ("off", "none", "unknown", "o", "0"),
}
_COLOUR = {word: colour for colour, words in _COLOURS.items() for word in words}
_MOST_CHANGES, _MOST_SIGNALS = 5_000_000, 100_000
ENTRANCE = "entrance "
"""Prefix that distinguishes the name of an entrance from an equal id of a signal."""


def read_lights(path: Path) -> dict[str, Changes]:
    """Return the changes of colour in a file, by name of the signal.

    A CSV file has the columns time [s], signal or entrance, and colour. A colour holds until the next row of the same signal. A
    column ``signal`` has ids of signals of the map; a name without a signal on the map is the name of an entrance (``0``,
    ``0.1``). A column ``entrance`` has names of entrances, and the returned name is ``entrance 0``.

    A file ending in ``.xml`` has ``<tlsState>`` of SUMO, written by ``SaveTLSStates``. Link ``k`` of light ``C`` has the name
    ``C_k``, which is the id of the signal when SUMO writes OpenDRIVE.

    Raises:
        RunError: the file can't be read; the message names row and column.
    """
    return _read_sumo_lights(path) if path.suffix.lower() == ".xml" else _read_csv_lights(path)


def changes_of(rows: Mapping[str, list[tuple[float, Colour]]]) -> dict[str, Changes]:
    """Return the changes of colour of each signal, given the times [s] and colours that the signal showed, in order of time."""
    changes = {}
    for name, shown in rows.items():
        new_colours = [now for k, now in enumerate(shown) if k == 0 or now[1] is not shown[k - 1][1]]
        changes[name] = Changes(
            np.array([time for time, _ in new_colours]), np.array([colour for _, colour in new_colours], dtype=np.int8)
        )
    return changes


def signals_at(junction: Junction) -> dict[str, tuple[int, ...]]:
    """Return the entrances that each signal of a junction controls, by id of the signal and by name of the entrance."""
    labels = {junction.vehicle_at(number).removeprefix("a"): (number,) for number in range(len(junction.entrances))}
    named = {f"{ENTRANCE}{label}": numbers for label, numbers in labels.items()}
    return {**labels, **named, **signal_ids(junction)}


def signal_ids(junction: Junction) -> dict[str, tuple[int, ...]]:
    """Return the entrances that each light of the map controls, by id of the light; empty for a junction without a map."""
    entrances: dict[str, tuple[int, ...]] = {}
    map = junction.map or (path_of(junction.name) if junction.name in LAYOUTS else None)
    if map is not None:
        report = load(map).report(junction.id)
        for item in report.objects:
            numbers = tuple(number for number, end in enumerate(report.entrances) if end.edge == item.edge)
            if item.kind is ObjectKind.LIGHT:
                entrances[item.id] = tuple(sorted({*entrances.get(item.id, ()), *numbers}))
    return entrances


def lights_at(junction: Junction, shown: Mapping[str, Changes]) -> dict[int, Changes]:
    """Return the changes of colour at a junction by entrance; signals of other junctions are left out.

    An entrance may have several signals, such as a signal per arrow. While the signals differ, the colour is unknown.
    """
    signals = signals_at(junction)
    by_entrance: dict[int, list[Changes]] = {}
    for name, changes in shown.items():
        for entrance in signals.get(name, ()):
            by_entrance.setdefault(entrance, []).append(changes)
    return {entrance: _common_colour(lights) for entrance, lights in sorted(by_entrance.items())}


def _common_colour(lights: list[Changes]) -> Changes:
    if len(lights) == 1:
        return lights[0]
    times = np.unique(np.concatenate([light.times for light in lights]))
    with_none = [np.concatenate(([Colour.NONE], light.colours)) for light in lights]
    colours = np.stack([k[np.searchsorted(light.times, times, side="right")] for k, light in zip(with_none, lights, strict=True)])
    return Changes(times, np.where((colours == colours[0]).all(axis=0), colours[0], Colour.NONE).astype(np.int8))


def _read_csv_lights(path: Path) -> dict[str, Changes]:
    shown: dict[str, list[tuple[float, Colour]]] = {}
    with opened(path) as source:
        rows = rows_of(source)
        names = [name.strip().lower() for name in next(rows, (0, []))[1]]
        signal = next((name for name in ("signal", "entrance") if name in names), None)
        colour = next((name for name in ("colour", "color", "state") if name in names), None)
        if "time" not in names or signal is None or colour is None:
            listed = one_line(", ".join(names), 200)
            raise RunError(f"{source.where}: row 1 must have the columns time, signal or entrance, and colour, got {listed}")
        prefix = ENTRANCE if signal == "entrance" else ""
        for number, (line, cells) in enumerate(rows):
            if len(cells) != len(names):
                raise RunError(f"{source.where}: row {line}: {wrong_cells(cells, names)}")
            row = dict(zip(names, (cell.strip() for cell in cells), strict=True))
            _add_colour(shown, row["time"], prefix + row[signal], row[colour], f"{source.where}: row {line}")
            limit_lights(number, len(shown), source.where)
    if not shown:
        raise RunError(f"{path.name}: the file has only the names of columns, expected a row per change of colour")
    return changes_of(shown)


def _add_colour(shown: dict[str, list[tuple[float, Colour]]], time: str, name: str, colour: str, where: str) -> None:
    """Add the colour of a signal from a time on.

    Raises:
        RunError: the time is no number or not later than the last time of the signal, or the colour is not known.
    """
    try:
        seconds = float(time)
    except ValueError:
        seconds = math.nan
    if not abs(seconds) <= 1e12:
        raise RunError(f"{where}, column time: {time!r:.60} is no time in seconds")
    if colour.lower() not in _COLOUR:
        colours = ", ".join(words[0] for words in _COLOURS.values())
        raise RunError(f"{where}, column colour: {colour!r:.60} is no colour, expected {colours}, their first letters, or SUMO's")
    before = shown.setdefault(name, [])
    if before and seconds <= before[-1][0]:
        raise RunError(
            f"{where}, column time: {seconds:g} s is too early for {name!r:.60}, expected more than {before[-1][0]:g} s"
        )
    before.append((seconds, _COLOUR[colour.lower()]))


def limit_lights(changes: int, signals: int, where: str) -> None:
    """Check that a file has no more changes of colour and signals than fit in memory.

    Raises:
        RunError: the file has more.
    """
    if changes >= _MOST_CHANGES or signals > _MOST_SIGNALS:
        raise RunError(
            f"{where}: the file has more than {_MOST_CHANGES:,} changes of colour, or more than {_MOST_SIGNALS:,} signals: "
            "leave out rows that repeat a colour"
        )


def _read_sumo_lights(path: Path) -> dict[str, Changes]:
    shown: dict[str, list[tuple[float, Colour]]] = {}
    last: dict[str, str] = {}
    numbers = count()

    def start(tag: str, attributes: dict[str, str], row: int) -> None:
        if tag != "tlsState":
            return
        name, state = attributes.get("id", ""), attributes.get("state", "")
        before = last.get(name, "")
        for link, letter in enumerate(state):
            if letter != before[link : link + 1]:
                _add_colour(shown, attributes.get("time", ""), f"{name}_{link}", letter, f"{path.name}: row {row}")
                limit_lights(next(numbers), len(shown), path.name)
        last[name] = state

    with opened(path) as source:
        read_xml(source.chunks(), "light states of SUMO", start)
    if not shown:
        raise RunError(f"{path.name}: <tlsState> is missing, expected light states of SUMO, written by SaveTLSStates")
    return changes_of(shown)

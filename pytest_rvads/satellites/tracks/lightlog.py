"""Recorded lights: which colour which signal showed from when on, and which entrances of a junction the signals are for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import count
from pathlib import Path

import numpy as np

from pytest_rvads.boundedxml import read_xml
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.builtin import LAYOUTS, path_of
from pytest_rvads.junctions.finder import load
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.control import ObjectKind
from pytest_rvads.runs.recording import Changes
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.tracks.csvfile import rows_of, wrong_cells
from pytest_rvads.satellites.tracks.source import opened
from pytest_rvads.wording import one_line

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
"""Begins the names of entrances, which may be the ids of signals, too."""


def read_lights(path: Path) -> dict[str, Changes]:
    """Return the colours of signals by what a file calls them: ids of the map, or entrances as in ids (``0``, ``0.1``).

    A CSV file has the columns time [s], signal or entrance, and colour; a colour holds until the next row of that signal. In a
    column of signals an entrance counts where no signal of the map is called so; one of entrances gives ``entrance 0``. A file
    ending in ``.xml`` holds ``<tlsState>`` of SUMO (``SaveTLSStates``); its link ``k`` of light ``C`` is called ``C_k``, as SUMO
    calls the signal when it writes OpenDRIVE.

    Raises:
        RunError: it can't be read; the message names row and column.
    """
    return _sumo(path) if path.suffix.lower() == ".xml" else _table(path)


def changes_of(rows: Mapping[str, list[tuple[float, Colour]]]) -> dict[str, Changes]:
    """Return what was shown, in order of time, as changes."""
    found = {}
    for name, shown in rows.items():
        kept = [now for k, now in enumerate(shown) if k == 0 or now[1] is not shown[k - 1][1]]
        found[name] = Changes(np.array([time for time, _ in kept]), np.array([colour for _, colour in kept], dtype=np.int8))
    return found


def signals_at(junction: Junction) -> dict[str, tuple[int, ...]]:
    """Return the entrances that each signal is for: by its id in the map, and entrances by what they are called."""
    labels = {junction.vehicle_at(number).removeprefix("a"): (number,) for number in range(len(junction.entrances))}
    named = {f"{ENTRANCE}{label}": numbers for label, numbers in labels.items()}
    return {**labels, **named, **signal_ids(junction)}


def signal_ids(junction: Junction) -> dict[str, tuple[int, ...]]:
    """Return the entrances that each light of the map is for, by its id there; nothing where there is no map."""
    found: dict[str, tuple[int, ...]] = {}
    map = junction.map or (path_of(junction.name) if junction.name in LAYOUTS else None)
    if map is not None:
        report = load(map).report(junction.id)
        for item in report.objects:
            at = tuple(number for number, end in enumerate(report.entrances) if end.edge == item.edge)
            if item.kind is ObjectKind.LIGHT:
                found[item.id] = tuple(sorted({*found.get(item.id, ()), *at}))
    return found


def lights_at(junction: Junction, shown: Mapping[str, Changes]) -> dict[int, Changes]:
    """Return the lights of a junction by entrance; signals of other junctions are left out.

    Several signals of an entrance, such as a signal per arrow, count while all show one colour; otherwise the colour is unknown.
    """
    signals = signals_at(junction)
    mine: dict[int, list[Changes]] = {}
    for name, changes in shown.items():
        for entrance in signals.get(name, ()):
            mine.setdefault(entrance, []).append(changes)
    return {entrance: _agreed(lights) for entrance, lights in sorted(mine.items())}


def _agreed(lights: list[Changes]) -> Changes:
    if len(lights) == 1:
        return lights[0]
    times = np.unique(np.concatenate([light.times for light in lights]))
    known = [np.concatenate(([Colour.NONE], light.colours)) for light in lights]
    each = np.stack([k[np.searchsorted(light.times, times, side="right")] for k, light in zip(known, lights, strict=True)])
    return Changes(times, np.where((each == each[0]).all(axis=0), each[0], Colour.NONE).astype(np.int8))


def _table(path: Path) -> dict[str, Changes]:
    shown: dict[str, list[tuple[float, Colour]]] = {}
    with opened(path) as source:
        rows = rows_of(source)
        names = [name.strip().lower() for name in next(rows, (0, []))[1]]
        signal = next((name for name in ("signal", "entrance") if name in names), None)
        colour = next((name for name in ("colour", "color", "state") if name in names), None)
        if "time" not in names or signal is None or colour is None:
            listed = one_line(", ".join(names), 200)
            raise RunError(f"{source.where}: row 1 must name the columns time, signal or entrance, and colour, got {listed}")
        before = ENTRANCE if signal == "entrance" else ""
        for number, (line, cells) in enumerate(rows):
            if len(cells) != len(names):
                raise RunError(f"{source.where}: row {line}: {wrong_cells(cells, names)}")
            row = dict(zip(names, (cell.strip() for cell in cells), strict=True))
            _show(shown, row["time"], before + row[signal], row[colour], f"{source.where}: row {line}")
            limit_lights(number, len(shown), source.where)
    if not shown:
        raise RunError(f"{path.name}: it has no row but the names of its columns, expected a row per change of colour")
    return changes_of(shown)


def _show(shown: dict[str, list[tuple[float, Colour]]], time: str, name: str, colour: str, where: str) -> None:
    """Add what a signal shows from a time on."""
    try:
        at = float(time)
    except ValueError:
        at = math.nan
    if not abs(at) <= 1e12:
        raise RunError(f"{where}, column time: {time!r:.60} is no time in seconds")
    if colour.lower() not in _COLOUR:
        known = ", ".join(words[0] for words in _COLOURS.values())
        raise RunError(f"{where}, column colour: {colour!r:.60} is no colour, expected {known}, their first letters, or SUMO's")
    before = shown.setdefault(name, [])
    if before and at <= before[-1][0]:
        raise RunError(
            f"{where}, column time: {name!r:.60} had a colour at {before[-1][0]:g} s, expected a later time than {at:g} s"
        )
    before.append((at, _COLOUR[colour.lower()]))


def limit_lights(changes: int, signals: int, where: str) -> None:
    """Raise a `RunError` where a file has more changes of colour, or more signals, than are kept in memory."""
    if changes >= _MOST_CHANGES or signals > _MOST_SIGNALS:
        raise RunError(
            f"{where}: it has more than {_MOST_CHANGES:,} changes of colour, or more than {_MOST_SIGNALS:,} signals: "
            "leave out what changes nothing"
        )


def _sumo(path: Path) -> dict[str, Changes]:
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
                _show(shown, attributes.get("time", ""), f"{name}_{link}", letter, f"{path.name}: row {row}")
                limit_lights(next(numbers), len(shown), path.name)
        last[name] = state

    with opened(path) as source:
        read_xml(source.chunks(), "what SUMO writes as SaveTLSStates", start)
    if not shown:
        raise RunError(f"{path.name}: it has no <tlsState>, expected what SUMO writes as SaveTLSStates")
    return changes_of(shown)

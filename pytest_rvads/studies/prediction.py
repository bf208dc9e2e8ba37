"""Predicting recorded runs: the same LGSVL-like autopilot at a junction built from a recording's graph."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.errors import MapError, RvadsError, ScenarioError
from pytest_rvads.junctions.junction import JunctionControl
from pytest_rvads.maps.segment import Turn
from pytest_rvads.runs.run import Run
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.studies.experiment import outcome
from pytest_rvads.studies.site import Lengths, build_junction

__all__ = ["answer", "predict", "site_lengths"]

RULES = {JunctionControl.STOP: ("p1", "p2", "p3"), JunctionControl.LIGHTS: ("p4", "p5", "p6")}
DURATION = {JunctionControl.STOP: 30.0, JunctionControl.LIGHTS: 40.0}
"""Longest run, as in the paper's tables [s]."""
LONGEST = 500.0
"""Longest movement that is believed [m]."""
DEFAULT_WAIT = 1.5
"""Value of every random draw where a request names none [s]."""


def answer(line: str) -> str:
    """Answer a request, a JSON object in one line, with another one; see ``rvads simulate --jsonl``."""
    id = None
    try:
        try:
            request = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise ScenarioError(f"a request must be a JSON object in one line, got {line[:60]!r}: {error}") from error
        if not isinstance(request, dict):
            raise ScenarioError(f"a request must be a JSON object, got {type(request).__name__}")
        try:
            id = json.loads(json.dumps(request.get("id"), allow_nan=False))
        except ValueError as error:
            raise ScenarioError(f"the id of a request must be a JSON value, which infinity and NaN are not: {error}") from error
        run, rotation = predict(request)
        control = run.junction.control
        entry = {f"c{(a.entrance - rotation) % run.junction.ways}": run.entry(k) for k, a in enumerate(run.agents)}
        found: dict[str, Any] = {
            "id": id,
            "verdicts": outcome(run, RULES[control]),
            "entry": {name: None if entry[name] is None else round(float(entry[name] or 0.0), 6) for name in sorted(entry)},
            "hash": run.hash,
        }
    except RvadsError as error:
        found = {"id": id, "error": " ".join(str(error).split())}
    except Exception as error:  # whatever is wrong with this request, the next one is to be answered
        found = {"id": id, "error": f"this request could not be simulated: {type(error).__name__}: {error}"}
    return json.dumps(found)


def predict(request: Mapping[str, Any]) -> tuple[Run, int]:
    """Simulate what a request describes.

    Returns:
        The run, and the rotation of the request.

    Raises:
        RvadsError: a field is missing or has a value that does not fit; the message names it.
    """
    autopilot = traffic(_field(request, "autopilot", str, "lgsvl"), "autopilot")
    word = _field(request, "control", str)
    if word not in (JunctionControl.STOP, JunctionControl.LIGHTS):
        raise ScenarioError(f"control must be 'stop' or 'lights', got {word!r}")
    control = JunctionControl(word)
    order = _field(request, "order", list)
    place = build_junction("site", control, site_lengths(_field(request, "graph", dict), order), len(order))
    rotation = _field(request, "rotation", int, 0)
    wait = request.get("wait")
    scenario = Scenario(
        place,
        _field(request, "directions", str),
        distance=_numbers(request, "distances"),
        speed=_numbers(request, "speeds"),
        rotation=rotation,
        duration=DURATION[control],
        wait=DEFAULT_WAIT if wait is None else _number("wait", wait),
    )
    return simulate(Case(scenario, autopilot)), rotation


def site_lengths(graph: Mapping[str, Any], order: Sequence[str]) -> Lengths:
    """Return turn and length of the movements of a recorded graph, by entrance and exit.

    Args:
        graph: with ``entrances``, ``exits`` and ``edges``.
        order: the entrances counter-clockwise.

    Raises:
        MapError: the graph is no junction with a movement from every entrance to every other arm.
    """
    try:
        edges = [(str(e["source"]), str(e["target"]), Turn(e["turn"]), _number("length", e["length"])) for e in graph["edges"]]
        exits = [str(node) for node in graph["exits"]]
        entrances = [str(node) for node in graph["entrances"]]
    except (KeyError, TypeError, ValueError) as error:
        raise MapError(f"the graph needs entrances, exits and edges with source, target, turn and length: {error!r}") from error
    ways = len(order)
    if ways not in (3, 4) or sorted(map(str, order)) != sorted(entrances):
        raise MapError(f"order must name the 3 or 4 entrances {sorted(entrances)} of the graph, got {list(order)!r}")
    if len(set(exits)) != ways:
        raise MapError(f"the graph must have as many exits as entrances, {ways}, got {exits}")
    if not all(0.0 < length <= LONGEST for *_, length in edges):
        raise MapError(f"every edge of the graph needs a positive length of at most {LONGEST:g} m")
    # Of its own arm an entrance reaches everything but the exit.
    number: dict[str, int] = {}
    for arm, entrance in enumerate(map(str, order)):
        reached = {target for source, target, *_ in edges if source == entrance}
        own = [node for node in exits if node not in reached]
        if len(own) != 1:
            raise MapError(f"entrance {entrance} must lead to every exit but that of its own arm, it does not lead to {own}")
        number[own[0]] = arm
    if len(number) != ways:
        raise MapError(f"every arm needs an exit of its own, got {len(number)} for {ways} arms")
    places = {str(entrance): arm for arm, entrance in enumerate(order)}
    lengths: dict[tuple[int, int], tuple[Turn, float]] = {}
    for source, target, turn, length in edges:
        if source in places and target in number:
            found = lengths.setdefault((places[source], number[target]), (turn, length))
            if found != (turn, length):
                raise MapError(f"the graph has two different edges from {source} to {target}, expected one")
    return lengths


def _field(request: Mapping[str, Any], name: str, kind: type, default: Any = None) -> Any:
    value = request.get(name, default)
    if value is None:
        value = default
    if not isinstance(value, kind) or isinstance(value, bool):
        raise ScenarioError(f"the field {name!r} of a request must be of type {kind.__name__}, got {value!r}")
    return value


def _numbers(request: Mapping[str, Any], name: str) -> list[float]:
    return [_number(name, value) for value in _field(request, name, list)]


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ScenarioError(f"the field {name!r} of a request must hold numbers, got {value!r}")
    try:
        return float(value)
    except OverflowError:
        raise ScenarioError(f"the field {name!r} of a request holds a number too large to compute with") from None

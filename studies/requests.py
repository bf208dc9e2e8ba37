"""Predicting recorded runs: the same LGSVL-like autopilot at a junction built from a recording's graph."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from msgspec import Struct

from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.readers import Edge
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.paper.tables import outcome
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import Simulator, simulate
from pytest_rvads.support.decoding import typed
from pytest_rvads.support.errors import MapError, RvadsError, ScenarioError
from studies.site import Lengths, build_junction

RULES = {JunctionControl.STOP: ("p1", "p2", "p3"), JunctionControl.LIGHTS: ("p4", "p5", "p6")}
DURATION = {JunctionControl.STOP: 30.0, JunctionControl.LIGHTS: 40.0}
"""Longest run, as in the paper's tables [s]."""
LONGEST = 500.0
"""Longest movement that is believed [m]."""
DEFAULT_WAIT = 1.5
"""Value of every random draw where a request names none [s]."""


class Graph(Struct, frozen=True):
    """What a request says of a recorded junction."""

    entrances: list[str]
    exits: list[str]
    edges: list[Edge]


class _Request(Struct, frozen=True):
    graph: Graph
    order: list[str]
    control: Literal["stop", "lights"]
    directions: str
    distances: list[float]
    speeds: list[float]
    rotation: int | None = None
    autopilot: str | None = None
    wait: float | None = None


def answer(line: str, simulator: Simulator | None = None) -> str:
    """Answer a request, a JSON object in one line, with another one, see ``rvads simulate --jsonl``."""
    id = None
    try:
        try:
            request = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise ScenarioError(f"a request must be a JSON object in one line, got {line[:60]!r}: {error}") from error
        typed(request, dict, "request", ScenarioError)
        try:
            id = json.loads(json.dumps(request.get("id"), allow_nan=False))
        except ValueError as error:
            raise ScenarioError(f"the id of a request must be a JSON value, which infinity and NaN are not: {error}") from error
        run, rotation = predict(request, simulator)
        control = run.junction.control
        entry = {f"c{(a.entrance - rotation) % len(run.junction.entrances)}": run.entry(k) for k, a in enumerate(run.agents)}
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


def predict(request: Mapping[str, Any], simulator: Simulator | None = None) -> tuple[Run, int]:
    """Simulate what a request describes, by what `simulate` takes for `simulator`."""
    asked = typed(request, _Request, "request", ScenarioError)
    autopilot = traffic(asked.autopilot or "lgsvl", "autopilot")
    control = JunctionControl(asked.control)
    place = build_junction("site", control, site_lengths(asked.graph, asked.order), len(asked.order))
    rotation = asked.rotation or 0
    scenario = Scenario(
        place,
        asked.directions,
        distance=asked.distances,
        speed=asked.speeds,
        rotation=rotation,
        duration=DURATION[control],
        wait=DEFAULT_WAIT if asked.wait is None else asked.wait,
    )
    return simulate(Case(scenario, autopilot), simulator), rotation


def site_lengths(graph: Graph, order: Sequence[str]) -> Lengths:
    """Return turn and length of the movements of a recorded graph, by entrance and exit."""
    ways = len(order)
    if ways not in (3, 4) or sorted(order) != sorted(graph.entrances):
        raise MapError(f"order must name the 3 or 4 entrances {sorted(graph.entrances)} of the graph, got {list(order)!r}")
    if len(set(graph.exits)) != ways:
        raise MapError(f"the graph must have as many exits as entrances, {ways}, got {graph.exits}")
    if not all(0.0 < edge.length <= LONGEST for edge in graph.edges):
        raise MapError(f"every edge of the graph needs a positive length of at most {LONGEST:g} m")
    places = {entrance: arm for arm, entrance in enumerate(order)}
    arms = _arms(graph, order)
    lengths: dict[tuple[int, int], tuple[Turn, float]] = {}
    for edge in graph.edges:
        if edge.source in places and edge.target in arms:
            found = lengths.setdefault((places[edge.source], arms[edge.target]), (edge.turn, edge.length))
            if found != (edge.turn, edge.length):
                raise MapError(f"the graph has two different edges from {edge.source} to {edge.target}, expected one")
    return lengths


def _arms(graph: Graph, order: Sequence[str]) -> dict[str, int]:
    """Return the arm of every exit: of its own arm an entrance reaches everything but the exit."""
    arms: dict[str, int] = {}
    for arm, entrance in enumerate(order):
        reached = {edge.target for edge in graph.edges if edge.source == entrance}
        own = [node for node in graph.exits if node not in reached]
        if len(own) != 1:
            raise MapError(f"entrance {entrance} must lead to every exit but that of its own arm, it does not lead to {own}")
        arms[own[0]] = arm
    if len(arms) != len(order):
        raise MapError(f"every arm needs an exit of its own, got {len(arms)} for {len(order)} arms")
    return arms

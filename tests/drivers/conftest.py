"""What a run must fulfil, worked out apart from the logic package.

The paper's rules p1..p6 are evaluated on finished runs by definition: no automata, no formulas of the package.
"""

from collections.abc import Callable
from itertools import permutations

import numpy as np
import pytest

from pytest_rvads.geometry.turns import Turn
from pytest_rvads.logic.conduct.standing import wt
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Colour, Zone

Complain = Callable[[Run], list[str]]
Judge = Callable[[Run], dict[str, str]]


def _until(trigger: np.ndarray, wait: np.ndarray, go: np.ndarray, strict: bool) -> str:
    """Status of G(trigger -> (X? wait) U go): strict means that `wait` must still hold in the step in which `go` comes."""
    status = "NA"
    steps = len(trigger)
    for start in np.flatnonzero(trigger):
        status = "PASS" if status == "NA" else status
        k = int(start)
        while True:
            if go[k]:
                break
            if not strict and not wait[k]:
                return "FAIL"
            k += 1
            if k == steps:
                return "OPEN"
            if strict and not wait[k]:
                return "FAIL"
    return status


def _worst(statuses: list[str]) -> str:
    return next((s for s in ("FAIL", "OPEN", "PASS") if s in statuses), "NA")


def judge(run: Run) -> dict[str, str]:
    """Status of every rule that is about this kind of junction."""
    zone, waits = run.zone, wt(run)
    at = zone == Zone.ENTRANCE
    inside = zone == Zone.JUNCTION
    agents = range(len(run.agents))
    entrance = [a.entrance for a in run.agents]
    turn = [a.turn for a in run.agents]
    found: dict[str, list[str]] = {}
    if run.junction.control == "stop":
        found["p1"] = ["FAIL" if (inside.sum(axis=1) > 1).any() else "PASS" if inside.any() else "NA"]
        found["p2"], found["p3"] = [], []
        for a, b in permutations(agents, 2):
            if (entrance[a], entrance[b]) in run.junction.right_of:
                found["p2"].append(_until(at[:, a] & at[:, b] & (waits[:, a] == waits[:, b]), at[:, b], inside[:, a], True))
            found["p3"].append(_until(at[:, a] & at[:, b] & (waits[:, a] < waits[:, b]), at[:, a], inside[:, b], True))
    else:
        red = [run.lights[:, e] == Colour.RED for e in entrance]
        green = [run.lights[:, e] == Colour.GREEN for e in entrance]
        found = {"p4": [], "p5": [], "p6": []}
        for a in agents:
            if turn[a] is not Turn.RIGHT:
                found["p4"].append(_until(at[:, a] & red[a], at[:, a], green[a], False))
        for a, b in permutations(agents, 2):
            if turn[a] is Turn.RIGHT and (entrance[a], entrance[b]) in run.junction.right_of:
                found["p5"].append(_until(at[:, a] & at[:, b] & red[a], at[:, a], inside[:, b], True))
            if turn[a] is Turn.LEFT and turn[b] is not Turn.LEFT and (entrance[a], entrance[b]) in run.junction.opposite:
                found["p6"].append(_until(at[:, a] & at[:, b], at[:, a], inside[:, b], True))
    return {rule: _worst(statuses) for rule, statuses in found.items()}


def complaints(run: Run) -> list[str]:
    """What the reference autopilot did wrong in a run; p2 is excused where four arrive in the same tick."""
    status = judge(run)
    found = [f"{rule} {s}" for rule, s in status.items() if s in ("FAIL", "OPEN")]
    arrival = np.where((run.zone >= Zone.ENTRANCE).any(axis=0), (run.zone >= Zone.ENTRANCE).argmax(axis=0), -1)
    if len(run.agents) == 4 and len(set(np.maximum(arrival, 1))) == 1 and status.get("p2") == "FAIL":
        found.remove("p2 FAIL")
    if run.fault:
        found.append(run.fault.reason)
    if run.collisions:
        found.append(f"collision {run.collisions}")
    if run.provenance["end"] != "left":
        found.append(f"not everybody left: {run.provenance['end']}")
    # Approach to the line: harder than 3.4 m/s^2 is no comfortable stop (people, at stop signs).
    braking = -np.where(run.zone[:-1] <= Zone.ENTRANCE, np.diff(run.speed, axis=0), 0.0).min() / DT
    if braking > 3.4:
        found.append(f"braked with {braking:.2f} m/s^2")
    return found


@pytest.fixture(scope="session")
def verdicts() -> Judge:
    """Judge a run by definition."""
    return judge


@pytest.fixture(scope="session")
def wrongs() -> Complain:
    """List what a reference vehicle must not do."""
    return complaints

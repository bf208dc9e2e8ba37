"""The paper's rules p1..p6 on finished runs, evaluated by definition: no automata, no formulas of the package."""

from itertools import permutations

import numpy as np

from pytest_rvads.maps.segment import Turn
from pytest_rvads.semantics.run import Run
from pytest_rvads.semantics.states import Colour, Zone


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
                return "OPEN" if status != "FAIL" else status
            if strict and not wait[k]:
                return "FAIL"
    return status


def _worst(statuses: list[str]) -> str:
    return next((s for s in ("FAIL", "OPEN", "PASS") if s in statuses), "NA")


def verdicts(run: Run) -> dict[str, str]:
    """Status of every rule that is about this kind of junction."""
    zone, wt = run.zone, run.wt
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
                found["p2"].append(_until(at[:, a] & at[:, b] & (wt[:, a] == wt[:, b]), at[:, b], inside[:, a], True))
            found["p3"].append(_until(at[:, a] & at[:, b] & (wt[:, a] < wt[:, b]), at[:, a], inside[:, b], True))
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

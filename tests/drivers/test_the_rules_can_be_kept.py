"""The reference autopilot keeps every rule wherever anybody can: at every seat, beside empty entrances, among all traffic.

Nobody can where the rules of an all-way stop make vehicles wait for each other in a circle. Who waits for whom follows from the
ticks of the arrivals alone, whatever the vehicles do.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import permutations, product
from typing import Any

import networkx as nx
import numpy as np
import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.standing import TIE
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import PAPER, configuration
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate

from ..policies import EVERYWHERE

JUNCTIONS = ("stop4", "light4", "stop3", "light3")
DRIVERS: dict[str, Callable[[], Any]] = {"paper": Reference, "road": partial(Reference, tie=TIE)}
"""The paper's rules count every tick, those of the road half a second."""
TRAFFIC = (*EVERYWHERE, "nobody")


def scenarios(junction: str, policy: str) -> Iterator[Scenario]:
    """Yield every occupancy and direction, with every seat; the configurations of the paper in turn.

    Turned around, a scenario is the same but for the phase of the lights, so in an X two seats stand for four.
    """
    place = find(junction)
    ways, lights = place.ways, place.control is JunctionControl.LIGHTS
    letters = PAPER[place.control]
    seats: tuple[int | None, ...] = tuple(range(ways if ways == 3 else 1 + lights))
    codes = [code for code in product(range(ways), repeat=ways) if any(code)]
    if policy == "nobody":
        seats = (None,)
    for k, (seat, code) in enumerate(product(seats, codes)):
        if seat is None or code[seat]:
            letter = letters[k % len(letters)]
            point = configuration(letter, ways)
            yield Scenario(
                find(junction),
                code,
                distance=point.distances,
                speed=point.speeds,
                configuration=letter,
                rotation=(k // len(letters)) % 2 if lights and seat is None else 0,
                subject=seat,
            )


def contradicting(junction: str, keys: Sequence[tuple[int, int]], ticks: Sequence[int], book: str) -> set[str]:
    """Return the rules that vehicles on these movements, at their entrances from these ticks on, can't keep together."""
    place = find(junction)
    if place.control is not JunctionControl.STOP:
        return set()
    assert place.conflicts is not None
    right, first, tie = ("right_first", "first_come", TIE / DT) if book == "road" else ("p2", "p3", 0)
    waits: dict[str, list[tuple[int, int]]] = {right: [], first: []}
    for one, other in permutations(range(len(keys)), 2):
        if book == "road" and (keys[one], keys[other]) not in place.conflicts:
            continue
        if abs(ticks[one] - ticks[other]) <= tie:
            if (keys[other][0], keys[one][0]) in place.right_of:
                waits[right].append((one, other))
        elif ticks[other] < ticks[one]:
            waits[first].append((one, other))
    for rules in ({right}, {right, first}):
        if not nx.is_directed_acyclic_graph(nx.DiGraph([pair for rule in rules for pair in waits[rule]])):
            return rules
    return set()


def lost(run: Run, junction: str, book: str) -> dict[str, str]:
    """Return what is wrong: a rule that is not kept although it could be, or is said not to be keepable although it is."""
    there = run.zone >= Zone.ENTRANCE
    ticks = np.where(there.any(axis=0), there.argmax(axis=0), run.steps)
    impossible = contradicting(junction, [agent.way.key for agent in run.agents], ticks.tolist(), book)
    wrong, excused, provoked = {}, set(), set()
    for rule in rules_for(book, run.junction.control):
        verdict = check(run, rule)
        if verdict.provoked:
            provoked.add(rule.name)
        elif verdict.unavoidable:
            excused.add(rule.name)
        elif verdict.status not in ("PASS", "NA"):
            wrong[rule.name] = verdict.message
    if not excused <= impossible:
        wrong["circle"] = f"can be kept: {', '.join(sorted(excused - impossible))}"
    if impossible and not impossible & (excused | provoked):
        wrong["circle"] = f"can't be kept together: {', '.join(sorted(impossible))}"
    return wrong


def judge(cases: list[Scenario], junction: str, policy: str, book: str) -> dict[str, dict[str, str]]:
    found = {}
    for case in cases:
        run = simulate(Case(case, DRIVERS[book], traffic=None if case.subject is None else traffic(policy)))
        assert run.fault is None, run.fault
        found[run.label] = lost(run, junction, book)
    return {label: wrong for label, wrong in found.items() if wrong}


# The traffic takes turns, so that each kind meets each book with stop signs and with lights, in an X and in a T; `slow` has all.
@pytest.mark.extended
@pytest.mark.parametrize(
    ("junction", "book", "first"), [(j, b, (n // 2 + k) % 2) for n, j in enumerate(JUNCTIONS) for k, b in enumerate(DRIVERS)]
)
def test_a_sample_of_every_traffic(junction: str, book: str, first: int) -> None:
    for k, policy in list(enumerate(TRAFFIC))[first::2]:
        cases = list(scenarios(junction, policy))
        assert judge([cases[(37 * k + 5) % len(cases)]], junction, policy, book) == {}, policy


@pytest.mark.extended
@pytest.mark.parametrize("book", DRIVERS)
def test_four_that_arrive_at_once(book: str) -> None:
    """What nobody can keep occurs, and is told as unavoidable: each way crosses the one from the right."""
    case = Scenario(find("stop4"), "2222", distance=20)
    assert judge([case], "stop4", "nobody", book) == {}
    name = {"paper": "p2", "road": "right_first"}[book]
    assert contradicting("stop4", ((0, 2), (1, 3), (2, 0), (3, 1)), (500,) * 4, book) == {name}
    assert check(simulate(Case(case, DRIVERS[book])), name).unavoidable


@pytest.mark.slow
@pytest.mark.parametrize("book", DRIVERS)
@pytest.mark.parametrize("policy", TRAFFIC)
@pytest.mark.parametrize("junction", JUNCTIONS)
def test_every_class_seat_and_occupancy(junction: str, policy: str, book: str) -> None:
    assert judge(list(scenarios(junction, policy)), junction, policy, book) == {}

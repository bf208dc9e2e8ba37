"""Speed of the logic: run with ``pytest benchmarks/bench_logic.py``; the marks fail when they are missed."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.static_model import extract
from pytest_rvads.logic.judging.instances import forget, ground
from pytest_rvads.logic.ltl.ltl3 import Monitor, encode, run_machine, synthesize
from pytest_rvads.logic.ltl.parser import parse_ltl
from pytest_rvads.logic.rules.book import rulebook
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Colour, Zone

TEMPLATES = {
    "p1": "G !c",
    "yield": "G((w & a & t) -> ((X w) U g))",
    "hold": "G((w & r) -> (w U g))",
    "hold, temporal take": "G((w & r & !(w U k)) -> (w U g))",
    "p5, temporal take": "G((w & a & r & (w U k)) -> ((X w) U g))",
    "p6, temporal take": "G((w & a & (w U k) & !(a U l)) -> ((X w) U g))",
}
STEPS = 3000


def made(junction: str) -> Run:
    """Four vehicles, one after the other, 3,000 ticks."""
    place = find(junction)
    agents, zones = [], []
    for e in range(4):
        agents.append(Agent(f"a{e}", place.movements[e, place.leads(e, 3 - e % 3).exit]))
        ticks = [0, 300 + 10 * e, 500 + 600 * e, 900 + 600 * e, STEPS]
        zones.append(
            np.concatenate([np.full(b - a, z) for (a, b), z in zip(pairwise(ticks), Zone, strict=False)]).astype(np.int8)
        )
    lights = np.zeros((STEPS, 4), dtype=np.int8)
    if place.phase_groups:
        lights[:], lights[:, ::2] = Colour.RED, Colour.GREEN
        lights[1500:, ::2], lights[2000:, 1::2] = Colour.RED, Colour.GREEN
    return Run("bench", place, tuple(agents), np.column_stack(zones), lights)


@pytest.mark.parametrize("name", TEMPLATES)
def test_template(benchmark: Any, name: str) -> None:
    """Building the monitor of a shipped template: at most 20 ms."""
    formula = parse_ltl(TEMPLATES[name])
    benchmark(lambda: synthesize.__wrapped__(formula))
    assert benchmark.stats.stats.median < 0.020


def test_six_rules(benchmark: Any) -> None:
    """All six rules of the paper on four vehicles and 3,000 ticks, the monitors built before: at most 10 ms."""
    runs = {"stop": made("stop4"), "lights": made("light4")}
    rules = rulebook("paper")

    def judge() -> list[str]:
        for run in runs.values():
            run.__dict__.pop("wt", None)
        return [str(check(runs[str(r.about)], r).status) for r in rules]

    assert "NA" not in benchmark(judge)[:1]
    assert benchmark.stats.stats.median < 0.010


def test_six_rules_cold(benchmark: Any) -> None:
    """The same for a scenario seen for the first time: instances and monitors are built as well."""
    runs = {"stop": made("stop4"), "lights": made("light4")}
    rules = rulebook("paper")

    def judge() -> None:
        forget()
        synthesize.cache_clear()
        for r in rules:
            check(runs[str(r.about)], r)

    benchmark(judge)


def test_grounding_p5(benchmark: Any) -> None:
    """1,024 instances of p5 come down to the few that are left."""
    run = made("light4")
    static, formula = extract(run), rulebook("paper")[4].formula
    grounding = benchmark(lambda: ground(formula, static))
    assert grounding.collapsed + len(grounding.instances) == 4**5


LONG = 100_000


@pytest.fixture(scope="module", params=[1, 100], ids=["changing in every state", "changing every 100 states"])
def trace(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    bits = np.repeat(np.random.default_rng(1).random((3, LONG // request.param)) < 0.5, request.param, axis=1)
    return {"p": bits[0], "q": bits[1], "r": bits[0] | bits[2]}


FORMULA = "G((p & q) -> (p U r))"


def test_table_walk(benchmark: Any, trace: dict[str, np.ndarray]) -> None:
    """All 100,000 states at once."""
    machine = synthesize(parse_ltl(FORMULA))
    values = {a: trace[a.name] for a in machine.atoms}
    benchmark(lambda: run_machine(machine, encode(machine, values, LONG)[None, :]))


def test_steps(benchmark: Any, trace: dict[str, np.ndarray]) -> None:
    """The same state by state."""
    machine = synthesize(parse_ltl(FORMULA))
    states = [frozenset(n for n in "pqr" if trace[n][k]) for k in range(LONG)]

    def walk() -> None:
        monitor = Monitor(machine)
        for state in states:
            monitor.step(state)

    benchmark.pedantic(walk, rounds=3)


def test_rtamt(benchmark: Any, trace: dict[str, np.ndarray]) -> None:
    """rtamt's offline evaluator on the same formula and trace, where it is installed: the walk is at least 10 times faster."""
    rtamt = pytest.importorskip("rtamt")
    spec = rtamt.StlDiscreteTimeSpecification()
    for name in "pqr":
        spec.declare_var(name, "float")
    spec.spec = "always(((p > 0) and (q > 0)) implies ((p > 0) until (r > 0)))"
    spec.parse()
    data: dict[str, list[float]] = {"time": list(range(LONG))}
    data |= {name: np.where(trace[name], 1.0, -1.0).tolist() for name in "pqr"}
    benchmark.pedantic(lambda: spec.evaluate(data), rounds=1)
    machine = synthesize(parse_ltl(FORMULA))
    values = {a: trace[a.name] for a in machine.atoms}
    from timeit import repeat

    ours = min(repeat(lambda: run_machine(machine, encode(machine, values, LONG)[None, :]), number=1, repeat=5))
    assert benchmark.stats.stats.min > 10 * ours

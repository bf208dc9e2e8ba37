"""Checks that a run depends on its case alone: not on what ran before, nor on the process."""

from __future__ import annotations

import base64
import json
import pickle
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from pytest_rvads import __version__
from pytest_rvads.conformance.bench import Bench, crowd
from pytest_rvads.conformance.probes import Brakes
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.choice import limits
from pytest_rvads.simulators.simulator import Simulator, made_by, named, simulate, simulators
from pytest_rvads.support.wording import one_line

__all__ = ["another_process", "answer", "provenance", "repeatable"]

_CUT = 12
"""Characters of a hash that tell runs apart."""


def repeatable(bench: Bench) -> Iterator[str]:
    """The same case gives the same run, bit for bit: a second time, after other cases, in another order.

    Whatever is random is drawn from what the case holds; results are kept and compared by `Run.hash`.
    """
    cases = _cases(bench)
    before = [bench.run(case).hash for case in cases]
    for case, one in zip(cases, before, strict=True):
        if (two := bench.run(case).hash) != one:
            yield (
                f"{case.scenario.name}: its hash is {one[:_CUT]} and then {two[:_CUT]}, expected the same: build every run from "
                "its case alone"
            )
            return
    for place in bench.junctions:
        bench.run(crowd(place, Brakes, duration=0.1))
    again = [bench.run(case).hash for case in reversed(cases)][::-1]
    for case, one, two in zip(cases, before, again, strict=True):
        if one != two:
            yield f"{case.scenario.name}: its hash is {one[:_CUT]}, after other cases {two[:_CUT]}: leave nothing of a run behind"


def _cases(bench: Bench) -> list[Case]:
    places = (bench.junctions[0], bench.junctions[-1])
    return [crowd(place, driver, speed=3.0, duration=4.0) for place in places for driver in bench.drivers]


def another_process(bench: Bench) -> Iterator[str]:
    """The same case gives the same run in another process: workers, machines and whoever repeats a failure have to agree.

    The other process finds the simulator by ``--rvads-simulator=module:name``, by its name if it ships, or pickled.
    """
    cases = _cases(bench)
    try:
        pickled = base64.b64encode(pickle.dumps((bench.where or _shipped(bench.simulator), cases))).decode()
    except Exception as error:
        yield (
            f"the simulator or a driver can't be sent to another process, {one_line(repr(error), 120)}: "
            "name it by --rvads-simulator=module:name, and take drivers that can be imported"
        )
        return
    here = [bench.run(case).hash for case in cases]
    asked = json.dumps({"path": sys.path, "pickled": pickled, "longest": bench.longest})
    longest = bench.longest * len(cases)
    program = [sys.executable, "-c", _PROGRAM.format(str(Path(__file__).parents[2]))]
    try:
        done = subprocess.run(program, input=asked, capture_output=True, text=True, check=False, timeout=longest)
    except subprocess.TimeoutExpired:
        yield f"another process has not answered within {longest:g} s of real time: see whether the simulator waits for something"
        return
    try:
        there = json.loads(done.stdout.rpartition(_MARK)[2])
    except ValueError:
        told = one_line(done.stderr.strip().rpartition("\n")[2], 200) or "it told nothing"
        yield (
            f"another process ended with status {done.returncode} and without its runs, {told}: it must find simulator and "
            "drivers"
        )
        return
    for case, one, two in zip(cases, here, there, strict=True):
        if one != two:
            yield f"{case.scenario.name}: its hash is {one[:_CUT]}, in another process {two[:_CUT]}: depend on the case alone"


_PROGRAM = "import sys; sys.path.insert(0, {!r}); from pytest_rvads.conformance.repetition import answer; answer()"
_MARK = "rvads hashes of runs:"


def answer() -> None:
    """Print the hashes of the runs that standard input asks for: what the other process does."""
    asked = json.load(sys.stdin)
    sys.path[:] = asked["path"]
    simulator, cases = pickle.loads(base64.b64decode(asked["pickled"]))
    maker = named(simulator) if isinstance(simulator, str) else simulator
    with limits(decision=asked["longest"], run=asked["longest"]):
        hashes = [simulate(case, maker).hash for case in cases]
    sys.stdout.write(f"{_MARK}{json.dumps(hashes)}\n")


def _shipped(simulator: Simulator) -> Simulator | str:
    """Return the name of a simulator that comes with the package, others as they are."""
    name = simulator.name
    return name if name in simulators() and named(name) is simulator else simulator


def provenance(bench: Bench) -> Iterator[str]:
    """`Run.provenance` says in builtins where a run comes from: scenario, simulator, its versions, and why it ended.

    Nobody who judges reads it; reports and those who repeat a run do.
    """
    case = bench.alone(Brakes, duration=0.1)
    run = bench.run(case)
    said = dict(run.provenance)
    try:
        json.dumps(said, allow_nan=False)
    except (TypeError, ValueError) as error:
        yield f"{run.label}: its provenance can't be written as JSON, {error}: take numbers, texts, lists and mappings"
    wanted = {"simulator": made_by(bench.simulator, run), "scenario": case.scenario.record()}
    for name, value in wanted.items():
        if said.get(name) != value:
            yield (
                f"{run.label}: its provenance has {name} {one_line(repr(said.get(name)), 80)}, expected "
                f"{one_line(repr(value), 80)}"
            )
    versions = said.get("versions")
    if not (isinstance(versions, Mapping) and versions.get("pytest-rvads") == __version__):
        got = one_line(repr(versions), 80)
        yield (
            f"{run.label}: its provenance has versions {got}, expected {{'pytest-rvads': {__version__!r}, ...}} with all that "
            "decides "
            "what it does: pytest_rvads.support.versions.versions(...) tells them"
        )

"""Every check of a simulator as a test. The simulator is that of the session, `--rvads-simulator`.

A simulator that can't pass a check says so in an attribute ``unsupported``, a reason by the name of the check: the test is then
expected to fail, and fails if the check passes. An attribute ``drivers`` names the drivers that a simulator has of its own.
"""

from __future__ import annotations

import pytest

from pytest_rvads.conformance.bench import JUNCTIONS, Bench, NotTried
from pytest_rvads.conformance.checks import CHECKS, demand, faults, unsupported
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.session.options import Options
from pytest_rvads.simulators.simulator import Simulator, meant


@pytest.fixture(scope="module")
def bench(pytestconfig: pytest.Config) -> Bench:
    """Return the bench on which the checks share their runs."""
    simulator: Simulator = meant()
    name = Options.read(pytestconfig).simulator
    drivers = (Reference, *getattr(simulator, "drivers", ()))
    return Bench(simulator, drivers, tuple(map(find, JUNCTIONS)), name if name and ":" in name else None)


@pytest.mark.parametrize("check", CHECKS)
def test_simulator(check: str, bench: Bench, request: pytest.FixtureRequest) -> None:
    """The simulator passes the check."""
    if reason := unsupported(bench.simulator).get(check):
        request.applymarker(pytest.mark.xfail(reason=reason, strict=True))
    try:
        wrong = faults(check, bench)
    except NotTried as untried:
        pytest.skip(str(untried))
    if wrong:
        pytest.fail("\n  ".join((demand(check), *wrong)), pytrace=False)

"""The conformance checks of a simulator by name, each as a test of the simulator that the option `--rvads-simulator` names.

A simulator can have an attribute ``unsupported``: for the name of each check that the simulator can't pass, a reason. The test
of such a check is expected to fail (a strict xfail). An attribute ``drivers`` holds further drivers for the checks.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from types import MappingProxyType
from typing import Any

import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.satellites.conformance import contract, in_motion
from pytest_rvads.satellites.conformance.bench import JUNCTIONS, Bench, Broken, Look, NotTried
from pytest_rvads.session.options import Options, choice_of
from pytest_rvads.simulators.simulator import Simulator
from pytest_rvads.support.errors import ScenarioError, require, suggest
from pytest_rvads.support.wording import one_line

_MOST = 3
"""Largest number of sentences that a failed check prints."""
CHECKS: Mapping[str, tuple[Look, bool]] = MappingProxyType(
    {
        "name": (contract.has_a_name, True),
        "vmax": (contract.envelope_is_a_curve, True),
        "starts": (contract.start_places, True),
        "refusals": (contract.impossible_cases, True),
        "clock": (in_motion.clock, True),
        "ends": (in_motion.ends, True),
        "integrity": (in_motion.integrity, True),
        "zones": (in_motion.zones_follow_stations, True),
        "speeds": (in_motion.speeds_are_progress, True),
        "poses": (in_motion.headings_and_places, True),
        "bodies": (in_motion.bodies_of_the_fleet, False),
        "lights": (in_motion.lights, False),
        "seen": (contract.what_drivers_see, False),
        "subject": (contract.subject_and_traffic, False),
        "faults": (contract.faults, True),
        "hanging": (contract.hanging, False),
        "route": (contract.leaving_the_route, False),
        "braking": (contract.brakes_by_its_envelope, False),
        "gone": (in_motion.gone_for_good, False),
        "crossing": (in_motion.crossing, False),
        "running_into": (in_motion.running_into, False),
        "passing": (in_motion.passing, False),
        "pedestrians": (in_motion.pedestrians, False),
        "repeatable": (contract.repeatable, True),
        "another_process": (contract.another_process, False),
        "provenance": (contract.provenance, True),
    }
)
"""Per name of a check, the function of the check, and whether every simulator has to pass the check."""


@pytest.fixture(scope="module")
def bench(pytestconfig: pytest.Config) -> Bench:
    """Return the bench: the simulator, with the drivers and junctions of the checks. The checks share its runs."""
    choice = choice_of(pytestconfig)
    simulator = choice.simulator
    name = Options.read(pytestconfig).simulator
    drivers = (Reference, *getattr(simulator, "drivers", ()))
    return Bench(simulator, drivers, tuple(map(find, JUNCTIONS)), name if name and ":" in name else None, dump=choice.limits.dump)


@pytest.mark.parametrize("check", CHECKS)
def test_simulator(check: str, bench: Bench, request: pytest.FixtureRequest) -> None:
    """The simulator of the session passes the check."""
    if reason := unsupported(bench.simulator).get(check):
        request.applymarker(pytest.mark.xfail(reason=reason, strict=True))
    try:
        wrong = faults(check, bench)
    except NotTried as untried:
        pytest.skip(str(untried))
    if wrong:
        pytest.fail("\n  ".join((demand(check), *wrong)), pytrace=False)


def demand(name: str) -> str:
    """Return the requirement that a check tests, in a sentence."""
    return (CHECKS[name][0].__doc__ or "").partition("\n")[0]


def faults(name: str, bench: Bench) -> tuple[str, ...]:
    """Run a check, and return the errors of the simulator as at most three sentences; an empty tuple if the check passes.

    NotTried is raised if no junction of the bench has what the check needs.
    """
    try:
        return tuple(islice(CHECKS[name][0](bench), _MOST))
    except NotTried:
        raise
    except Broken as broken:
        return (str(broken),)
    except Exception as error:
        return (f"the simulator raised {type(error).__name__}: {one_line(str(error), 400)}",)


def unsupported(simulator: Simulator) -> Mapping[str, str]:
    """Return the reasons by name of check in a simulator's attribute ``unsupported``: the checks that the simulator can't pass.

    Raises:
        ScenarioError: the attribute is no mapping, names an unknown check or a check that every simulator has to pass, or lacks
            a reason.
    """
    reasons: Any = getattr(simulator, "unsupported", {})
    require(reasons, Mapping, "unsupported takes reasons by the name of a check, such as {'lights': 'has none'}", ScenarioError)
    for name, reason in reasons.items():
        if name not in CHECKS:
            raise ScenarioError(f"unsupported names {name!r}, the checks are {', '.join(CHECKS)}{suggest(str(name), CHECKS)}")
        if CHECKS[name][1]:
            optional = ", ".join(other for other, (_, needed) in CHECKS.items() if not needed)
            raise ScenarioError(f"unsupported names {name!r}, which no simulator can do without; it may do without {optional}")
        if not (isinstance(reason, str) and reason.strip()):
            raise ScenarioError(f"unsupported needs a reason for {name!r}, a sentence for whoever reads it, got {reason!r:.60}")
    return dict(reasons)

"""The checks of a simulator by name, and what each of them finds."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from types import MappingProxyType
from typing import Any

from pytest_rvads.conformance import at_start, events, in_motion, repetition, with_drivers
from pytest_rvads.conformance.bench import Bench, Broken, Look, NotTried
from pytest_rvads.simulators.simulator import Simulator
from pytest_rvads.support.errors import ScenarioError, require, suggest
from pytest_rvads.support.wording import one_line

__all__ = ["CHECKS", "demand", "faults", "unsupported"]

_MOST = 3
"""Sentences that a failed check prints."""
CHECKS: Mapping[str, tuple[Look, bool]] = MappingProxyType(
    {
        "name": (at_start.has_a_name, True),
        "vmax": (at_start.envelope_is_a_curve, True),
        "starts": (at_start.start_places, True),
        "refusals": (at_start.impossible_cases, True),
        "clock": (in_motion.clock, True),
        "ends": (in_motion.ends, True),
        "integrity": (in_motion.integrity, True),
        "zones": (in_motion.zones_follow_stations, True),
        "speeds": (in_motion.speeds_are_progress, True),
        "poses": (in_motion.headings_and_places, True),
        "bodies": (in_motion.bodies_of_the_fleet, False),
        "lights": (in_motion.lights, False),
        "seen": (with_drivers.what_drivers_see, False),
        "subject": (with_drivers.subject_and_traffic, False),
        "faults": (with_drivers.faults, True),
        "hanging": (with_drivers.hanging, False),
        "route": (with_drivers.leaving_the_route, False),
        "braking": (with_drivers.brakes_by_its_envelope, False),
        "gone": (events.gone_for_good, False),
        "crossing": (events.crossing, False),
        "running_into": (events.running_into, False),
        "passing": (events.passing, False),
        "repeatable": (repetition.repeatable, True),
        "another_process": (repetition.another_process, False),
        "provenance": (repetition.provenance, True),
    }
)
"""What each check does, and whether every simulator has to pass the check."""


def demand(name: str) -> str:
    """Return what the check of that name demands of every simulator, in a sentence."""
    return (CHECKS[name][0].__doc__ or "").partition("\n")[0]


def faults(name: str, bench: Bench) -> tuple[str, ...]:
    """Run a check, and return what is wrong with the simulator, in at most three sentences; an empty tuple if nothing is.

    Args:
        name: of the check.
        bench: holds the simulator.

    Raises:
        NotTried: no junction of the bench has what the check needs.
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
    """Return the checks that a simulator says it can't pass, its attribute ``unsupported``, with a reason for each.

    Raises:
        ScenarioError: the attribute is no mapping, names no check or a check that no simulator can do without, or has no reason.
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

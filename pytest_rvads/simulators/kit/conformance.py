"""The conformance of a simulator: which checks there are, what each found, and all of it as a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice
from numbers import Real
from types import MappingProxyType
from typing import Any
from unittest import SkipTest

from pytest_rvads.drivers.abilities import check_factory
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.errors import ScenarioError, require, suggest
from pytest_rvads.junctions.finder import find
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.simulators.kit import at_start, events, in_motion, repetition, with_drivers
from pytest_rvads.simulators.kit.bench import Bench, Broken, Look, NotTried
from pytest_rvads.simulators.simulator import Simulator
from pytest_rvads.wording import one_line

__all__ = ["Check", "Conformance", "Outcome", "Result", "checks", "conformance"]

_JUNCTIONS = ("stop4", "stop3", "light4", "yield4", "lanes4")
_MOST = 3
"""Sentences that a check is told in."""
_LOOKS: Mapping[str, tuple[Look, bool]] = MappingProxyType(
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
"""What each check does, and whether every simulator has to pass it."""


class Outcome(StrEnum):
    """What came of a check."""

    PASSED = "passed"
    FAILED = "failed"
    UNSUPPORTED = "not supported"
    """The simulator is said not to do that, and does not."""
    UNTRIED = "not tried"
    """No junction that was given has what the check needs."""


@dataclass(frozen=True, slots=True)
class Result:
    """What a check found."""

    name: str
    demand: str
    """What every simulator has to do, in a sentence."""
    outcome: Outcome
    told: tuple[str, ...] = ()
    """Of a check that failed the faults, a sentence each; of one that is not supported or was not tried why."""


@dataclass(frozen=True, slots=True)
class Check:
    """One check of a simulator. It is called as a test, or asked for its result."""

    name: str
    bench: Bench
    unsupported: str | None = None
    """Why the simulator does not do what is checked, where it does not."""

    @property
    def demand(self) -> str:
        """What every simulator has to do, in a sentence."""
        return _sentence(_LOOKS[self.name][0])

    def result(self) -> Result:
        """Look, and return what was found."""
        try:
            told = tuple(islice(_LOOKS[self.name][0](self.bench), _MOST))
        except NotTried as untried:
            return Result(self.name, self.demand, Outcome.UNTRIED, (str(untried),))
        except Broken as broken:
            told = (str(broken),)
        except Exception as error:
            told = (f"the simulator raised {type(error).__name__}: {one_line(str(error), 400)}",)
        if self.unsupported is None:
            return Result(self.name, self.demand, Outcome.FAILED if told else Outcome.PASSED, told)
        if told:
            return Result(self.name, self.demand, Outcome.UNSUPPORTED, (self.unsupported,))
        wrong = f"it is said not to be supported, {self.unsupported!r}, and is: take it out of unsupported="
        return Result(self.name, self.demand, Outcome.FAILED, (wrong,))

    def __call__(self) -> None:
        """Look, as a test does.

        Raises:
            AssertionError: something is wrong.
            unittest.SkipTest: it is not supported, or could not be tried; pytest skips the test.
        """
        result = self.result()
        if result.outcome is Outcome.FAILED:
            raise AssertionError(_lines(result))
        if result.outcome is not Outcome.PASSED:
            raise SkipTest(f"{result.outcome}: {' '.join(result.told)}")

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Conformance:
    """What all checks of a simulator found; printed, it is a table."""

    simulator: str
    """Its name."""
    results: tuple[Result, ...]

    @property
    def failures(self) -> tuple[Result, ...]:
        """The checks that failed."""
        return tuple(result for result in self.results if result.outcome is Outcome.FAILED)

    def check(self) -> None:
        """Raise where a check failed.

        Raises:
            AssertionError: names all that failed, with what they found.
        """
        if self.failures:
            raise AssertionError("\n".join((self._head(), *map(_lines, self.failures))))

    def _head(self) -> str:
        counts = [(outcome, sum(result.outcome is outcome for result in self.results)) for outcome in Outcome]
        return f"simulator {self.simulator}: {', '.join(f'{count} {outcome}' for outcome, count in counts if count)}"

    def __str__(self) -> str:
        rows = [self._head()]
        for result in self.results:
            rows.append(f"{result.outcome:<14} {result.name:<16} {result.demand}")
            rows += [f"{'':14} {'':16} {sentence}" for sentence in result.told]
        return "\n".join(rows)


def checks(
    simulator: Simulator,
    *,
    drivers: Sequence[Factory] = (Reference,),
    junctions: Sequence[str | Junction] = _JUNCTIONS,
    unsupported: Mapping[str, str] = MappingProxyType({}),
    where: str | None = None,
    longest: float = 60.0,
) -> tuple[Check, ...]:
    """Return the checks that a simulator has to pass, to be run one by one: as items of a parametrized test, say.

    Args:
        simulator: what is checked.
        drivers: what drives where any driver will do: in starts, zones, speeds, poses, ends, repetitions. Give those that the
            simulator has of its own, too. Where vehicles have to do something in particular, drivers of the kit drive.
        junctions: where, each a junction or the name of a built-in one; the first is the one that most is tried at.
        unsupported: by the name of a check why the simulator does not do what it demands. The check is run all the same; one
            that passes is a failure, so that nothing stays here for longer than it is true.
        where: how another process finds the simulator, ``module:name``; not needed by what ships or can be pickled.
        longest: real time that one run may take [s].

    Raises:
        ScenarioError: no simulator, junction or driver, a check that is not there, or one that no simulator can do without.
        MapError: no such junction.
        AutopilotError: a driver that can't be called.
    """
    if simulator is None:  # which elsewhere means the usual one
        raise ScenarioError("the checks are those of a simulator: write checks(rvads.bullet), got None")
    require(where, str | None, "where= takes the simulator as module:name", ScenarioError)
    require(
        unsupported, Mapping, "unsupported= takes reasons by the name of a check, such as {'lights': 'has none'}", ScenarioError
    )
    places = [find(junction) if isinstance(junction, str) else junction for junction in _several("junctions", junctions)]
    for place in places:
        require(place, Junction, "junctions= takes junctions and names of built-in ones", ScenarioError)
    tried = _several("drivers", drivers)
    for driver in tried:
        check_factory(driver)
    for name, reason in unsupported.items():
        _check_unsupported(name, reason)
    if isinstance(longest, bool) or not isinstance(longest, Real) or not 0.0 < longest < math.inf:
        raise ScenarioError(f"longest= takes a number of seconds above 0, got {longest!r:.60}")
    bench = Bench(simulator, tuple(tried), tuple(places), where, longest)
    return tuple(Check(name, bench, unsupported.get(name)) for name in _LOOKS)


def conformance(
    simulator: Simulator,
    *,
    drivers: Sequence[Factory] = (Reference,),
    junctions: Sequence[str | Junction] = _JUNCTIONS,
    unsupported: Mapping[str, str] = MappingProxyType({}),
    where: str | None = None,
    longest: float = 60.0,
) -> Conformance:
    """Run all checks of a simulator: its runs have to be such that verdicts mean what they say.

    Args:
        simulator: what is checked.
        drivers: as for `checks`; likewise the others.
        junctions: where.
        unsupported: what it does not do, and why.
        where: how another process finds it.
        longest: real time that one run may take [s].

    Returns:
        What every check found. Print it, or call its `check`, which raises where one failed.

    Raises:
        ScenarioError: as for `checks`; likewise MapError and AutopilotError.
    """
    made = checks(simulator, drivers=drivers, junctions=junctions, unsupported=unsupported, where=where, longest=longest)
    name = getattr(simulator, "name", None) or repr(simulator)
    return Conformance(one_line(str(name), 80), tuple(check.result() for check in made))


def _several(name: str, values: Any) -> list[Any]:
    if isinstance(values, str) or not isinstance(values, Sequence) or not values:
        raise ScenarioError(f"{name}= takes a list of at least one, got {values!r:.60}")
    return list(values)


def _check_unsupported(name: str, reason: str) -> None:
    if name not in _LOOKS:
        raise ScenarioError(f"unsupported= names {name!r}, the checks are {', '.join(_LOOKS)}{suggest(str(name), _LOOKS)}")
    if _LOOKS[name][1]:
        free = ", ".join(other for other, (_, needed) in _LOOKS.items() if not needed)
        raise ScenarioError(f"unsupported= names {name!r}, which no simulator can do without; it may do without {free}")
    if not (isinstance(reason, str) and reason.strip()):
        raise ScenarioError(
            f"unsupported= needs a reason for {name!r}, a sentence for those who read the table, got {reason!r:.60}"
        )


def _sentence(look: Look) -> str:
    return (look.__doc__ or "").partition("\n")[0]


def _lines(result: Result) -> str:
    return "\n".join((f"{result.name}: {result.demand}", *(f"  {sentence}" for sentence in result.told)))

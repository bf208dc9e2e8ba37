"""``@rvads.falsify``: a test that searches for a failing scenario; its arguments are checked when the test is defined."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Unpack

from pytest_rvads.drivers.abilities import check_factory
from pytest_rvads.logic.rules.book import claim, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.scenarios.case import Fleet
from pytest_rvads.search.counterexample import violation
from pytest_rvads.search.falsify import Search
from pytest_rvads.session.collection.misuse import caller, told_at
from pytest_rvads.session.options import OPTIONS
from pytest_rvads.simulators.simulator import usable
from pytest_rvads.support.errors import RvadsError, ScenarioError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pytest_rvads.drivers.interface import Factory
    from pytest_rvads.geometry.junction import Junction
    from pytest_rvads.search.space import Space

__all__ = ["falsify"]


def falsify(  # noqa: PLR0913 - keywords; a search has many settings
    junction: str | Junction,
    *,
    rule: str | Rule,
    autopilot: Factory | None = None,
    traffic: str | Factory | None = None,
    budget: int = 200,
    seed: int = 0,
    searches: int = 1,
    executor: Executor | int | None = None,
    **space: Unpack[Space],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a test that searches for a scenario in which a rule is violated, and that fails with the simplest such scenario.

    The body of the test runs after the search, and only if the search found no violation; its arguments are fixtures. Hypothesis
    stores the scenario in its example database and tries it first in the next session. If no run of the search required an action
    by the rule, the test is an error.

    Args:
        junction: a junction, a built-in name, or the id of a junction in ``map``.
        rule: the rule to violate.
        autopilot: the system under test; by default the driver of an option, else of the fixture ``rvads_autopilot``.
        traffic: with ``subject``, the driver of the other vehicles: a policy by name, or an autopilot of yours; the reference by
            default.
        budget: greatest number of simulations before a counterexample, and again for its simplification.
        seed: seed of the search.
        searches: number of parallel searches, with the seeds from `seed` on and equal parts of the budget; the test reports the
            counterexample of the search with the lowest seed.
        executor: executor of several searches, as for `campaign`; driver and traffic must be picklable.
        space: the scenarios to search, see `strategies.scenarios`: ``map``, ``subject``, ``partial``, ``near``, ``far``,
            ``pace``, ``wait``, ``aggression``, ``duration``.

    Raises:
        RvadsError: an argument is wrong, or a class is decorated; pytest shows the message with the line and without a traceback.

    Example:
        >>> @falsify("stop4", rule="p1", budget=50)
        ... def test_nobody_meets_in_the_junction(): ...
    """
    place = caller()
    with told_at(place):
        search = Search.of(junction, rule, traffic, budget, seed, space)
        search.parts(searches)
        if isinstance(rule, Rule):  # a name is looked up when the test runs, and registered rules are noted
            claim(*rules_for(rule))
        if autopilot is not None:
            check_factory(autopilot)

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        with told_at(place):
            if not inspect.isfunction(test):
                raise ScenarioError(f"@rvads.falsify makes a test of a function or method, got {test!r}: write it there")
            if inspect.iscoroutinefunction(test) or inspect.isasyncgenfunction(test) or inspect.isgeneratorfunction(test):
                raise ScenarioError(
                    f"@rvads.falsify calls the body of a test, got {test.__qualname__}, whose body a call would not run: write "
                    "it as a plain def without yield"
                )
        signature = inspect.signature(test)
        needed = ["pytestconfig", "rvads_vehicle", "rvads_simulator"]
        if autopilot is None:
            needed += ["rvads_sut", "rvads_autopilot"]

        @functools.wraps(test)
        def wrapper(*instance: Any, **fixtures: Any) -> None:
            __tracebackhide__ = True
            tested = (autopilot, fixtures.get("rvads_sut"), fixtures.get("rvads_autopilot"))
            driver: Any = next((driver for driver in tested if driver is not None), None)
            name = f"{test.__module__}.{test.__qualname__}"
            try:
                check_factory(driver)
                simulator = usable(fixtures["rvads_simulator"])
                limit = fixtures["pytestconfig"].stash[OPTIONS].speed_limit
                limited = replace(search, place=search.place.limited(limit)) if limit else search
                counterexample = limited.begin(driver, Fleet(fixtures["rvads_vehicle"]), simulator, name, searches, executor)
            except RvadsError as error:
                # An error class of a user may have another constructor, so the error itself gets the place in its message.
                error.args = (f"{place}: {error}",)
                raise error.with_traceback(None) from None
            if counterexample is not None:
                raise violation(counterexample)
            test(*instance, **{key: value for key, value in fixtures.items() if key in signature.parameters})

        keyword = inspect.Parameter.KEYWORD_ONLY
        parameters = [p.replace(kind=keyword) for p in signature.parameters.values()]
        parameters += [inspect.Parameter(name, keyword) for name in needed if name not in signature.parameters]
        wrapper.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        return wrapper

    return decorate

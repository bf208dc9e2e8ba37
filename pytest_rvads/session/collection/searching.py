"""Marks of tests that search, and the one that ships in the core: ``@rvads.falsify``.

A package adds a mark ``@rvads.NAME`` by an entry point in the group ``rvads.marks``, named NAME: a function that checks the
arguments of the mark when the test is defined, and returns a `SearchMark`.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

import pytest
from msgspec import structs

from pytest_rvads.drivers.identity import source
from pytest_rvads.drivers.interface import check_factory
from pytest_rvads.logic.conduct.kpis import kpis
from pytest_rvads.logic.rules.book import claim, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.record import of_run
from pytest_rvads.scenarios.case import Fleet
from pytest_rvads.scenarios.ids import run_id
from pytest_rvads.search.falsify import Search, violation
from pytest_rvads.session.collection.misuse import beside, caller, folder, told_at
from pytest_rvads.session.items import CELL, RECORD, RUN, SIMULATOR, VERDICTS, checked_name
from pytest_rvads.session.options import LIMITS, OPTIONS
from pytest_rvads.simulators.simulator import Choice, made_by, usable
from pytest_rvads.support.errors import RvadsError, ScenarioError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pytest_rvads.drivers.interface import Factory
    from pytest_rvads.geometry.junction import Junction
    from pytest_rvads.logic.judging.verdicts import Verdict
    from pytest_rvads.runs.measured import ArrivalDifferences
    from pytest_rvads.runs.run import Run
    from pytest_rvads.scenarios.scenario import Scenario
    from pytest_rvads.search.space import Space
    from pytest_rvads.session.collection.cells import Cell


class Asked(NamedTuple):
    """What a test item gives to its search."""

    driver: Factory
    simulator: Choice
    fleet: Fleet
    speed_limit: float | None
    """Speed limit of all roads that an option names [m/s]."""
    test: str
    """Module and name of the test."""
    target: Any
    """What the item searches, from `SearchMark.items`; None for a mark without items."""


class Shown(NamedTuple):
    """The run that the report of a test item shows."""

    scenario: Scenario
    run: Run
    verdicts: list[Verdict]
    """Verdicts on the run; the report shows the last one."""
    arrivals: ArrivalDifferences | None
    """Differences of arrivals in all runs of the search."""


class Found(NamedTuple):
    """The result of a search."""

    failure: Exception | None
    """Fails the test; None if nothing was found, and the body of the test runs."""
    shown: Shown | None = None
    """None for a mark without items."""


@dataclass(frozen=True, slots=True)
class SearchMark:
    """A mark that makes a test: a search runs first, and then the body of the test, if the search found nothing."""

    name: str
    """The mark in messages is ``@rvads.NAME``."""
    place: str
    """File and line of the mark, as `caller` returns them."""
    autopilot: Factory | None
    """The driver under test; None for the driver of the session."""
    search: Callable[[Asked], Found]
    items: Sequence[tuple[Any, Cell]] = ()
    """What each test item searches, with the cell that selects and reports the item; without items, the test is one item."""

    def __post_init__(self) -> None:
        with told_at(self.place):
            if self.autopilot is not None:
                check_factory(self.autopilot)

    def __call__(self, test: Callable[..., None]) -> Callable[..., None]:
        """Return the test that searches, from the function that is its body."""
        mark = f"@rvads.{self.name}"
        with told_at(self.place):
            if not inspect.isfunction(test):
                raise ScenarioError(f"{mark} makes a test of a function or method, got {test!r}: write it there")
            if inspect.iscoroutinefunction(test) or inspect.isasyncgenfunction(test) or inspect.isgeneratorfunction(test):
                raise ScenarioError(
                    f"{mark} calls the body of a test, got {test.__qualname__}, whose body a call would not run: write "
                    "it as a plain def without yield"
                )
        signature = inspect.signature(test)
        needed = ["pytestconfig", "rvads_vehicle", "rvads_simulator"]
        if self.items:
            needed += ["rvads_search", "rvads_cell", "request"]
        if self.autopilot is None:
            needed += ["rvads_sut", "rvads_autopilot"]

        @functools.wraps(test)
        def wrapper(*instance: Any, **fixtures: Any) -> None:
            __tracebackhide__ = True
            tested = (self.autopilot, fixtures.get("rvads_sut"), fixtures.get("rvads_autopilot"))
            driver: Any = next((driver for driver in tested if driver is not None), None)
            try:
                check_factory(driver)
                asked = Asked(
                    driver,
                    Choice.of(usable(fixtures["rvads_simulator"]), fixtures["pytestconfig"].stash[LIMITS]),
                    Fleet(fixtures["rvads_vehicle"]),
                    fixtures["pytestconfig"].stash[OPTIONS].speed_limit,
                    f"{test.__module__}.{test.__qualname__}",
                    fixtures.get("rvads_search"),
                )
                found = self.search(asked)
                if found.shown:
                    _record(fixtures["request"].node, fixtures["rvads_cell"], asked, found.shown)
            except RvadsError as error:
                # An error class of a user can have another constructor, so the error itself gets the place in its message.
                error.args = (f"{self.place}: {error}",)
                raise error.with_traceback(None) from None
            if found.failure is not None:
                raise found.failure
            test(*instance, **{key: value for key, value in fixtures.items() if key in signature.parameters})

        keyword = inspect.Parameter.KEYWORD_ONLY
        keywords = [p.replace(kind=keyword) for p in signature.parameters.values()]
        keywords += [inspect.Parameter(name, keyword) for name in needed if name not in signature.parameters]
        wrapper.__signature__ = signature.replace(parameters=keywords)  # type: ignore[attr-defined]
        if self.items:
            items = [pytest.param(target, cell, id=cell.id) for target, cell in self.items]
            pytest.mark.parametrize(("rvads_search", "rvads_cell"), items)(wrapper)
        return wrapper


def _record(item: pytest.Item, cell: Cell, asked: Asked, shown: Shown) -> None:
    """Complete the record of a test item with the run that its search shows."""
    scenario, run, verdicts, arrivals = shown
    stash = item.stash
    stash[RUN], stash[SIMULATOR], stash[VERDICTS] = run, asked.simulator, verdicts
    stash[CELL] = replace(cell, scenario=scenario)
    stash[RECORD] = structs.replace(
        stash[RECORD],
        driver=checked_name(asked.driver, item.config),
        source=source(asked.driver, item.config.invocation_params.dir),
        simulator=made_by(asked.simulator, run),
        run=run_id(scenario, cell.traffic.name if cell.traffic else None),
        kpis=kpis(run),
        arrivals=arrivals,
        **of_run(run),
    )


def falsify(
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

    The body of the test runs after the search, and only if the search found no violation; the arguments of the body are fixtures.
    Hypothesis stores the scenario in its example database and tries the scenario first in the next session. If no run of the
    search required an action by the rule, the test is an error.

    Args:
        junction: a junction, a built-in name, or the id of a junction in ``map``.
        rule: the rule to violate.
        autopilot: the system under test; by default the driver that an option names, or, without such an option, the driver of
            the fixture ``rvads_autopilot``.
        traffic: with ``subject``, the driver of the other vehicles: a policy by name, or an autopilot of yours; the reference by
            default.
        budget: greatest number of simulations until a counterexample is found, and greatest number of further simulations that
            simplify the counterexample. A search with a larger budget begins with the simulations of a smaller budget.
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
        if space.get("map") is not None:
            space = {**space, "map": beside(folder(place), space["map"])}
        search = Search.of(junction, rule, traffic, budget, seed, space)
        search.parts(searches)
        if isinstance(rule, Rule):  # a rule that is given by name is looked up when the test runs
            claim(*rules_for(rule))

    def begin(asked: Asked) -> Found:
        limit = asked.speed_limit
        limited = replace(search, place=search.place.limited(limit)) if limit else search
        counterexample = limited.begin(asked.driver, asked.fleet, asked.simulator, asked.test, searches, executor)
        return Found(None if counterexample is None else violation(counterexample))

    return SearchMark("falsify", place, autopilot, begin)

"""``@rvads.falsify`` and ``@rvads.critical``: tests that search. Their arguments are checked when the test is defined."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import pytest
from msgspec import structs

from pytest_rvads.drivers.identity import source
from pytest_rvads.drivers.interface import check_factory
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.kpis import arrival_differences, kpis
from pytest_rvads.logic.rules.book import claim, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.record import of_run
from pytest_rvads.satellites.starts.critical import critical_starts, failing, failure
from pytest_rvads.satellites.starts.starts import Begin, lines_at
from pytest_rvads.satellites.starts.trials import Setting
from pytest_rvads.scenarios.case import Fleet
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.counterexample import violation
from pytest_rvads.search.falsify import Search
from pytest_rvads.session.collection.cells import cells_of
from pytest_rvads.session.collection.misuse import beside, caller, told_at
from pytest_rvads.session.items import CELL, RECORD, RUN, SIMULATOR, VERDICTS, checked_name
from pytest_rvads.session.options import LIMITS, OPTIONS
from pytest_rvads.simulators.simulator import Choice, made_by, usable
from pytest_rvads.support.errors import RvadsError, ScenarioError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from pytest_rvads.drivers.interface import Factory
    from pytest_rvads.satellites.starts.critical import CriticalStart
    from pytest_rvads.satellites.starts.starts import Line
    from pytest_rvads.search.space import Space
    from pytest_rvads.session.collection.cells import Cell


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
            space = {**space, "map": beside(_folder(place), space["map"])}
        search = Search.of(junction, rule, traffic, budget, seed, space)
        search.parts(searches)
        if isinstance(rule, Rule):  # a rule that is given by name is looked up when the test runs
            claim(*rules_for(rule))
        if autopilot is not None:
            check_factory(autopilot)

    def begin(driver: Factory, fixtures: Mapping[str, Any], name: str) -> Exception | None:
        limit = fixtures["pytestconfig"].stash[OPTIONS].speed_limit
        limited = replace(search, place=search.place.limited(limit)) if limit else search
        simulator, fleet = _simulator(fixtures), Fleet(fixtures["rvads_vehicle"])
        counterexample = limited.begin(driver, fleet, simulator, name, searches, executor)
        return None if counterexample is None else violation(counterexample)

    return _searching("@rvads.falsify", place, autopilot, begin)


def critical(
    junction: str | Junction,
    *,
    map: str | PathLike[str] | None = None,
    rules: str | Rule | Sequence[str | Rule] = "road",
    seats: Sequence[int] | None = None,
    pedestrians: str | Sequence[str] = (),
    autopilot: Factory | None = None,
    traffic: str | Factory = "reference",
    executor: Executor | int | None = 1,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a test that judges the critical starts of a junction, with a test item for every two conflicting ways.

    The starts of two vehicles form a line. At one end of the line the other vehicle is well ahead, and at the other end the
    vehicle under test (the subject). An item finds, to 0.01 s, the start on the line at which the subject changes from waiting
    to going. The item fails if the run from this start, or from a less critical start, breaks a rule. If the subject may have
    to wait at its line, a second item searches the starts at which the subject stands at its line. Pairs of ways that are equal
    up to a rotation of the junction share an item. The body of the test runs after the search, and only if the search found no
    violation. The arguments of the body are fixtures.

    Args:
        junction: a junction, a built-in name, or the id of a junction in `map`.
        map: map file of a junction that is given by id. The path is relative to the folder of the test file or, if that
            folder has no such file, to the working directory.
        rules: a rulebook, rules, or both.
        seats: entrances of the vehicle under test; all by default.
        pedestrians: behaviours such as ``"steady"``. With behaviours, a pedestrian takes the place of the other vehicle: an item
            is made for every way that leads over a crosswalk, and for each side of the crosswalk.
        autopilot: the system under test; by default the driver that an option names, or, without such an option, the driver of
            the fixture ``rvads_autopilot``.
        traffic: driver of the other vehicle: a policy by name, or an autopilot of yours.
        executor: executor or number of processes of an item, as for `campaign`.

    Raises:
        RvadsError: an argument is wrong, or a class is decorated; pytest shows the message with the line and without a traceback.

    Example:
        >>> @critical("stop4")
        ... def test_gaps_at_the_stop_signs(): ...
    """
    place = caller()
    with told_at(place):
        at = junction if isinstance(junction, Junction) else find(junction, map and beside(_folder(place), map))
        lines = lines_at(at, seats, (pedestrians,) if isinstance(pedestrians, str) else tuple(pedestrians))
        judged = rules_for(rules)
        for rule in judged:
            claim(rule)
        policy = Policy.of(traffic)
        if autopilot is not None:
            check_factory(autopilot)

    def begin(driver: Factory, fixtures: Mapping[str, Any], _name: str) -> Exception | None:
        simulator, fleet = _simulator(fixtures), Fleet(fixtures["rvads_vehicle"])
        limit, group = fixtures["pytestconfig"].stash[OPTIONS].speed_limit, fixtures["rvads_lines"]
        if limit:
            group = tuple(replace(line, place=line.place.limited(limit)) for line in group)
        setting = Setting.of(driver, judged, traffic, fleet, simulator)
        sides = list(critical_starts([group], setting, executor))
        wrong = failure(sides, setting)
        _record(fixtures["request"].node, sides, setting)
        return wrong

    decorate = _searching("@rvads.critical", place, autopilot, begin, "rvads_lines", "rvads_cell", "request")
    items = [pytest.param(group, _cell(group[0], policy), id=group[0].id) for group in lines]
    return lambda test: pytest.mark.parametrize(("rvads_lines", "rvads_cell"), items)(decorate(test))


def _cell(line: Line, policy: Policy) -> Cell:
    """Return the cell of a test item about a line of starts; the `Begin` of the line is its configuration.

    The cell names a pedestrian without a difference of arrivals, because the search chooses the difference.
    """
    configuration = "critical" if line.begin is Begin.MOVING else str(line.begin)
    walkers = [line.walker] if line.walker else []
    scenario = Scenario(line.place, line.directions, subject=line.seat, configuration=configuration, pedestrians=walkers)
    (cell,) = cells_of(scenario, policy, (None,), ())
    keys = cell.keys | ({"pedestrians": line.named()[1]} if line.walker else {})
    return replace(cell, id=line.id, run=line.id, keys=keys)


def _simulator(fixtures: Mapping[str, Any]) -> Choice:
    return Choice.of(usable(fixtures["rvads_simulator"]), fixtures["pytestconfig"].stash[LIMITS])


def _folder(place: str) -> Path:
    return Path(place.rpartition(":")[0]).parent


def _record(item: pytest.Item, sides: Sequence[CriticalStart], setting: Setting) -> None:
    """Complete the record of an item: run and verdicts of its worst start, and the arrivals of all starts."""
    side = (failing(sides) or [side for side in sides if side.start])[0]
    start = side.failed or side.start
    assert start is not None
    scenario = side.line.scenario(start.lead)
    run, verdicts = setting.judged(scenario)
    verdicts.sort(key=lambda verdict: (verdict.rule == side.rule, -verdict.outcome.severity))  # reports show the last verdict
    measured = arrival_differences(run)
    if measured is not None:
        own = [agent.entrance for agent in run.agents].index(side.line.seat)
        starts = [start for side in sides for start in (*side.tried, *side.shrunk)]
        tried = [(own, 1 - own, start.difference) for start in starts if start.difference is not None]
        measured = structs.replace(measured, tried=tuple(tried))
    stash = item.stash
    stash[RUN], stash[SIMULATOR], stash[VERDICTS] = run, setting.simulator, verdicts
    stash[CELL] = replace(item.callspec.params["rvads_cell"], scenario=scenario)  # type: ignore[attr-defined]
    stash[RECORD] = structs.replace(
        stash[RECORD],
        driver=checked_name(setting.driver, item.config),
        source=source(setting.driver, item.config.invocation_params.dir),
        simulator=made_by(setting.simulator, run),
        run=setting.id(scenario),
        kpis=kpis(run),
        arrivals=measured,
        **of_run(run),
    )


def _searching(
    mark: str,
    place: str,
    autopilot: Factory | None,
    begin: Callable[[Factory, Mapping[str, Any], str], Exception | None],
    *parameters: str,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that makes a test: the search runs first, then the body of the test.

    `begin` runs the search, given a driver, the values of fixtures and the name of the test, and returns the exception of a
    failure. With None as `autopilot`, the driver of the session is tested. Messages name the mark and its place.
    """

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        with told_at(place):
            if not inspect.isfunction(test):
                raise ScenarioError(f"{mark} makes a test of a function or method, got {test!r}: write it there")
            if inspect.iscoroutinefunction(test) or inspect.isasyncgenfunction(test) or inspect.isgeneratorfunction(test):
                raise ScenarioError(
                    f"{mark} calls the body of a test, got {test.__qualname__}, whose body a call would not run: write "
                    "it as a plain def without yield"
                )
        signature = inspect.signature(test)
        needed = ["pytestconfig", "rvads_vehicle", "rvads_simulator", *parameters]
        if autopilot is None:
            needed += ["rvads_sut", "rvads_autopilot"]

        @functools.wraps(test)
        def wrapper(*instance: Any, **fixtures: Any) -> None:
            __tracebackhide__ = True
            tested = (autopilot, fixtures.get("rvads_sut"), fixtures.get("rvads_autopilot"))
            driver: Any = next((driver for driver in tested if driver is not None), None)
            try:
                check_factory(driver)
                wrong = begin(driver, fixtures, f"{test.__module__}.{test.__qualname__}")
            except RvadsError as error:
                # An error class of a user can have another constructor, so the error itself gets the place in its message.
                error.args = (f"{place}: {error}",)
                raise error.with_traceback(None) from None
            if wrong is not None:
                raise wrong
            test(*instance, **{key: value for key, value in fixtures.items() if key in signature.parameters})

        keyword = inspect.Parameter.KEYWORD_ONLY
        keywords = [p.replace(kind=keyword) for p in signature.parameters.values()]
        keywords += [inspect.Parameter(name, keyword) for name in needed if name not in signature.parameters]
        wrapper.__signature__ = signature.replace(parameters=keywords)  # type: ignore[attr-defined]
        return wrapper

    return decorate

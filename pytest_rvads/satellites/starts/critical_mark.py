"""The mark ``@rvads.critical``, which makes a test that judges the critical starts of a junction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from os import PathLike

from msgspec import structs

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.kpis import arrival_differences
from pytest_rvads.logic.rules.book import claim, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.satellites.starts.critical import CriticalStart, critical_starts, failing, failure
from pytest_rvads.satellites.starts.lines import Begin, Line, Setting, lines_at
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.session.collection.cells import Cell, cells_of
from pytest_rvads.session.collection.misuse import beside, caller, folder, told_at
from pytest_rvads.session.collection.searching import Asked, Found, SearchMark, Shown


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
        at = junction if isinstance(junction, Junction) else find(junction, map and beside(folder(place), map))
        lines = lines_at(at, seats, (pedestrians,) if isinstance(pedestrians, str) else tuple(pedestrians))
        judged = rules_for(rules)
        for rule in judged:
            claim(rule)
        policy = Policy.of(traffic)

    def search(asked: Asked) -> Found:
        limit, group = asked.speed_limit, asked.target
        if limit:
            group = tuple(replace(line, place=line.place.limited(limit)) for line in group)
        setting = Setting.of(asked.driver, judged, traffic, asked.fleet, asked.simulator)
        sides = list(critical_starts([group], setting, executor))
        return Found(failure(sides, setting), _shown(sides, setting))

    return SearchMark("critical", place, autopilot, search, [(group, _cell(group[0], policy)) for group in lines])


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


def _shown(sides: Sequence[CriticalStart], setting: Setting) -> Shown:
    """Return run and verdicts of the worst start, and the arrivals of all starts."""
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
    return Shown(scenario, run, verdicts, measured)

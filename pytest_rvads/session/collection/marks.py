"""The marks ``@rvads.scenario``, ``@rvads.recorded`` and ``@rvads.known``, which are expanded at collection."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from os import PathLike
from typing import TYPE_CHECKING, Any, Concatenate, Never, ParamSpec

import pytest

from pytest_rvads.session.collection.ask import Ask
from pytest_rvads.session.collection.cells import Known
from pytest_rvads.session.collection.misuse import caller, told_at
from pytest_rvads.session.collection.recordings import Recordings

if TYPE_CHECKING:
    from pytest_rvads.logic.rules.rule import Rule

P = ParamSpec("P")


def _parameters_of(
    ask: Callable[Concatenate[str, P], Ask],
) -> Callable[[Callable[..., pytest.MarkDecorator]], Callable[P, pytest.MarkDecorator]]:
    """Give a mark the parameters of `ask` without the place, for type checkers and for `inspect.signature`."""

    def decorate(mark: Callable[..., pytest.MarkDecorator]) -> Callable[P, pytest.MarkDecorator]:
        _, *parameters = inspect.signature(ask).parameters.values()
        mark.__signature__ = inspect.signature(mark).replace(parameters=parameters)  # type: ignore[attr-defined]
        return mark

    return decorate


@_parameters_of(Ask)
def scenario(junction: Any = None, **arguments: Any) -> pytest.MarkDecorator:
    """Run a test over the scenarios of a junction, or of several junctions.

    If several junctions are selected, junctions that can't be used or that do not fit the other arguments are left out. The
    summary and the reports state the number of left-out junctions and the reasons. A single junction that does not fit is an
    error, and so is a mark for which no junction fits.

    Args:
        junction: built-in name (``stop4``), id of a junction in `map`, a type such as ``"4-way stop"`` for all junctions of this
            type in `map`, ``"*"`` for all junctions in `map`, a place in `map` such as ``"nearest to 52, 149"``, or several of
            these. Without a map a type stands for the first built-in junction of this type, ``"*"`` for all built-in junctions.
        map: map file; by default the file of ``rvads_map``. The path is relative to the folder of the test file or, if that
            folder has no such file, to the working directory.
        junctions: kinds of junctions to select, ``{"control": ["stop", "lights"], "arms": (3, 4), "approach": 40}``: control,
            number of arms, and least length of every approach [m]. Without `junction`, all junctions are selected from.
        limit: greatest number of junctions; if more fit, a sample is drawn by ``rvads_seed``, spread evenly over the kinds
            (control and number of arms).
        classes: numbers of structural equivalence classes; all by default.
        scenarios: direction strings such as ``"1133"``, or ``"13_2_0_31"`` where arms have several lanes, instead of `classes`.
            Each of these scenarios is run in place of the first scenario of its class.
        cover: ``"class"`` runs one scenario per class, ``"scenario"`` every distinct scenario of a class, ``"rotation"`` every
            rotation of a scenario, even if several rotations are equal. ``"partial"`` runs one scenario per class of scenarios
            with or without empty entrances: 69 classes at four ways. ``"pairs"`` runs few scenarios that together contain every
            pair of movements from different entrances; ``"conflicts"`` runs few scenarios that together contain every pair of
            movements that cross or merge.
        occupancy: the vehicles of a full scenario: ``"arms"``, one vehicle on every arm, on any of its lanes; or ``"lanes"``, one
            vehicle on every lane. With one lane per arm, the two values mean the same.
        followers: number of vehicles that queue behind each vehicle, 0 to 9, or several numbers.
        grid: ``"paper"``, or letters of the paper's configurations such as ``"CD"``. A test with a subject can also take
            ``"staggered"``: the subject and the traffic arrive one after the other. A single staggered configuration is named
            ``"S21"``: the traffic starts 21 m before its stopping lines. ``"arrivals"`` runs equal starts and some staggered
            starts. Default: ``"arrivals"`` with a subject, ``"paper"`` without a subject.
        distances: distances to the stopping line [m], instead of `grid`: a number for all vehicles, a tuple with a number
            per entrance, or a list or array of numbers or tuples.
        speeds: initial speeds [m/s], with `distances` and in the same forms; 0 by default.
        probe: whether to keep points of the grid beyond the braking envelope v(d)max; by default these points are left out.
        rules: a rulebook, rules, or both; from a rulebook only the rules about the control of the junction run. By default
            ``"paper"``, and ``"road"`` with a subject.
        subject: entrance of the vehicle under test, or ``"all"`` for every entrance in turn. The other vehicles are traffic, and
            only violations by the subject fail the test. By default all vehicles are under test. With a subject,
            ``cover="class"`` runs every class of (scenario, entrance of the subject): 81 classes at four ways and 8 at three.
        traffic: with a subject, the driver of the other vehicles: a policy by name (``"reference"`` by default, ``"hesitant"``,
            ``"rolling_stop"``, ``"late_yielder"``, ``"red_light_runner"``, ``"stopped"``, ``"lgsvl"``), an autopilot or
            traffic system of yours, or several of these.
        pedestrians: every scenario runs once with each pedestrian, alone on a crosswalk that the vehicle under test, or without a
            subject any vehicle, drives over. A behaviour by name (``"steady"``, ``"yields"``, ``"darts"``, ``"stops"``,
            ``"returns"``, ``"against"``, ``"group"``, ``"waits"``, ``"hidden"``), a `Pedestrian`, a dict of the fields of a
            `Pedestrian` such as ``{"behaviour": ["steady", "darts"], "side": "near", "difference": [-1, 0, 1]}``, whose lists are
            multiplied out, or several of these. By default, pedestrians walk steadily at every such crosswalk from both sides,
            and arrive from 4 s before to 4 s after the vehicle, in steps of 0.5 s. Pedestrians who would have crossed before the
            run begins are left out and counted. ``cover="class"`` takes scenarios as equal if a rotation maps vehicles and
            crosswalk onto each other; ``"conflicts"`` contains every movement of the subject over a crosswalk, too.
        senses: imperfections of the vehicle under test: `Senses`, several `Senses`, or a dict of their fields such as
            ``{"delay": [0, 0.1, 0.2], "range": 40}``, whose lists are multiplied out. Ideal senses by default.
        duration: longest run [s]; 60 by default, or a cycle of the lights and 30 s for lights with more than two phases.
        aggression: braking level 1, 2 or 3.
        wait: waiting time that autopilots with a random waiting time use [s].
        requirement: identifier of the requirement that the scenario traces to, or several; see `--rvads-report=FILE.csv`.

    Raises:
        ScenarioError: an argument is wrong; pytest shows the message with the line of the mark and without a traceback.
    """
    place = caller()
    with told_at(place):
        mark: pytest.MarkDecorator = pytest.mark.rvads_scenario(Ask.of(place, {"junction": junction, **arguments}))
    return mark


def recorded(
    *patterns: str | PathLike[str],
    rules: str | Rule | Iterable[str | Rule] | None = None,
    requirement: str | Iterable[str] | None = None,
    **misspelt: Never,
) -> pytest.MarkDecorator:
    """Run a test over recorded runs: files of runs, or busy periods of recorded traffic.

    The test takes ``run``, ``rule`` and ``monitor`` as for scenarios; ``rvads_recorded`` is the same run. Nothing is simulated.
    The items of a file that can't be read are errors; the items of all other files run.

    Args:
        patterns: files, folders that are searched with their subfolders for files of runs, or patterns such as
            ``"drives/**/*.npz"``. Paths are relative to the folder of the test file or, without a match in that folder, to the
            working directory. A pattern without any match is refused.
        rules: a rulebook, rules, or both; from a rulebook only the rules about the control of the junction run. By default
            ``"road"``.
        requirement: identifier of the requirement that the recordings trace to, or several; see `--rvads-report=FILE.csv`.
        misspelt: any other keyword, which is refused.

    Raises:
        ScenarioError: an argument is wrong; pytest shows the message with the line of the mark and without a traceback.

    Example:
        >>> @recorded("drives/*.npz", rules="road")
        ... def test_drives(monitor, rule):
        ...     monitor.check(rule)
    """
    place = caller()
    with told_at(place):
        mark: pytest.MarkDecorator = pytest.mark.rvads_recorded(Recordings.of(place, patterns, rules, requirement, misspelt))
    return mark


def known(name: str, *, reason: str = "", **where: str | int | Iterable[str | int]) -> pytest.MarkDecorator:
    """Mark the test items that must fail because of a known deficiency (a strict xfail); an item that passes fails the session.

    Args:
        name: name of the deficiency in reports.
        reason: the deficiency in words.
        where: keys that select items, each with a value or several values: junction, cls, scenario, cfg, rotation, seat, traffic,
            recording, rule.

    Raises:
        ScenarioError: a key is unknown.
    """
    place = caller()
    with told_at(place):
        mark: pytest.MarkDecorator = pytest.mark.rvads_known(Known.of(place, name, reason, where))
    return mark

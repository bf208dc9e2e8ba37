"""The marks ``@rvads.scenario``, ``@rvads.recorded`` and ``@rvads.known``: what is asked for, to be expanded at collection."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Never

import pytest

from pytest_rvads.collection.cells import KEYS, Known
from pytest_rvads.collection.misuse import caller, told_at
from pytest_rvads.errors import ScenarioError, suggest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pytest_rvads.drivers.interface import Factory
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.scenarios.senses import Senses

__all__ = ["known", "recorded", "register_marks", "scenario"]


def scenario(  # noqa: PLR0913 - keywords, each an axis of its own
    junction: str | Iterable[str] | None = None,
    *,
    map: str | None = None,
    junctions: Mapping[str, Any] | None = None,
    limit: int | None = None,
    classes: int | Iterable[int] | None = None,
    scenarios: str | Iterable[str] | None = None,
    cover: str | None = None,
    occupancy: str = "arms",
    followers: int | Iterable[int] | None = None,
    grid: str | Iterable[str] | None = None,
    distances: float | Sequence[Any] | NDArray[Any] | None = None,
    speeds: float | Sequence[Any] | NDArray[Any] | None = None,
    probe: bool = False,
    rules: str | Rule | Iterable[str | Rule] | None = None,
    subject: int | str | None = None,
    traffic: str | Factory | Iterable[str | Factory] | None = None,
    senses: Senses | Iterable[Senses] | Mapping[str, Any] | None = None,
    duration: float | None = None,
    aggression: int = 1,
    wait: float = 1.5,
    requirement: str | Iterable[str] | None = None,
    **misspelt: Never,
) -> pytest.MarkDecorator:
    """Run a test over the scenarios of a junction, or of many.

    Where several junctions are asked for, those that can't be used, or don't have what else is asked for, are left out, and the
    summary and the reports say how many and why. A junction that is named, and nothing left at all, are refused.

    Args:
        junction: built-in name (``stop4``), id of a junction in `map`, a type such as ``"4-way stop"`` for all of `map` that fit,
            ``"*"`` for all of `map`, a place in `map` such as ``"nearest to 52, 149"``, or several of these. Without a map a
            type is the first built-in junction that fits, and ``"*"`` all of these.
        map: OpenDRIVE file, looked for beside the test file, then in the working directory; by default the
            one of ``rvads_map``, if any.
        junctions: take only those of some kinds, ``{"control": ["stop", "lights"], "arms": (3, 4), "approach": 40}``: what
            regulates them, how many arms they have, how long every approach is at least [m]; of all where `junction` names none.
        limit: most junctions; more are drawn, as evenly as possible from every kind (control and number of arms), by
            ``rvads_seed``.
        classes: numbers of structural equivalence classes; all by default.
        scenarios: direction strings such as ``"1133"``, or ``"13_2_0_31"`` where arms have several lanes, that stand at row 0 of
            their class, instead of `classes`.
        cover: ``"class"`` runs one scenario per class, ``"scenario"`` every distinct member, ``"rotation"`` all rows.
            ``"partial"`` runs one per class of scenarios that may leave entrances empty, full ones included: 69 at four ways.
            ``"pairs"`` runs as few scenarios as are easily found in which every pair of movements from different entrances
            happens; ``"conflicts"`` likewise those that cross or merge.
        occupancy: what a full scenario is: ``"arms"``, one vehicle on every arm, on any of its lanes; or ``"lanes"``, one on
            every lane. The same with one lane per arm.
        followers: how many vehicles queue behind each, 0 to 9, or several numbers to run one after the other.
        grid: ``"paper"``, or letters of the paper's configurations such as ``"CD"``. A test with a subject may also take
            ``"staggered"``: the subject and the traffic arrive one after the other. A single staggered configuration is named
            ``"S21"``: the traffic starts 21 m before its stopping lines. ``"arrivals"`` is an equal start and some staggered
            starts. Default: ``"arrivals"`` with a subject, ``"paper"`` without a subject.
        distances: distances to the stopping line [m], instead of `grid`: a number for all vehicles, a tuple with a number
            per entrance, or a list or array of numbers or tuples, which run one after the other.
        speeds: initial speeds [m/s], with `distances` and in the same forms; 0 by default.
        probe: keep points of the grid beyond the braking envelope v(d)max; by default they are left out.
        rules: a rulebook, rules, or both; of a rulebook only the rules about this kind of junction run. By default
            ``"paper"``, and ``"road"`` with a subject.
        subject: entrance of the vehicle under test, or ``"all"`` for every seat in turn; the others are traffic, and only
            what the subject is to blame for fails the test. By default all vehicles are under test. ``cover="class"`` then
            runs every class of (scenario, seat): as many as there are scenarios, 81 at four ways and 8 at three.
        traffic: with a subject, what drives the others: a policy by name (``"reference"`` by default, ``"hesitant"``,
            ``"rolling_stop"``, ``"late_yielder"``, ``"red_light_runner"``, ``"stopped"``, ``"lgsvl"``), an autopilot or
            traffic system of your own, or several of these to run one after the other.
        senses: how imperfectly the vehicle under test sees and acts: `Senses`, several of them to run one after the other,
            or a dict of its fields, ``{"delay": [0, 0.1, 0.2], "range": 40}``; lists are multiplied out. Ideal by default.
        duration: longest run [s]; 60 by default, or a cycle of the lights and 30 s where they have more than two phases.
        aggression: braking level 1, 2 or 3.
        wait: the random draw of autopilots that have one [s].
        requirement: identifier of the requirement that the scenario traces to, or several; see `--rvads-report=FILE.csv`.
        misspelt: no other keyword is taken.

    Raises:
        ScenarioError: an argument that means nothing; pytest shows it with the line of the mark and without a traceback.
    """
    place = caller()
    from pytest_rvads.collection.ask import Ask  # reads rules, maps and drivers, which a session without marks does not need

    arguments = {
        "junction": junction,
        "map": map,
        "junctions": junctions,
        "limit": limit,
        "classes": classes,
        "scenarios": scenarios,
        "cover": cover,
        "occupancy": occupancy,
        "followers": followers,
        "grid": grid,
        "distances": distances,
        "speeds": speeds,
        "probe": probe,
        "rules": rules,
        "subject": subject,
        "traffic": traffic,
        "senses": senses,
        "duration": duration,
        "aggression": aggression,
        "wait": wait,
        "requirement": requirement,
    }
    with told_at(place):
        mark: pytest.MarkDecorator = pytest.mark.rvads_scenario(Ask.of(place, arguments, misspelt))
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
        patterns: files, folders with files of runs in them or in their folders, or patterns such as ``"drives/**/*.npz"``;
            looked for beside the test file, then in the working directory. One that matches nothing is refused.
        rules: a rulebook, rules, or both; of a rulebook only the rules about the junction of a file run. By default ``"road"``.
        requirement: identifier of the requirement that the recordings trace to, or several; see `--rvads-report=FILE.csv`.
        misspelt: no other keyword is taken.

    Raises:
        ScenarioError: an argument that means nothing; pytest shows it with the line of the mark and without a traceback.

    Example:
        >>> @recorded("drives/*.npz", rules="road")
        ... def test_drives(monitor, rule):
        ...     monitor.check(rule)
    """
    place = caller()
    from pytest_rvads.collection.recordings import Recordings  # reads rules, which a session without marks does not need

    with told_at(place):
        mark: pytest.MarkDecorator = pytest.mark.rvads_recorded(Recordings.of(place, patterns, rules, requirement, misspelt))
    return mark


def known(name: str, *, reason: str = "", **where: str | int | Iterable[str | int]) -> pytest.MarkDecorator:
    """Mark the cells of a known deficiency: they must fail (a strict xfail), and a pass is reported.

    Args:
        name: of the deficiency, as it shall appear in reports.
        reason: what goes wrong.
        where: values, or several of them, for any of junction, cls, scenario, cfg, rotation, seat, traffic, recording, rule.

    Raises:
        ScenarioError: another keyword.
    """
    place = caller()
    with told_at(place):
        mark: pytest.MarkDecorator = pytest.mark.rvads_known(Known.of(place, name, reason, where))
    return mark


def register_marks(config: pytest.Config) -> None:
    """Tell pytest about the marks.

    Raises:
        ScenarioError: the expression of ``-m`` selects by a key that no item has, which pytest takes for one that never matches.
    """
    unquoted = re.sub(r"""'[^']*'|"[^"]*\"""", "", config.option.markexpr)
    for key in re.findall(r"(\w+)\s*=", " ".join(re.findall(r"\brvads\s*\(([^)]*)", unquoted))):
        if key not in KEYS:
            raise ScenarioError(f"-m rvads(...) selects by {', '.join(KEYS)}, got {key!r}{suggest(key, KEYS)}")
    for line in (
        "rvads_scenario(junction, ...): run over scenarios; written as @rvads.scenario",
        "rvads_recorded(pattern, ...): run over recorded runs; written as @rvads.recorded",
        "rvads_known(name, ...): cells of a known deficiency; written as @rvads.known",
        f"rvads({', '.join(KEYS)}): on every item, to select by -m \"rvads(cls=7, rule='p1')\"",
    ):
        config.addinivalue_line("markers", line)

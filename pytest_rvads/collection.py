"""The marks ``@rvads.scenario`` and ``@rvads.known``, and their expansion into test items at collection.

One item per verdict: abstract scenario x configuration x rule, the rule innermost, so that the items of one
run follow each other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.errors import OpenObligation, RuleViolation, RvadsError, ScenarioError, suggest

if TYPE_CHECKING:
    from pytest_rvads.autopilots.traffic import Policy
    from pytest_rvads.logic.rules import Rule
    from pytest_rvads.maps.junction import Junction
    from pytest_rvads.options import Options
    from pytest_rvads.scenarios.grid import Configuration
    from pytest_rvads.scenarios.scenario import Scenario

__all__ = ["KEYS", "Cell", "expand", "known", "register_marks", "scenario"]

KEYS = ("junction", "cls", "scenario", "cfg", "rotation", "seat", "traffic", "rule")
"""Keywords that select cells, in ``-m "rvads(cls=7)"`` and in ``@rvads.known(cls=7)``."""


DEFAULT = "reference"
"""The traffic policy where a mark names none; ids leave it out."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What one item runs and judges."""

    scenario: Scenario
    rule: Rule | None
    """None where the test does not ask for the rule axis."""
    traffic: Policy | None = None
    """Drives the others where the scenario has a subject."""

    @property
    def id(self) -> str:
        """The part in brackets of the item's id."""
        return f"{self.run}-{self.rule.name}" if self.rule else self.run

    @property
    def run(self) -> str:
        """The id without the rule: what cells of the same run share."""
        name = self.scenario.name
        return name if self.traffic is None or self.traffic.name == DEFAULT else f"{name}-{self.traffic.name}"

    @property
    def keys(self) -> dict[str, str | int]:
        """What the cell is selected by; every value a str or an int."""
        from pytest_rvads.scenarios.classes import label

        scenario = self.scenario
        keys: dict[str, str | int] = {
            "junction": scenario.find().name,
            "cls": scenario.number,
            "scenario": label(scenario.placed),
            "cfg": scenario.configuration,
            "rotation": scenario.rotation,
        }
        if scenario.subject is not None:
            keys["seat"] = scenario.subject
        if self.traffic:
            keys["traffic"] = self.traffic.name
        if self.rule:
            keys["rule"] = self.rule.name
        return keys


def scenario(
    junction: str,
    *,
    map: str | None = None,
    classes: int | Iterable[int] | None = None,
    scenarios: str | Iterable[str] | None = None,
    cover: str | None = None,
    grid: str | Iterable[str] | None = None,
    distances: float | Sequence[Any] | None = None,
    speeds: float | Sequence[Any] | None = None,
    probe: bool = False,
    rules: str | Rule | Iterable[str | Rule] | None = None,
    subject: int | str | None = None,
    traffic: str | Callable[[], Any] | Iterable[str | Callable[[], Any]] | None = None,
    duration: float = 60.0,
    aggression: int = 1,
    wait: float = 1.5,
) -> pytest.MarkDecorator:
    """Run a test over the scenarios of a junction.

    Args:
        junction: built-in name (``stop4``), id of a junction in `map`, or a type such as ``"4-way stop"``.
        map: OpenDRIVE file, looked for beside the test file, then in the working directory; by default the
            one of ``rvads_map``, if any.
        classes: numbers of structural equivalence classes; all by default.
        scenarios: direction strings such as ``"1133"`` that stand at row 0 of their class, instead of `classes`.
        cover: ``"class"`` runs one scenario per class, ``"scenario"`` every distinct member, ``"rotation"`` all rows.
        grid: ``"paper"``, or letters of the paper's configurations such as ``"CD"``.
        distances: instead of `grid`: metres to the stopping line, a number for all vehicles, a tuple with one
            per entrance, or a list of either to run one after the other.
        speeds: with `distances`: initial speeds [m/s], likewise; 0 by default.
        probe: keep points of the grid beyond the braking envelope v(d)max; by default they are left out.
        rules: a rulebook, rules, or both; of a rulebook only the rules about this kind of junction run. By default
            ``"paper"``, and ``"road"`` with a subject.
        subject: entrance of the vehicle under test, or ``"all"`` for every seat in turn; the others are traffic, and only
            what the subject is to blame for fails the test. By default all vehicles are under test. ``cover="class"`` then
            runs every class of (scenario, seat): as many as there are scenarios, 81 at four ways and 8 at three.
        traffic: with a subject, what drives the others: a policy by name (``"reference"`` by default, ``"hesitant"``,
            ``"rolling_stop"``, ``"late_yielder"``, ``"red_light_runner"``, ``"stopped"``, ``"lgsvl"``), an autopilot or
            traffic system of your own, or several of these to run one after the other.
        duration: longest run [s].
        aggression: braking level 1, 2 or 3.
        wait: the random draw of autopilots that have one [s].
    """
    given = locals()
    if not isinstance(junction, str):
        raise ScenarioError(f"write @rvads.scenario('stop4', ...) with the name of a junction in quotes, got {junction!r}")
    mark: pytest.MarkDecorator = pytest.mark.rvads_scenario(**given)
    return mark


def known(name: str, *, reason: str = "", **where: str | int | Iterable[str | int]) -> pytest.MarkDecorator:
    """Mark the cells of a known deficiency: they must fail (a strict xfail), and a pass is reported.

    Args:
        name: of the deficiency, as it shall appear in reports.
        reason: what goes wrong.
        where: values, or several of them, for any of junction, cls, scenario, cfg, rotation, seat, traffic, rule.

    Raises:
        ScenarioError: another keyword.
    """
    for key in where:
        if key not in KEYS:
            raise ScenarioError(f"@rvads.known selects by {', '.join(KEYS)}, got {key!r}{suggest(key, KEYS)}")
    values = {key: (value,) if isinstance(value, str | int) else tuple(value) for key, value in where.items()}
    mark: pytest.MarkDecorator = pytest.mark.rvads_known(name, reason=reason, **values)
    return mark


def register_marks(config: pytest.Config) -> None:
    """Tell pytest about the marks."""
    for line in (
        "rvads_scenario(junction, ...): run over scenarios; written as @rvads.scenario",
        "rvads_known(name, ...): cells of a known deficiency; written as @rvads.known",
        f"rvads({', '.join(KEYS)}): on every item, to select by -m \"rvads(cls=7, rule='p1')\"",
    ):
        config.addinivalue_line("markers", line)


def expand(metafunc: pytest.Metafunc, options: Options) -> None:
    """Parametrize a test over the cells of its marks.

    The nearest marks count: those on the function, else on the class, else on the module.

    Raises:
        pytest.Collector.CollectError: a mark that can't be expanded, in one sentence.
    """
    marks = _nearest(metafunc.definition)
    name = metafunc.definition.nodeid
    if not marks:
        raise pytest.Collector.CollectError(f"{name} asks for a run, but no @rvads.scenario(...) says which: add the mark")
    if not {"run", "monitor"} & set(metafunc.fixturenames):
        raise pytest.Collector.CollectError(f"{name} has @rvads.scenario(...) but takes neither run nor monitor: add an argument")
    declared = list(metafunc.definition.iter_markers("rvads_known"))
    try:
        cells = list(dict.fromkeys(cell for mark in marks for cell in _cells(mark, metafunc, options)))
        _distinct(cells)
        _in_use([mark for mark in metafunc.definition.own_markers if mark.name == "rvads_known"], cells)
    except RvadsError as error:
        raise pytest.Collector.CollectError(f"{name}: {error}") from error
    params = [pytest.param(cell, id=cell.id, marks=_marks(cell, declared)) for cell in cells]
    metafunc.parametrize("rvads_cell", params, indirect=True)


def _nearest(definition: pytest.Function) -> list[pytest.Mark]:
    found = list(definition.iter_markers_with_node("rvads_scenario"))
    return [mark for node, mark in found if node is found[0][0]]


def _distinct(cells: Sequence[Cell]) -> None:
    """Refuse cells that differ only in what is not part of their id."""
    seen: dict[str, Cell] = {}
    for cell in cells:
        if seen.setdefault(cell.id, cell) != cell:
            raise ScenarioError(
                f"two different scenarios have the id {cell.id!r}: they differ in duration, aggression, wait or map, which ids "
                "do not tell; put them into two tests"
            )


def _in_use(declared: Sequence[pytest.Mark], cells: Sequence[Cell]) -> None:
    """Refuse a mark of a known deficiency that matches no cell of the test it stands on."""
    for mark in declared:
        if not any(_known(mark, cell.keys) for cell in cells):
            where = ", ".join(f"{k}={v!r}" for k, v in mark.kwargs.items() if k != "reason")
            raise ScenarioError(f"@rvads.known({mark.args[0]!r}, {where}) matches none of the {len(cells)} cells of this test")


def _known(mark: pytest.Mark, keys: Mapping[str, str | int]) -> bool:
    return all(keys.get(key) in values for key, values in mark.kwargs.items() if key != "reason")


def _marks(cell: Cell, declared: Sequence[pytest.Mark]) -> list[pytest.MarkDecorator]:
    keys = cell.keys
    marks = [pytest.mark.rvads(**keys)]
    for mark in declared:
        if _known(mark, keys):
            reason = ": ".join(filter(None, (mark.args[0], mark.kwargs["reason"])))
            marks.append(pytest.mark.xfail(strict=True, raises=(RuleViolation, OpenObligation), reason=reason))
    return marks


def _cells(mark: pytest.Mark, metafunc: pytest.Metafunc, options: Options) -> Iterator[Cell]:
    from pytest_rvads.logic.rules import Rule, rules_for
    from pytest_rvads.maps.finder import find
    from pytest_rvads.scenarios.selection import Selection

    ask = mark.kwargs
    file = _map_file(ask["junction"], ask["map"], metafunc, options)
    junction = find(ask["junction"], file)
    selection = Selection.of(
        ask["junction"],
        file,
        junction.ways,
        _configurations(ask, junction, options),
        classes=_several("classes", ask["classes"], int, "class numbers"),
        scenarios=_several("scenarios", ask["scenarios"], str, "direction strings such as '1133'"),
        cover=options.cover if ask["cover"] is None else ask["cover"],
        duration=ask["duration"],
        aggression=ask["aggression"],
        wait=ask["wait"],
        subject=ask["subject"],
    )
    policies = _policies(ask["subject"], ask["traffic"])
    if options.rules:
        _register(options.rules)
    rules: Sequence[Rule | None] = [None]
    if "rule" in metafunc.fixturenames:
        default = "paper" if ask["subject"] is None else "road"
        named = _several("rules", ask["rules"], (str, Rule), "rules or names of rules or rulebooks")
        rules = rules_for(default if named is None else named, junction.control)
        if not rules:
            raise ScenarioError(
                f"no rule of {ask['rules'] or default!r} is about a junction with control {junction.control.value!r} like "
                f"{junction.name!r}: name rules outright, `rvads rules` lists them"
            )
    rows, points = selection.count(), len(selection.configurations)
    total = rows * points * len(policies) * len(rules)
    if total > options.max_items:
        among = f" × {len(policies)} kinds of traffic" if len(policies) > 1 else ""
        raise ScenarioError(
            f"would expand to {total:,} items ({rows:,} scenarios × {points} points{among} × {len(rules)} rules): "
            "narrow the grid, use --rvads-cover=class, or raise --rvads-max-items"
        )
    for scenario_ in selection:
        scenario_.fit()
        for policy in policies:
            for rule in rules:
                yield Cell(scenario_, rule, policy)


def _policies(subject: int | str | None, traffic: Any) -> tuple[Policy | None, ...]:
    """Return the traffic policies to run among, or None alone without a subject."""
    from pytest_rvads.autopilots.traffic import Policy

    if subject is None:
        if traffic is not None:
            raise ScenarioError("traffic= drives the vehicles beside a subject: say subject=0 or 'all', or leave traffic= out")
        return (None,)
    several = isinstance(traffic, Iterable) and not isinstance(traffic, str) and not callable(traffic)
    named = tuple(traffic) if several else (DEFAULT if traffic is None else traffic,)
    if not named:
        raise ScenarioError("traffic is empty: name a policy or an autopilot, or leave it out")
    return tuple(Policy.of(one) for one in named)


def _several(name: str, value: Any, kind: type | tuple[type, ...], what: str) -> tuple[Any, ...] | None:
    """Return one value or several as a tuple, None as it is.

    Raises:
        ScenarioError: values of another type, or none at all.
    """
    if value is None or isinstance(value, kind):
        return None if value is None else (value,)
    if isinstance(value, Iterable) and not isinstance(value, str):
        values = tuple(value)
        if not values:
            raise ScenarioError(f"{name} is empty: name {what}, or leave it out")
        if all(isinstance(v, kind) and not isinstance(v, bool) for v in values):
            return values
    raise ScenarioError(f"{name} takes {what}, one or several, got {value!r}")


@lru_cache
def _register(path: Path) -> None:
    """Register the rules of a user's file, once per process."""
    from pytest_rvads.logic.rulefile import load_rules

    load_rules(path)


def _map_file(junction: str, map: str | None, metafunc: pytest.Metafunc, options: Options) -> str | None:
    from pytest_rvads.maps.builtin import LAYOUTS

    if map is None:
        return None if junction in LAYOUTS else options.map
    beside = metafunc.definition.path.parent / map
    return str((beside if beside.exists() else Path(map)).resolve())


def _configurations(ask: Mapping[str, Any], junction: Junction, options: Options) -> tuple[Configuration, ...]:
    from pytest_rvads.scenarios.grid import explicit, grid, outside

    if ask["distances"] is None and ask["speeds"] is None:
        names = _several("grid", ask["grid"], str, "letters of configurations or 'paper'")
        return grid(options.grid if names is None else names, junction.ways, junction.control)
    if ask["grid"] is not None or ask["distances"] is None:
        raise ScenarioError("give either grid=, or distances= with speeds=")
    points = explicit(ask["distances"], 0.0 if ask["speeds"] is None else ask["speeds"], junction.ways)
    if ask["probe"]:
        return points
    from pytest_rvads.physics.braking import vmax

    kept = tuple(p for p in points if outside(p, lambda distance: vmax(distance, ask["aggression"])) is None)
    if not kept:
        raise ScenarioError(
            f"every point of distances={ask['distances']!r}, speeds={ask['speeds']!r} is too fast to stop before the line "
            "(`rvads braking` lists v(d)max): lower the speeds, or say probe=True to run them all the same"
        )
    return kept

"""The expansion of marks into test items at collection.

One item per verdict: abstract scenario x configuration x rule, the rule innermost, so that the items of one
run follow each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.collection.cells import DEFAULT, Cell, cells_of
from pytest_rvads.collection.extensions import extensions
from pytest_rvads.collection.meter import watched
from pytest_rvads.errors import OpenObligation, RuleViolation, RvadsError, ScenarioError

if TYPE_CHECKING:
    from pytest_rvads.drivers.traffic import Policy
    from pytest_rvads.junctions.junction import Junction
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.options import Options
    from pytest_rvads.scenarios.configurations import Configuration
    from pytest_rvads.scenarios.senses import Senses

__all__ = ["LEFT_OUT", "expand", "unused"]

_POINTS, _CELLS = 10, 5000
"""From how many points or cells on a terminal shows how far the collection is."""
LEFT_OUT: pytest.StashKey[dict[str, int]] = pytest.StashKey()
"""Node id of a test to how many points of its grid are beyond v(d)max and were left out."""
_KNOWN: pytest.StashKey[dict[int, tuple[Any, pytest.Mark, bool]]] = pytest.StashKey()
"""Marks of known deficiencies: where they stand, and whether they match a cell."""


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
    if "rvads_run" not in metafunc.fixturenames:
        own = "run" in metafunc.fixturenames
        why = "its `run` is a fixture of yours: call that otherwise" if own else "takes neither run nor monitor: add an argument"
        raise pytest.Collector.CollectError(f"{name} has @rvads.scenario(...) but {why}")
    declared = list(metafunc.definition.iter_markers_with_node("rvads_known"))
    try:
        cells = _distinct(cell for mark in marks for cell in _cells(mark, metafunc, options))
        _in_use([mark for node, mark in declared if node is metafunc.definition], cells)
    except RvadsError as error:
        raise pytest.Collector.CollectError(f"{name}: {error}") from error
    watched_cells = watched(metafunc.config, f"items of {metafunc.function.__name__}", cells, _CELLS)
    _note(metafunc.config, declared, cells)
    metafunc.parametrize("rvads_cell", list(_params(watched_cells, [mark for _, mark in declared])), indirect=True)


def unused(config: pytest.Config) -> list[str]:
    """Return a sentence for every mark of a known deficiency on a class or module that matches no cell of any test there."""
    declared = config.stash.get(_KNOWN, {}).values()
    return [f"{node.nodeid}: {_asked(mark)} matches no cell of any of its tests" for node, mark, used in declared if not used]


def _nearest(definition: pytest.Function) -> list[pytest.Mark]:
    found = list(definition.iter_markers_with_node("rvads_scenario"))
    return [mark for node, mark in found if node is found[0][0]]


def _distinct(cells: Iterable[Cell]) -> list[Cell]:
    """Return each cell once; refuse cells that differ only in what is not part of their id."""
    seen: dict[str, Cell] = {}
    for cell in cells:
        known = seen.setdefault(cell.id, cell)
        if known is not cell and known != cell:
            raise ScenarioError(
                f"two different scenarios have the id {cell.id!r}: they differ in duration, aggression, wait or map, which ids "
                "do not tell; put them into two tests"
            )
    return list(seen.values())


def _in_use(declared: Sequence[pytest.Mark], cells: Sequence[Cell]) -> None:
    """Refuse a mark of a known deficiency that matches no cell of the test it stands on."""
    for mark in declared:
        if not any(_known(mark, cell.keys) for cell in cells):
            raise ScenarioError(f"{_asked(mark)} matches none of the {len(cells)} cells of this test")


def _note(config: pytest.Config, declared: Sequence[tuple[Any, pytest.Mark]], cells: Sequence[Cell]) -> None:
    """Note which marks of known deficiencies a test has made use of; those of classes and modules serve several tests."""
    known = config.stash.setdefault(_KNOWN, {})
    for node, mark in declared:
        used = any(_known(mark, cell.keys) for cell in cells) or known.get(id(mark), (node, mark, False))[2]
        known[id(mark)] = node, mark, used


def _asked(mark: pytest.Mark) -> str:
    where = "".join(f", {k}={v!r}" for k, v in mark.kwargs.items() if k != "reason")
    return f"@rvads.known({mark.args[0]!r}{where})"


def _known(mark: pytest.Mark, keys: Mapping[str, str | int]) -> bool:
    return all(keys.get(key) in values for key, values in mark.kwargs.items() if key != "reason")


def _params(cells: Iterable[Cell], declared: Sequence[pytest.Mark]) -> Iterator[Any]:
    """Yield a parameter per cell, with one mark to select it by and the xfail of every known deficiency it has."""
    select = pytest.mark.rvads
    for cell in cells:
        marks = [select.with_args(**cell.keys)]
        for mark in declared:
            if _known(mark, cell.keys):
                reason = ": ".join(filter(None, (mark.args[0], mark.kwargs["reason"])))
                marks.append(pytest.mark.xfail(strict=True, raises=(RuleViolation, OpenObligation), reason=reason))
        yield pytest.param(cell, id=cell.id, marks=marks)


def _cells(mark: pytest.Mark, metafunc: pytest.Metafunc, options: Options) -> Iterator[Cell]:
    from pytest_rvads.junctions.finder import find
    from pytest_rvads.logic.rules.rule import Rule, rules_for
    from pytest_rvads.scenarios.selection import Selection

    ask = mark.kwargs
    added = extensions(metafunc.config, options.rules)
    file, place = _map_file(ask["junction"], ask["map"], metafunc, options), ask["junction"]
    if ask["map"] is None and place in added.junctions:
        file, place = added.junctions[place]
    junction = find(place, file)
    configurations, left_out = _configurations(ask, junction, options, added.grids, metafunc.config)
    selection = Selection.of(
        junction,
        configurations,
        classes=_several("classes", ask["classes"], int, "class numbers"),
        scenarios=_several("scenarios", ask["scenarios"], str, "direction strings such as '1133'"),
        cover=options.cover if ask["cover"] is None else ask["cover"],
        duration=ask["duration"],
        aggression=ask["aggression"],
        wait=ask["wait"],
        subject=ask["subject"],
        senses=_senses(ask["senses"]),
    )
    policies = _policies(ask["subject"], ask["traffic"])
    requirements = _several("requirement", ask["requirement"], str, "identifiers of requirements")
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
    rows, points = selection.count(), len(selection.configurations) * len(selection.senses)
    total = rows * points * len(policies) * len(rules)
    if total > options.max_items:
        among = f" × {len(policies)} kinds of traffic" if len(policies) > 1 else ""
        raise ScenarioError(
            f"would expand to {total:,} items ({rows:,} scenarios × {points} points{among} × {len(rules)} rules): "
            "narrow the grid, use --rvads-cover=class, or raise --rvads-max-items"
        )
    for scenario in selection:
        scenario.fit()
        yield from cells_of(scenario, policies, rules, requirements or ())
    if left_out:
        dropped = metafunc.config.stash.setdefault(LEFT_OUT, {})
        dropped[metafunc.definition.nodeid] = dropped.get(metafunc.definition.nodeid, 0) + left_out


def _senses(asked: Any) -> tuple[Senses, ...]:
    """Return the senses to run with, one after the other."""
    from pytest_rvads.scenarios.senses import IDEAL, Senses

    if isinstance(asked, Mapping):
        return Senses.grid(asked)
    found = _several("senses", asked, Senses, "rvads.Senses(...) or a dict of their fields")
    return (IDEAL,) if found is None else found


def _policies(subject: int | str | None, traffic: Any) -> tuple[Policy | None, ...]:
    """Return the traffic policies to run among, or None alone without a subject."""
    from pytest_rvads.drivers.traffic import Policy

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


def _map_file(junction: str, map: str | None, metafunc: pytest.Metafunc, options: Options) -> str | None:
    from pytest_rvads.junctions.builtin import LAYOUTS

    if map is None:
        return None if junction in LAYOUTS else options.map
    beside = metafunc.definition.path.parent / map
    return str((beside if beside.exists() else Path(map)).resolve())


def _configurations(
    ask: Mapping[str, Any], junction: Junction, options: Options, grids: Mapping[str, tuple[Any, Any]], config: pytest.Config
) -> tuple[tuple[Configuration, ...], int]:
    """Return the points to run, and how many were left out because nobody could stop there."""
    from pytest_rvads.scenarios.configurations import explicit, grid, outside

    ways = junction.ways
    if ask["distances"] is None and ask["speeds"] is None:
        names = (
            _several(
                "grid", options.grid if ask["grid"] is None else ask["grid"], str, "letters of configurations or names of grids"
            )
            or ()
        )
        letters = [name for name in names if name not in grids]
        points = grid(letters, ways, junction.control) if letters else ()
        own = [point for name in names if name in grids for point in explicit(*grids[name], ways)]
    elif ask["grid"] is not None or ask["distances"] is None:
        raise ScenarioError("give either grid=, or distances= with speeds=")
    else:
        points, own = (), list(explicit(ask["distances"], 0.0 if ask["speeds"] is None else ask["speeds"], ways))
    if ask["probe"] or not own:
        return tuple(dict.fromkeys((*points, *own))), 0
    from pytest_rvads.simulators.simulator import named

    simulator = named(options.simulator)
    watched_points = watched(config, "v(d)max of point", own, _POINTS)
    kept = [p for p in watched_points if outside(p, lambda distance: simulator.vmax(distance, ask["aggression"])) is None]
    if not kept and not points:
        values = (
            f"distances={ask['distances']!r}, speeds={ask['speeds']!r}" if ask["distances"] is not None else f"grid={names!r}"
        )
        raise ScenarioError(
            f"every point of {values} is too fast to stop before the line "
            "(`rvads braking` lists v(d)max): lower the speeds, or say probe=True to run them all the same"
        )
    return tuple(dict.fromkeys((*points, *kept))), len(own) - len(kept)

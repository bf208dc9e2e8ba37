"""Expands the marks of tests into test items when pytest collects the tests.

A test item gives one verdict on an abstract scenario, a configuration and a rule. Of all values, the rule changes fastest
from item to item, so that the items of one run follow each other.

A parameter of an item is a `Cell`; the run is simulated when the item runs. A map is read once per process. The map must be known
at collection, so the path of the map comes from ``map=``, ``--rvads-map``, RVADS_MAP or the ini setting ``rvads_map``, in this
order. The fixture ``rvads_map`` returns only the path.

If a mark selects several junctions, junctions without a fitting scenario are left out, and every output counts the left-out
junctions, with the reason. A mark without a scenario at any junction is refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Sized
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import pytest

from pytest_rvads.session.collection.cells import Cell, Known, PlannedRun, RecordedCell, Resolved, Runs
from pytest_rvads.session.collection.extensions import extensions
from pytest_rvads.session.collection.misuse import told_at
from pytest_rvads.session.options import NAMED
from pytest_rvads.session.plan import PLAN
from pytest_rvads.support.errors import OpenObligation, RuleViolation, ScenarioError

if TYPE_CHECKING:
    from pytest_rvads.session.collection.ask import Ask
    from pytest_rvads.session.collection.extensions import Extensions
    from pytest_rvads.session.collection.marks import OpenFiles
    from pytest_rvads.session.options import Options

T = TypeVar("T")
C = TypeVar("C", Cell, RecordedCell)
_POINTS, _RUNS, _CELLS, _FILES = 10, 5000, 5000, 100
"""Least numbers of things for which a terminal shows the progress: points of a grid, runs to draw from, cells, files."""
FILES: pytest.StashKey[OpenFiles] = pytest.StashKey()
"""The files of recorded runs that were read last, for the whole session."""
_DRIVING = ("rvads_sut", "rvads_autopilot", "rvads_vehicle", "rvads_simulator")
"""Fixtures that only simulated runs need; in test items of recorded runs these fixtures are None."""
_CROSSED = "with scenarios left out in which a pedestrian would have crossed before the run begins"
"""The message on tests for which `Unfit.crossed` is not 0."""
_KNOWN: pytest.StashKey[dict[Known, tuple[str, bool]]] = pytest.StashKey()
"""By known deficiency, the id of the node with its mark, and whether the deficiency matches a test item."""


def expand(metafunc: pytest.Metafunc, options: Options) -> None:
    """Expand a test into an item per run and rule that its marks ``@rvads.scenario`` select.

    Only the nearest marks count: the marks of the function; without these, of the class; without both, of the module.
    """
    __tracebackhide__ = True
    from pytest_rvads.session.collection.ask import Ask

    test = metafunc.definition
    asks = _nearest(test, "scenario", Ask)
    takes_recorded = "rvads_recorded" in metafunc.fixturenames
    if not asks:
        mark = "recorded" if takes_recorded else "scenario"
        which = f"no @rvads.{mark}(...) says which: add the mark"
        raise pytest.Collector.CollectError(f"{_line(test)}: {test.nodeid} asks for a run, but {which}")
    if takes_recorded:
        why = "has @rvads.scenario(...) but takes rvads_recorded, a run that nobody simulated: take run instead"
        raise pytest.Collector.CollectError(f"{asks[0].place}: {test.nodeid} {why}")
    added = _extensions(metafunc, asks[0].place, "scenario", options)
    resolved: list[Resolved] = []
    for ask in asks:
        with told_at(f"{ask.place}: {test.nodeid}"):
            resolved += _resolve(ask, test, options, added, _takes_rule(metafunc, ask.rules))
    cells: dict[str, Cell] = {}
    for run in _planned_runs(resolved, test, options):
        with told_at(f"{run.resolved.mark}: {test.nodeid}"):
            for cell in run.cells():
                _add(cell, cells)
    _parametrize(metafunc, list(cells.values()), ())


def expand_recorded(metafunc: pytest.Metafunc, options: Options) -> None:
    """Expand a test into an item per recorded run and rule of its marks; the fixtures of driver and simulator are not set up."""
    __tracebackhide__ = True
    from pytest_rvads.session.collection.marks import OpenFiles, Recordings

    test = metafunc.definition
    asks = _nearest(test, "recorded", Recordings)
    if next(test.iter_markers("rvads_scenario"), None):
        why = "has @rvads.recorded(...) and @rvads.scenario(...), but a run is one or the other: make two tests of it"
        raise pytest.Collector.CollectError(f"{asks[0].place}: {test.nodeid} {why}")
    _extensions(metafunc, asks[0].place, "recorded", options)
    opened = metafunc.config.stash.setdefault(FILES, OpenFiles(options.speed_limit))
    cells: dict[str, RecordedCell] = {}
    for ask in asks:
        with told_at(f"{ask.place}: {test.nodeid}"):
            takes_rule, files = _takes_rule(metafunc, ask.rules), ask.files(test.path.parent)
            watch = _watched(metafunc.config, f"files of {metafunc.function.__name__}", list(files.items()), _FILES)
            for count, cell in enumerate(ask.cells(watch, opened, takes_rule)):
                if count >= options.max_items:
                    raise ScenarioError(
                        f"would expand to more than {options.max_items:,} items in {len(files):,} files: narrow the patterns, "
                        "ask for fewer rules, or raise --rvads-max-items"
                    )
                _add(cell, cells)
    _parametrize(metafunc, list(cells.values()), [name for name in _DRIVING if name in metafunc.fixturenames])


def idle(item: pytest.Item) -> None:
    """Note the marks ``@rvads.known`` of a test that has no items from marks, so that these marks are reported as unused."""
    noted = item.config.stash.setdefault(_KNOWN, {})
    for node, mark in item.iter_markers_with_node("rvads_known"):
        for deficiency in mark.args:
            if isinstance(deficiency, Known):
                noted.setdefault(deficiency, (node.nodeid, False))


def unused(config: pytest.Config) -> list[str]:
    """Return a sentence for every mark ``@rvads.known`` that matches no item of the marked tests."""
    noted = config.stash.get(_KNOWN, {}).items()
    return [f"{k.place}: {node}: {k} matches no cell of any of its tests" for k, (node, used) in noted if not used]


def _marks(test: pytest.Function, name: str, kind: type[T]) -> list[tuple[Any, T]]:
    """Return the arguments of the marks of a test, the nearest mark first, each with the node of the mark."""
    marks = list(test.iter_markers_with_node(f"rvads_{name}"))
    if not all(len(mark.args) == 1 and isinstance(mark.args[0], kind) for _, mark in marks):
        why = f"write @rvads.{name}(...) instead of pytest.mark.rvads_{name}(...)"
        raise pytest.Collector.CollectError(f"{_line(test)}: {test.nodeid}: {why}")
    return [(node, mark.args[0]) for node, mark in marks]


def _nearest(test: pytest.Function, name: str, kind: type[T]) -> list[T]:
    """Return the arguments of the marks at the nearest node with marks."""
    marks = _marks(test, name, kind)
    return [arguments for node, arguments in marks if node is marks[0][0]]


def _extensions(metafunc: pytest.Metafunc, place: str, mark: str, options: Options) -> Extensions:
    """Register the rules of users, which marks can name, and return their junctions and grids.

    Raise a `CollectError` for a test that has a mark and does not use the run of the mark.
    """
    __tracebackhide__ = True
    test = metafunc.definition
    if "rvads_run" not in metafunc.fixturenames:
        why = "takes neither run nor monitor: add an argument"
        if "run" in metafunc.fixturenames:
            why = "its `run` is a fixture of yours: rename your fixture"
        raise pytest.Collector.CollectError(f"{place}: {test.nodeid} has @rvads.{mark}(...) but {why}")
    for parametrized in test.iter_markers("parametrize"):
        names = parametrized.args[0] if parametrized.args else parametrized.kwargs["argnames"]
        if "run" in (name.strip() for name in (names.split(",") if isinstance(names, str) else names)):
            why = f"has @rvads.{mark}(...), which gives it its `run`: parametrize another argument"
            raise pytest.Collector.CollectError(f"{place}: {test.nodeid} {why}")
    with told_at(test.nodeid):
        return extensions(metafunc.config, options.rules)


def _line(test: pytest.Function) -> str:
    """Return file and line of a test without a mark."""
    file, line, _ = test.location
    return f"{file}:{(line or 0) + 1}"


def _takes_rule(metafunc: pytest.Metafunc, rules: object) -> bool:
    """Return whether a test runs over rules; raise a `ScenarioError` if it has ``rules=`` and no argument ``rule``."""
    takes_rule = "rule" in metafunc.fixturenames
    if rules and not takes_rule:
        raise ScenarioError("rules= is what the argument `rule` of a test runs over: add that argument, or leave rules= out")
    return takes_rule


def _add(cell: C, cells: dict[str, C]) -> None:
    """Add a cell to the cells of a test unless the cell was added before; raise a `ScenarioError` if another cell has its id."""
    first = cells.setdefault(cell.id, cell)
    if first is cell or first == cell:
        return
    if isinstance(cell, RecordedCell) and isinstance(first, RecordedCell):
        raise ScenarioError(
            f"{first.path} and {cell.path} would both be called {cell.run!r} in ids: rename one of them, or make two tests"
        )
    raise ScenarioError(
        f"two different scenarios have the id {cell.id!r}: they differ in duration, aggression, wait or map, which ids "
        "do not tell; put them into two tests"
    )


def _parametrize(metafunc: pytest.Metafunc, cells: Sequence[Cell | RecordedCell], unused: Sequence[str]) -> None:
    """Give a test its cells, with a mark for ``-m`` and an xfail for every known deficiency; `unused` fixtures are None.

    A deficiency on the test function that matches none of its items is refused. If only a sample of the items runs, no deficiency
    is refused, because the sample can lack the failing items.
    """
    test, config = metafunc.definition, metafunc.config
    noted = config.stash.setdefault(_KNOWN, {})
    sampled = any(drawn.test == test.nodeid for drawn in config.stash[PLAN].drawn)
    known = _marks(test, "known", Known)
    for node, deficiency in known:
        used = sampled or any(map(deficiency.matches, cells))
        if not used and node is test:
            with told_at(f"{deficiency.place}: {node.nodeid}"):
                raise ScenarioError(f"{deficiency} matches none of the {len(cells)} cells of this test")
        noted[deficiency] = node.nodeid, used or noted.get(deficiency, ("", False))[1]
    params = []
    for cell in _watched(config, f"items of {metafunc.function.__name__}", cells, _CELLS):
        marks = [pytest.mark.rvads.with_args(**cell.keys)]
        for _, deficiency in known:
            if deficiency.matches(cell):
                reason = ": ".join(filter(None, (deficiency.name, deficiency.reason)))
                marks.append(pytest.mark.xfail(strict=True, raises=(RuleViolation, OpenObligation), reason=reason))
        params.append(pytest.param(cell, *[None] * len(unused), id=cell.id, marks=marks))
    metafunc.parametrize(("rvads_cell", *unused), params, indirect=["rvads_cell"])


def _resolve(ask: Ask, test: pytest.Function, options: Options, added: Extensions, takes_rule: bool) -> tuple[Resolved, ...]:
    """Return the runs and rules that one mark of a test selects at each junction, and note left-out junctions and starts."""
    from pytest_rvads.report.session_report import Drawn
    from pytest_rvads.scenarios.selection import TOO_SHORT, TOO_TIGHT, extended

    plan = test.config.stash[PLAN]
    progress = partial(_watched, test.config, "v(d)max of point", least=_POINTS)
    selected = ask.resolve(test.path.parent, options, added, progress, takes_rule, test.config.stash[NAMED])
    if options.sample is None:
        _refuse_many(selected.resolved, options)
    for resolved in selected.resolved:
        if resolved.selection.left_out:
            plan.left_out[test.nodeid] = plan.left_out.get(test.nodeid, 0) + resolved.selection.left_out
        plan.extents = extended(plan.extents, resolved.selection)
    bends = [(name, TOO_TIGHT) for resolved in selected.resolved for name in resolved.selection.too_tight]
    too_short = [(resolved.selection.place.name, TOO_SHORT) for resolved in selected.resolved if resolved.selection.too_short]
    for name, reason in (*selected.left_out, *bends, *too_short):
        plan.refused.setdefault(reason, {})[name] = None
    if selected.passed_over:
        count = len(selected.resolved)
        plan.drawn[Drawn(test.nodeid, "junctions", count, count + selected.passed_over, options.seed)] = None
    return selected.resolved


def _planned_runs(resolved: Sequence[Resolved], test: pytest.Function, options: Options) -> Iterator[PlannedRun]:
    """Yield the runs of a test, or a sample of these runs, and note how many runs and scenarios are left out."""
    from pytest_rvads.report.session_report import Drawn

    plan = test.config.stash[PLAN]
    most = sum(at_junction.runs for at_junction in resolved) if options.sample else 0
    watch = partial(_watched, test.config, f"runs of {test.originalname} to draw from", least=_RUNS, most=most)
    runs = Runs(resolved, test.nodeid, watch)
    if options.sample is None:
        yield from runs
    else:
        drawn = runs.drawn(options.sample, options.seed)
        items = sum(len(run.resolved.rules) for run in drawn)
        if items > options.max_items:
            with told_at(f"{resolved[0].mark}: {test.nodeid}"):
                raise ScenarioError(
                    f"would expand to {items:,} items ({len(drawn):,} runs drawn): lower --rvads-sample, ask for fewer rules, or "
                    "raise --rvads-max-items"
                )
        if len(drawn) < runs.total:
            plan.drawn[Drawn(test.nodeid, "runs", len(drawn), runs.total, options.seed)] = None
        yield from drawn
    if runs.unfit.count:
        plan.unfit[test.nodeid] = plan.unfit.get(test.nodeid, 0) + runs.unfit.count
    if runs.unfit.crossed:
        plan.refused.setdefault(_CROSSED, {})[f"{runs.unfit.crossed} of {test.nodeid}"] = None


def _refuse_many(marks: Sequence[Resolved], options: Options) -> None:
    """Raise a `ScenarioError` for a mark that would give more items than `Options.max_items`."""
    total = sum(resolved.runs * len(resolved.rules) for resolved in marks)
    if total <= options.max_items:
        return
    first = marks[0]
    rows, points = first.selection.count(), first.selection.points
    among = f" × {len(first.traffic)} kinds of traffic" if len(first.traffic) > 1 else ""
    walks = first.selection.walks
    walking = f" × {walks} pedestrians" if first.selection.pedestrians else ""
    factors = f"({rows // max(walks, 1):,} scenarios{walking} × {points} points{among} × {len(first.rules)} rules)"
    most = f"up to {total:,}" if walking else f"{total:,}"
    raise ScenarioError(
        f"would expand to {most} items {factors if len(marks) == 1 else f'at {len(marks):,} junctions'}: "
        "narrow the grid, use --rvads-cover=class, run some of them by --rvads-sample, or raise --rvads-max-items"
    )


def _watched(config: pytest.Config, what: str, things: Iterable[T], least: int, most: int = 0) -> Iterator[T]:
    """Yield the given things one by one; on a terminal, show the number of yielded things in a line that is overwritten."""
    reporter: Any = config.pluginmanager.get_plugin("terminalreporter")
    capture: Any = config.pluginmanager.get_plugin("capturemanager")
    shown = reporter is not None and reporter.isatty and reporter.verbosity >= 0 and not hasattr(config, "workerinput")
    total = len(things) if isinstance(things, Sized) else most
    for done, thing in enumerate(things):
        if shown and total >= least and done % max(1, total // 100) == 0:
            with capture.global_and_fixture_disabled() if capture else nullcontext():
                reporter.rewrite(f"rvads: {what} {done:,}/{total:,}", erase=True)
        yield thing

"""The expansion of marks into test items at collection.

An item is one verdict: abstract scenario x configuration x rule. The rule is the innermost axis, so that the items of one run
follow each other.

A parameter of an item is a `Cell`; the run is simulated when the item runs. A map is read once per process. The map must be known
at collection, so it comes from ``map=``, ``--rvads-map``, RVADS_MAP or the ini setting ``rvads_map``, in this order. The fixture
``rvads_map`` returns only the path.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import pytest

from pytest_rvads.session.collection.cells import Cell, Known, RecordedCell
from pytest_rvads.session.collection.extensions import extensions
from pytest_rvads.session.collection.misuse import told_at
from pytest_rvads.session.collection.planned import DRAWN, planned_runs, resolve, watched
from pytest_rvads.support.errors import OpenObligation, RuleViolation, ScenarioError

if TYPE_CHECKING:
    from pytest_rvads.session.collection.ask import Ask
    from pytest_rvads.session.collection.recordings import OpenFiles, Recordings
    from pytest_rvads.session.collection.resolved import Resolved
    from pytest_rvads.session.options import Options

__all__ = ["FILES", "expand", "expand_recorded", "idle", "is_recorded", "unused"]

T = TypeVar("T")
C = TypeVar("C", Cell, RecordedCell)
_CELLS, _FILES = 5000, 100
"""Least numbers of cells and of files for which a terminal shows the progress of the collection."""
FILES: pytest.StashKey[OpenFiles] = pytest.StashKey()
"""The files of recorded runs that were read last, for the whole session."""
_DRIVING = ("rvads_sut", "rvads_autopilot", "rvads_vehicle", "rvads_simulator")
"""Fixtures of simulated runs; in items of recorded runs they are None."""
_KNOWN: pytest.StashKey[dict[Known, tuple[str, bool]]] = pytest.StashKey()
"""Known deficiency to the id of the node with its mark, and to whether the deficiency matches a cell."""


def expand(metafunc: pytest.Metafunc, options: Options) -> None:
    """Parametrize a test over the cells of its marks.

    Only the nearest marks count: the marks of the function, else of the class, else of the module.

    Raises:
        Misuse: a mark can't be expanded.
    """
    from pytest_rvads.session.collection.ask import Ask

    test = metafunc.definition
    asks, known = _nearest(test, "scenario", Ask), _marks(test, "known", Known)
    with told_at(_checked_id(metafunc, asks)):
        added = extensions(metafunc.config, options.rules)
    resolved: list[Resolved] = []
    for ask in asks:
        with told_at(f"{ask.place}: {test.nodeid}"):
            resolved += resolve(ask, test, options, added, _takes_rule(metafunc, ask.rules))
    cells: dict[str, Cell] = {}
    for run in planned_runs(resolved, test, options):
        with told_at(f"{run.resolved.mark}: {test.nodeid}"):
            for cell in run.cells():
                _add(cell, cells)
    _note_known(known, metafunc, cells.values())
    items = watched(metafunc.config, f"items of {metafunc.function.__name__}", list(cells.values()), _CELLS)
    metafunc.parametrize("rvads_cell", list(_params(items, [k for _, k in known])), indirect=True)


def expand_recorded(metafunc: pytest.Metafunc, options: Options) -> None:
    """Parametrize a test over the recorded runs of its marks; the fixtures of driver and simulator are not set up.

    Raises:
        Misuse: a mark can't be expanded.
    """
    from pytest_rvads.session.collection.recordings import OpenFiles, Recordings

    test = metafunc.definition
    asks, known = _nearest(test, "recorded", Recordings), _marks(test, "known", Known)
    if next(test.iter_markers("rvads_scenario"), None):
        why = "has @rvads.recorded(...) and @rvads.scenario(...), but a run is one or the other: make two tests of it"
        raise pytest.Collector.CollectError(f"{asks[0].place}: {test.nodeid} {why}")
    _check_takes_run(metafunc, asks[0].place, "recorded")
    with told_at(test.nodeid):
        extensions(metafunc.config, options.rules)  # the rules of users must be known by name
    opened = metafunc.config.stash.setdefault(FILES, OpenFiles(options.speed_limit))
    cells: dict[str, RecordedCell] = {}
    for ask in asks:
        with told_at(f"{ask.place}: {test.nodeid}"):
            for cell in _recorded_cells(ask, metafunc, options, opened):
                _add(cell, cells)
    _note_known(known, metafunc, cells.values())
    unused = [name for name in _DRIVING if name in metafunc.fixturenames]
    params = _params(cells.values(), [k for _, k in known], [None] * len(unused))
    metafunc.parametrize(("rvads_cell", *unused), list(params), indirect=["rvads_cell"])


def is_recorded(item: pytest.Item) -> bool:
    """Return whether an item judges a recorded run."""
    return item.get_closest_marker("rvads_recorded") is not None


def idle(item: pytest.Item) -> None:
    """Note the known deficiencies of a test without cells, which therefore match no cell."""
    noted = item.config.stash.setdefault(_KNOWN, {})
    for node, mark in item.iter_markers_with_node("rvads_known"):
        for deficiency in mark.args:
            if isinstance(deficiency, Known):
                noted.setdefault(deficiency, (node.nodeid, False))


def unused(config: pytest.Config) -> list[str]:
    """Return a sentence for every mark `known` that matches no item of the marked tests."""
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


def _checked_id(metafunc: pytest.Metafunc, asks: Sequence[Ask]) -> str:
    """Return the id of a test; raise a `CollectError` if the test lacks the mark or an argument."""
    test = metafunc.definition
    if not asks:
        which = "no @rvads.scenario(...) says which: add the mark"
        if "rvads_recorded" in metafunc.fixturenames:
            which = "no @rvads.recorded(...) says which: add the mark"
        raise pytest.Collector.CollectError(f"{_line(test)}: {test.nodeid} asks for a run, but {which}")
    if "rvads_recorded" in metafunc.fixturenames:
        why = "has @rvads.scenario(...) but takes rvads_recorded, a run that nobody simulated: take run instead"
        raise pytest.Collector.CollectError(f"{asks[0].place}: {test.nodeid} {why}")
    _check_takes_run(metafunc, asks[0].place, "scenario")
    return test.nodeid


def _check_takes_run(metafunc: pytest.Metafunc, place: str, mark: str) -> None:
    """Raise a `CollectError` for a test that has a mark and does not get its run by the mark."""
    test = metafunc.definition
    if "rvads_run" not in metafunc.fixturenames:
        why = "takes neither run nor monitor: add an argument"
        if "run" in metafunc.fixturenames:
            why = "its `run` is a fixture of yours: rename your fixture"
        raise pytest.Collector.CollectError(f"{place}: {test.nodeid} has @rvads.{mark}(...) but {why}")
    if "run" in _parametrized_names(test):
        why = f"has @rvads.{mark}(...), which gives it its `run`: parametrize another argument"
        raise pytest.Collector.CollectError(f"{place}: {test.nodeid} {why}")


def _parametrized_names(test: pytest.Function) -> Iterator[str]:
    """Yield the names of the arguments that ``pytest.mark.parametrize`` gives a test."""
    for mark in test.iter_markers("parametrize"):
        names = mark.args[0] if mark.args else mark.kwargs["argnames"]
        yield from (name.strip() for name in (names.split(",") if isinstance(names, str) else names))


def _line(test: pytest.Function) -> str:
    """Return file and line of a test without a mark."""
    file, line, _ = test.location
    return f"{file}:{(line or 0) + 1}"


def _recorded_cells(ask: Recordings, metafunc: pytest.Metafunc, options: Options, opened: OpenFiles) -> Iterator[RecordedCell]:
    """Yield the cells of one mark ``@rvads.recorded``."""
    takes_rule = _takes_rule(metafunc, ask.rules)
    files = ask.files(metafunc.definition.path.parent)
    watch = watched(metafunc.config, f"files of {metafunc.function.__name__}", list(files.items()), _FILES)
    for count, cell in enumerate(ask.cells(watch, opened, takes_rule)):
        if count >= options.max_items:
            raise ScenarioError(
                f"would expand to more than {options.max_items:,} items in {len(files):,} files: narrow the patterns, ask for "
                "fewer rules, or raise --rvads-max-items"
            )
        yield cell


def _takes_rule(metafunc: pytest.Metafunc, rules: object) -> bool:
    """Return whether a test runs over rules; raise a `ScenarioError` if it has ``rules=`` and no argument ``rule``."""
    takes_rule = "rule" in metafunc.fixturenames
    if rules and not takes_rule:
        raise ScenarioError("rules= is what the argument `rule` of a test runs over: add that argument, or leave rules= out")
    return takes_rule


def _add(cell: C, cells: dict[str, C]) -> None:
    """Add a cell unless it is there; raise a `ScenarioError` if a different cell has the same id."""
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


def _note_known(
    known: Sequence[tuple[Any, Known]], metafunc: pytest.Metafunc, cells: Collection[Cell] | Collection[RecordedCell]
) -> None:
    """Note the known deficiencies of a test, and refuse a deficiency of the test itself that matches none of its cells.

    If only a sample of the cells runs, no deficiency is refused, because the sample may leave its cells out.
    """
    noted = metafunc.config.stash.setdefault(_KNOWN, {})
    sampled = any(drawn.test == metafunc.definition.nodeid for drawn in metafunc.config.stash.get(DRAWN, {}))
    for node, deficiency in known:
        used = sampled or any(map(deficiency.matches, cells))
        if not used and node is metafunc.definition:
            with told_at(f"{deficiency.place}: {node.nodeid}"):
                raise ScenarioError(f"{deficiency} matches none of the {len(cells)} cells of this test")
        noted[deficiency] = node.nodeid, used or noted.get(deficiency, ("", False))[1]


def _params(cells: Iterable[Cell | RecordedCell], known: Sequence[Known], more: Sequence[None] = ()) -> Iterator[Any]:
    """Yield a parameter per cell, with a mark to select the cell and an xfail for every known deficiency of the cell.

    Args:
        cells: cells of a test.
        known: known deficiencies of the test.
        more: values of further arguments.
    """
    select = pytest.mark.rvads
    for cell in cells:
        marks = [select.with_args(**cell.keys)]
        for deficiency in known:
            if deficiency.matches(cell):
                reason = ": ".join(filter(None, (deficiency.name, deficiency.reason)))
                marks.append(pytest.mark.xfail(strict=True, raises=(RuleViolation, OpenObligation), reason=reason))
        yield pytest.param(cell, *more, id=cell.id, marks=marks)

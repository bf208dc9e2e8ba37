"""The plan of a session: the cells (run and rule) of all collected tests, and the selected test items, before any item runs.

Coverage is a share of the planned cells. The plan has a record of every selected item, also of items that will not run. Under
xdist a worker sends the plan to the main process with its first report.

The collection of tests notes in the plan what it leaves out. For users without tests, the tests that come with the plugin (folder
``suite``) are collected: ``pytest --rvads-sut ./stack``.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from sys import intern
from typing import TYPE_CHECKING, Any, cast

import pytest

if TYPE_CHECKING:
    from pytest_rvads.report.record import Record
    from pytest_rvads.report.session_report import Cell, Drawn, Extent
    from pytest_rvads.session.collection.cells import Cell as Parameter
    from pytest_rvads.session.collection.cells import RecordedCell

_SUITE = Path(__file__).parent / "suite"
"""Folder of the tests that come with the plugin."""
_WIRE = "rvads_plan"
"""Attribute of a worker's first report, or key of its output, that carries the plan to the main process."""


@dataclass(slots=True)
class Plan:
    """The cells that the collected tests ask for, the test items that were selected to run, and what collection noted."""

    cells: dict[Cell, None] = field(default_factory=dict)
    """The planned cells, before ``-k`` and ``-m`` deselect any, in the order of collection; the values are not used."""
    items: dict[str, Record] = field(default_factory=dict)
    """By node id of a selected test item, its record, as known before the item runs."""
    deselected: set[str] = field(default_factory=set)
    vanished: dict[str, Record] = field(default_factory=dict)
    """By node id of a test item that a plugin dropped without `pytest_deselected`, its record, as known before the item runs."""
    files: set[str] = field(default_factory=set)
    """Every file from which pytest collected an item, of this plugin or not."""
    left_out: dict[str, int] = field(default_factory=dict)
    """By node id of a test, the number of points of its grid that were left out: too fast to stop, beyond v(d)max."""
    unfit: dict[str, int] = field(default_factory=dict)
    """By node id of a test, the number of scenarios that were left out, because a vehicle has no room at its start."""
    extents: dict[str, Extent] = field(default_factory=dict)
    """By junction, its numbers of classes and pairs, if the number of arms does not determine these numbers."""
    refused: dict[str, dict[str, None]] = field(default_factory=dict)
    """By reason for leaving junctions out, or for running other starts than requested, the names of the junctions."""
    drawn: dict[Drawn, None] = field(default_factory=dict)
    """Tests that run only a sample of their runs, with the size of the sample."""

    def pack(self) -> str:
        """Return the plan as one string of JSON."""
        of_all_tests = sorted(self.deselected), sorted(self.files), self.left_out, self.unfit
        if not self.cells:  # msgspec is not imported in a session without items of this plugin
            return json.dumps([[], [], [], *of_all_tests, {}, {}, []])
        from pytest_rvads.support.decoding import encode

        records = map(list, (self.items.values(), self.vanished.values()))
        return encode([list(self.cells), *records, *of_all_tests, self.extents, self.refused, list(self.drawn)]).decode()

    def unpack(self, text: str) -> None:
        """Add the values of a plan in JSON that a worker sent; all workers send the same plan."""
        cells, items, vanished, deselected, files, left_out, unfit, extents, refused, drawn = json.loads(text)
        if cells:
            from msgspec import convert

            from pytest_rvads.report.record import received
            from pytest_rvads.report.session_report import Drawn, Extent

            self.refused |= convert(refused, dict[str, dict[str, None]])
            self.drawn |= dict.fromkeys(convert(drawn, list[Drawn]))
            self.extents |= convert(extents, dict[str, Extent])
            self.cells |= {(*cell,): None for cell in cells}
            self.items |= {record.nodeid: record for record in map(received, items)}
            self.vanished |= {record.nodeid: record for record in map(received, vanished)}
        self.deselected |= set(deselected)
        self.files |= set(files)
        self.left_out |= left_out
        self.unfit |= unfit


PLAN: pytest.StashKey[Plan] = pytest.StashKey()


def in_part(config: pytest.Config) -> bool:
    """Return whether options or arguments of pytest select only parts of test files."""
    return bool(getattr(config.option, "lf", False)) or any("::" in argument for argument in config.args)


def start(item: pytest.Item) -> Record | None:
    """Return the record of a test item, as known before the item runs; None if the item does not belong to this plugin."""
    if not (isinstance(item, pytest.Function) and hasattr(item, "callspec") and "rvads_cell" in item.callspec.params):
        return None
    from pytest_rvads.report.record import planned_record

    cell = cast("Parameter | RecordedCell", item.callspec.params["rvads_cell"])
    keys = {**cell.start, "variant": _variant(item.callspec.id, list(item.callspec.params), cell.id)}
    return planned_record(item.nodeid, item.location[1] or 0, item.originalname, keys, cell.ways, cell.requirements)


def _variant(whole: str, names: Sequence[str], cell: str) -> str:
    """Return the values of the parameters of a test item other than the cell, as the id of the item names the values."""
    whole, part = f"-{whole}-", f"-{cell}-"
    # The id of another parameter can contain the id of the cell; the cell is the first or the last parameter.
    at = whole.rfind(part) if names[-1] == "rvads_cell" else whole.find(part)
    return ", ".join(filter(None, (whole[1:at], whole[at + len(part) : -1])))


class Planner:
    """Makes the plan in every process that collects tests, and sends the plan from an xdist worker to the main process."""

    def __init__(self, config: pytest.Config) -> None:
        self._plan = config.stash[PLAN] = Plan()
        self._config = config
        self._collected: list[pytest.Item] = []
        self._selected: list[pytest.Item] = []
        self._deselected: set[str] = set()
        """Node ids of items that were deselected with the hook `pytest_deselected`."""
        self._unsent = hasattr(config, "workerinput")
        self._ids = 0
        """Number of all items that a worker has collected."""

    def plan(self) -> Plan:
        """Return the plan, after adding the items that were collected since the last call."""
        starts = {item.nodeid: record for item in self._collected if (record := start(item))}
        if starts:
            from pytest_rvads.report.session_report import cell_of

            self._plan.cells |= dict.fromkeys(map(cell_of, starts.values()))
        self._plan.items |= {item.nodeid: starts[item.nodeid] for item in self._selected if item.nodeid in starts}
        deselected = starts.keys() - self._plan.items.keys()
        self._plan.deselected |= deselected
        self._plan.vanished |= {nodeid: starts[nodeid] for nodeid in starts if nodeid in deselected - self._deselected}
        self._plan.files |= {_file(item.nodeid) for item in self._collected}
        self._collected, self._selected = [], []
        return self._plan

    def unplanned(self) -> int:
        """Return the number of test items that workers collected, if no worker sent its plan; 0 if a worker did."""
        return 0 if self.plan().files else self._ids

    def no_longer_exists(self, nodeid: str) -> bool:
        """Return whether a test item of an earlier session no longer exists.

        An item no longer exists if its file does not exist, or if its whole file was collected without the item, the item was not
        deselected, and its test does not draw a sample.
        """
        plan = self.plan()
        if nodeid in plan.deselected or nodeid.partition("[")[0] in {drawn.test for drawn in plan.drawn}:
            return False
        if not (self._config.rootpath / _file(nodeid)).exists():
            return True
        return _file(nodeid) in plan.files and not in_part(self._config)

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        """Note every test item before plugins can deselect or drop items."""
        self._collected.append(item)

    def pytest_deselected(self, items: list[pytest.Item]) -> None:
        """Note the test items that an option or a plugin deselects."""
        self._deselected |= {item.nodeid for item in items}

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Note the test items that are selected to run."""
        self._selected = session.items

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Send the plan with the first report of a worker, because the worker can crash later."""
        report = yield
        if self._unsent:
            setattr(report, _WIRE, self.plan().pack())
            self._unsent = False
        return report

    def pytest_sessionfinish(self) -> None:
        """Send the plan of a worker that ran no item."""
        if self._unsent:
            self._config.workeroutput[_WIRE] = self.plan().pack()  # type: ignore[attr-defined]

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> Generator[None, None, None]:
        """Take the plan from a worker's report before other plugins read the report, and drop values that are not read again."""
        if not hasattr(self._config, "workerinput") and hasattr(report, _WIRE):
            self._plan.unpack(report.__dict__.pop(_WIRE))
        try:
            return (yield)
        finally:
            if report.nodeid in self.plan().items:  # terminal reporters keep every report
                if report.passed and report.when != "call":
                    report.keywords, report.user_properties = {}, []
                if record := getattr(report, "rvads", None):
                    names = ("status", "message", "late")
                    report.rvads = {name: record[name] for name in names if name in record}  # type: ignore[attr-defined]
                    report.user_properties = [
                        (intern(name), intern(value) if isinstance(value, str) else value)
                        for name, value in report.user_properties
                    ]

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids: Sequence[str]) -> None:
        """Note the number of items that a worker collected, known before its first report."""
        self._ids = len(ids)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Take the plan of a worker that ran no item."""
        text = getattr(node, "workeroutput", {}).get(_WIRE)
        if text:
            self._plan.unpack(text)


def _file(nodeid: str) -> str:
    return nodeid.partition("::")[0]


def offer(config: pytest.Config) -> None:
    """Collect the bundled tests if pytest was started without arguments in a folder without test files.

    Ids of bundled tests among the arguments select these tests, if no file of the same name exists.
    """
    start = config.invocation_params.dir
    if config.args_source is config.ArgsSource.INVOCATION_DIR:
        patterns: list[str] = config.getini("python_files")
        if not any(next(start.rglob(pattern), None) for pattern in patterns):
            config.args[:] = [str(_SUITE)]
        return
    files = {argument.partition("::")[0] for argument in config.args}
    if files <= {path.name for path in _SUITE.glob("*.py")} and not any((start / file).exists() for file in files):
        # Pytest makes the ids relative to the folder of the suite only if that folder is the argument.
        config.pluginmanager.register(_Selected(tuple(config.args)), "rvads_named")
        config.args[:] = [str(_SUITE)]


class _Selected:
    """A plugin that deselects the bundled tests which the arguments of pytest do not name."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Deselect the bundled test items that no argument of pytest names."""
        named: dict[str, list[pytest.Item]] = {}
        for name in self._names:  # the id of a test item, of its test function or of its test file
            within = (f"{name}[", f"{name}::")
            named[name] = [item for item in items if item.nodeid == name or item.nodeid.startswith(within)]
        if missing := [name for name, matches in named.items() if not matches]:
            raise pytest.UsageError(f"not found: {missing[0]}, among the tests that come with the plugin")
        selected = {item for matches in named.values() for item in matches}
        config.hook.pytest_deselected(items=[item for item in items if item not in selected])
        items[:] = [item for item in items if item in selected]

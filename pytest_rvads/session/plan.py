"""What the tests of a session expand to, known before anything runs and also where workers do the collecting.

Because the plan is known, coverage is a share of what the tests ask for, and an item that did not run has a record, whatever
ended the session. A worker sends the plan with its first report.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from sys import intern
from typing import TYPE_CHECKING, Any, cast

import pytest

from pytest_rvads.collection.planned import DRAWN, EXTENTS, LEFT_OUT, REFUSED, UNFIT

if TYPE_CHECKING:
    from pytest_rvads.collection import Cell as Parameter
    from pytest_rvads.collection import RecordedCell
    from pytest_rvads.report.record import Record
    from pytest_rvads.report.session_report import Cell, Drawn, Extent

__all__ = ["Plan", "Planner", "in_part", "start"]

_WIRE = "rvads_plan"
"""Attribute of a worker's first report, or key of its output, that carries the plan to the main process."""


@dataclass(slots=True)
class Plan:
    """The cells that the collected tests ask for, and the items that were selected to run."""

    cells: dict[Cell, None] = field(default_factory=dict)
    """Before ``-k`` and ``-m`` deselect, in the order of collection."""
    items: dict[str, Record] = field(default_factory=dict)
    """Node id to the start of the record, of the selected items."""
    deselected: set[str] = field(default_factory=set)
    """Node ids of the other items."""
    vanished: dict[str, Record] = field(default_factory=dict)
    """Node ids of items that disappeared without `pytest_deselected`, with the beginnings of their records."""
    files: set[str] = field(default_factory=set)
    """Every file from which pytest collected an item, of this plugin or not."""
    left_out: dict[str, int] = field(default_factory=dict)
    """Test to how many points of its grid were left out, because nobody could stop there."""
    unfit: dict[str, int] = field(default_factory=dict)
    """Test to how many scenarios were left out because a vehicle has no room where it would start."""
    extents: dict[str, Extent] = field(default_factory=dict)
    """Junction to how much there is to cover, where its number of ways does not tell."""
    refused: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Why junctions are left out, to their names."""
    drawn: dict[Drawn, None] = field(default_factory=dict)
    """Tests that run only a sample of their runs, with the size of the sample."""

    def pack(self) -> str:
        """Return the plan as one string of JSON."""
        named = sorted(self.deselected), sorted(self.files), self.left_out, self.unfit
        if not self.cells:  # nothing of ours, so nothing more is loaded
            return json.dumps([[], [], [], *named, {}, {}, []])
        from pytest_rvads.decoding import encode

        ours = list(self.cells), *map(list, (self.items.values(), self.vanished.values()))
        return encode([*ours, *named, self.extents, self.refused, list(self.drawn)]).decode()

    def unpack(self, text: str) -> None:
        """Take in a packed plan; all workers send the same one."""
        cells, items, vanished, deselected, files, left_out, unfit, extents, refused, drawn = json.loads(text)
        if cells:
            from msgspec import convert

            from pytest_rvads.report.record import received
            from pytest_rvads.report.session_report import Drawn, Extent

            self.refused |= convert(refused, dict[str, tuple[str, ...]])
            self.drawn |= dict.fromkeys(convert(drawn, list[Drawn]))
            self.extents |= convert(extents, dict[str, Extent])
            self.cells |= {(*cell,): None for cell in cells}
            self.items |= {record.nodeid: record for record in map(received, items)}
            self.vanished |= {record.nodeid: record for record in map(received, vanished)}
        self.deselected |= set(deselected)
        self.files |= set(files)
        self.left_out |= left_out
        self.unfit |= unfit


def in_part(config: pytest.Config) -> bool:
    """Return whether the session collects only parts of files."""
    return bool(getattr(config.option, "lf", False)) or any("::" in argument for argument in config.args)


def start(item: pytest.Item) -> Record | None:
    """Return the start of an item's record, or None where the item is not ours."""
    if not (isinstance(item, pytest.Function) and hasattr(item, "callspec") and "rvads_cell" in item.callspec.params):
        return None
    from pytest_rvads.report.record import planned_record

    cell = cast("Parameter | RecordedCell", item.callspec.params["rvads_cell"])
    keys = {**cell.start, "variant": _variant(item.callspec.id, list(item.callspec.params), cell.id)}
    return planned_record(item.nodeid, item.location[1] or 0, item.originalname, keys, cell.ways, cell.requirements)


def _variant(whole: str, names: Sequence[str], cell: str) -> str:
    """Return the values of the other parameters of an item, as its id names them.

    Args:
        whole: what stands in brackets in its id: the ids of its parameters, joined by dashes, which may have some in themselves.
        names: its arguments, in that order.
        cell: the id of its cell.
    """
    whole, part = f"-{whole}-", f"-{cell}-"
    # An id of somebody else may hold that of the cell, too. At an end it is known which is which.
    at = whole.rfind(part) if names[-1] == "rvads_cell" else whole.find(part)
    return ", ".join(filter(None, (whole[1:at], whole[at + len(part) : -1])))


class Planner:
    """Notes the plan in every process that collects, and sends it from a worker to the main process."""

    def __init__(self, config: pytest.Config) -> None:
        self._plan = Plan()
        self._config = config
        self._collected: list[pytest.Item] = []
        self._selected: list[pytest.Item] = []
        self._told: set[str] = set()
        """Node ids of items that were deselected with the hook `pytest_deselected`."""
        self._unsent = hasattr(config, "workerinput")
        self._ids = 0
        """How many items a worker has collected, ours or not."""

    def plan(self) -> Plan:
        """Return the plan; it is put together when first asked for, so that collecting costs nothing more."""
        starts = {item.nodeid: record for item in self._collected if (record := start(item))}
        if starts:
            from pytest_rvads.report.session_report import cell_of

            self._plan.cells |= dict.fromkeys(map(cell_of, starts.values()))
        self._plan.items |= {item.nodeid: starts[item.nodeid] for item in self._selected if item.nodeid in starts}
        left = starts.keys() - self._plan.items.keys()
        self._plan.deselected |= left
        self._plan.vanished |= {nodeid: starts[nodeid] for nodeid in starts if nodeid in left - self._told}
        self._plan.files |= {_file(item.nodeid) for item in self._collected}
        stash = self._config.stash
        left_out: dict[str, int] = stash.setdefault(LEFT_OUT, {})
        unfit: dict[str, int] = stash.setdefault(UNFIT, {})
        extents: dict[str, Extent] = stash.setdefault(EXTENTS, {})
        self._plan.left_out |= left_out
        self._plan.unfit |= unfit
        self._plan.extents |= extents
        refused: dict[str, dict[str, None]] = stash.setdefault(REFUSED, {})
        drawn: dict[Drawn, None] = stash.setdefault(DRAWN, {})
        self._plan.refused |= {reason: tuple(names) for reason, names in refused.items()}
        self._plan.drawn |= drawn
        self._collected, self._selected = [], []
        return self._plan

    def unsaid(self) -> int:
        """Return how many items workers have collected, where none of them came to say what is planned; else 0."""
        return 0 if self.plan().files else self._ids

    def gone(self, nodeid: str) -> bool:
        """Tell whether an item that was not selected does not exist any more, as far as this session can tell.

        That is so when its file is not there, or was collected as a whole without giving the item, and none of its test is drawn.
        """
        plan = self.plan()
        if nodeid in plan.deselected or nodeid.partition("[")[0] in {drawn.test for drawn in plan.drawn}:
            return False
        if not (self._config.rootpath / _file(nodeid)).exists():
            return True
        return _file(nodeid) in plan.files and not in_part(self._config)

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        """Note every item, before anybody can deselect or drop it."""
        self._collected.append(item)

    def pytest_deselected(self, items: list[pytest.Item]) -> None:
        """Note what was deselected by an option, or by a plugin that says so."""
        self._told |= {item.nodeid for item in items}

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Note what was selected."""
        self._selected = session.items

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Send the plan with a worker's first report: what was planned is known whatever becomes of the worker."""
        report = yield
        if self._unsent:
            setattr(report, _WIRE, self.plan().pack())
            self._unsent = False
        return report

    def pytest_sessionfinish(self) -> None:
        """Send the plan of a worker that ran nothing."""
        if self._unsent:
            self._config.workeroutput[_WIRE] = self.plan().pack()  # type: ignore[attr-defined]

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> Generator[None, None, None]:
        """Take the plan off a worker's report in the main process, before anybody else reads it, and lighten it afterwards."""
        if not hasattr(self._config, "workerinput") and hasattr(report, _WIRE):
            self._plan.unpack(report.__dict__.pop(_WIRE))
        try:
            return (yield)
        finally:
            if report.nodeid in self.plan().items:
                _lighten(report)

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids: Sequence[str]) -> None:
        """Note how much a worker has collected: before its first report no more comes from it."""
        self._ids = len(ids)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Take the plan of a worker that ran nothing."""
        text = getattr(node, "workeroutput", {}).get(_WIRE)
        if text:
            self._plan.unpack(text)


def _lighten(report: pytest.TestReport) -> None:
    """Keep of an item's report what is asked of it at the end: terminals hold on to every one."""
    if report.passed and report.when != "call":
        report.keywords, report.user_properties = {}, []
    if record := getattr(report, "rvads", None):
        kept = ("status", "message", "late")
        report.rvads = {name: record[name] for name in kept if name in record}  # type: ignore[attr-defined]
        texts = [(intern(name), intern(value) if isinstance(value, str) else value) for name, value in report.user_properties]
        report.user_properties = texts


def _file(nodeid: str) -> str:
    return nodeid.partition("::")[0]

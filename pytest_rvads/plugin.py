"""The pytest plugin: hooks only, each delegating in a few lines.

It is imported by every pytest run of the environment, so it imports nothing heavy at top level.
"""

from __future__ import annotations

from collections.abc import Generator

import pytest

from pytest_rvads import hooks
from pytest_rvads.errors import RvadsError
from pytest_rvads.fixtures.budget import BUDGET, Budget
from pytest_rvads.fixtures.comparing import explain
from pytest_rvads.fixtures.items import OPTIONS, attach, letter, prepare
from pytest_rvads.fixtures.judging import monitor, rule
from pytest_rvads.fixtures.plan import Planner
from pytest_rvads.fixtures.running import run, rvads_cell, rvads_runs
from pytest_rvads.fixtures.session import Session
from pytest_rvads.fixtures.suite import offer
from pytest_rvads.fixtures.systems import rvads_autopilot, rvads_map, rvads_sut, rvads_vehicle
from pytest_rvads.options import Options, declare

__all__ = ["monitor", "rule", "run", "rvads_autopilot", "rvads_cell", "rvads_map", "rvads_runs", "rvads_sut", "rvads_vehicle"]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare ``--rvads-*`` and their ini twins."""
    declare(parser)


def pytest_addhooks(pluginmanager: pytest.PytestPluginManager) -> None:
    """Offer the hooks of users."""
    pluginmanager.add_hookspecs(hooks)


def pytest_configure(config: pytest.Config) -> None:
    """Read the options once and register the marks."""
    from pytest_rvads.collection import register_marks

    try:
        config.stash[OPTIONS] = Options.read(config)
    except RvadsError as error:
        raise pytest.UsageError(str(error)) from error
    register_marks(config)
    if config.stash[OPTIONS].sut:
        offer(config)
    seconds = config.stash[OPTIONS].time_budget
    config.stash[BUDGET] = None if seconds is None else Budget(config, seconds)
    if config.stash[BUDGET]:
        config.pluginmanager.register(config.stash[BUDGET], "rvads_budget")
    planner = Planner(config)
    config.pluginmanager.register(planner, "rvads_planner")
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Session(config, planner), "rvads_session")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Expand ``@rvads.scenario``."""
    if "rvads_cell" in metafunc.fixturenames or metafunc.definition.get_closest_marker("rvads_scenario"):
        from pytest_rvads.collection import expand

        expand(metafunc, metafunc.config.stash[OPTIONS])


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Refuse a mark on what can't be parametrized, so that it is not silently a plain test."""
    for item in items:
        if "rvads_cell" not in getattr(item, "fixturenames", ()) and item.get_closest_marker("rvads_scenario"):
            raise pytest.UsageError(
                f"{item.nodeid} has @rvads.scenario(...), which works on functions and classes of pytest only"
            )


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Give every item of ours a record, and keep those from starting that a time budget has no room for."""
    if prepare(item) and (budget := item.config.stash[BUDGET]):
        budget.spend()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Attach the record of the item to its report: explanation, properties, the place of an NA."""
    report = yield
    attach(item, call, report)
    return report


def pytest_assertrepr_compare(op: str, left: object, right: object) -> list[str] | None:
    """Say where two runs part and what two verdicts say."""
    return explain(op, left, right)


def pytest_report_teststatus(report: pytest.CollectReport | pytest.TestReport) -> tuple[str, str, str] | None:
    """Show NA and what came too late by letters of their own."""
    return letter(report)

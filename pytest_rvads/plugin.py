"""The pytest plugin: hooks only, each delegating in a few lines.

It is imported by every pytest run of the environment, so it imports nothing heavy at top level.

Only the modules of the plugin and the tests of simulators import pytest. Everything else works from a script or a notebook.
"""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import AbstractContextManager, ExitStack
from typing import TypeVar

import pytest

from pytest_rvads import hooks
from pytest_rvads.collection.books import open_book, open_session, outliving
from pytest_rvads.drivers.chosen import chosen
from pytest_rvads.errors import RvadsError
from pytest_rvads.fixtures.monitoring import monitor, rule, settle
from pytest_rvads.fixtures.running import run, rvads_cell, rvads_recorded, rvads_run, rvads_runs
from pytest_rvads.fixtures.systems import rvads_autopilot, rvads_map, rvads_simulator, rvads_sut, rvads_vehicle
from pytest_rvads.options import OPTIONS, Options, declare
from pytest_rvads.session.bundled import offer
from pytest_rvads.session.closing import Causes, Verdicts
from pytest_rvads.session.code import code_of_driver, code_of_simulator
from pytest_rvads.session.comparing import explain
from pytest_rvads.session.exports import check_library
from pytest_rvads.session.folder import FOLDER, SessionFolder
from pytest_rvads.session.interrupts import end_with_parent, heed
from pytest_rvads.session.items import RECORD, attach, letter, prepare
from pytest_rvads.session.limits import limits
from pytest_rvads.session.main_process import Session
from pytest_rvads.session.outputs import claim
from pytest_rvads.session.plan import Planner, in_part
from pytest_rvads.session.time_budget import BUDGET, Budget
from pytest_rvads.simulators.choice import Choice, choice, choosing
from pytest_rvads.wording import encode_all, one_line

__all__ = [
    "monitor",
    "rule",
    "run",
    "rvads_autopilot",
    "rvads_cell",
    "rvads_map",
    "rvads_recorded",
    "rvads_run",
    "rvads_runs",
    "rvads_simulator",
    "rvads_sut",
    "rvads_vehicle",
]

_T = TypeVar("_T")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare ``--rvads-*`` and their ini twins."""
    declare(parser)


def pytest_addhooks(pluginmanager: pytest.PytestPluginManager) -> None:
    """Offer the hooks of users."""
    pluginmanager.add_hookspecs(hooks)


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests(early_config: pytest.Config) -> None:
    """Open the session's own book of rules, and tell an earlier report that this session is to replace it."""
    claim(early_config)
    _opened(early_config, open_session(early_config))


def pytest_configure(config: pytest.Config) -> None:
    """Read the options once and register the marks."""
    from pytest_rvads.collection import register_marks

    try:
        options = config.stash[OPTIONS] = Options.read(config)
        if options.export:
            check_library()
        if options.autopilot:
            chosen(options.autopilot, config.invocation_params.dir)  # a wrong name ends the session before anything runs
        simulator = None
        if options.simulator:
            from pytest_rvads.simulators.simulator import named

            simulator = named(options.simulator, config.invocation_params.dir)
        _opened(config, choosing(Choice(simulator, _opened(config, limits(config)))))
        register_marks(config)
    except RvadsError as error:
        raise pytest.UsageError(str(error)) from error
    if options.driver:
        offer(config)
    seconds = options.time_budget
    config.stash[BUDGET] = None if seconds is None else Budget(config, seconds)
    if config.stash[BUDGET]:
        config.pluginmanager.register(config.stash[BUDGET], "rvads_budget")
    config.stash[FOLDER] = SessionFolder(config, options)
    config.pluginmanager.register(config.stash[FOLDER], "rvads_folder")
    config.pluginmanager.register(Recorded(), "rvads_recorded")
    planner = Planner(config)
    config.pluginmanager.register(planner, "rvads_planner")
    if hasattr(config, "workerinput"):
        end_with_parent()
    else:
        heed(config)
        session = Session(config, planner)
        verdicts = Verdicts(session)
        config.pluginmanager.register(session, "rvads_session")
        config.pluginmanager.register(verdicts, "rvads_verdicts")
        config.pluginmanager.register(Causes(verdicts, session), "rvads_causes")


def pytest_report_header(config: pytest.Config) -> list[str]:
    """Return header lines with driver and simulator, if options name the two, with the file and the digest of the driver's code.

    A further line names the limits that the simulator states for its results.
    """
    options = config.stash[OPTIONS]
    driven = [f"rvads: driven by {options.driver}{code_of_driver(config)}"] if options.driver else []
    if not options.simulator:
        return driven
    caveat = getattr(choice().simulator, "caveat", "")
    said = [f"rvads: {one_line(caveat)}"] if isinstance(caveat, str) and caveat else []
    made = f"rvads: simulated by --rvads-simulator={options.simulator}{code_of_simulator(config, choice().simulator)}"
    return [*driven, made, *said]


def pytest_report_collectionfinish(config: pytest.Config, items: list[pytest.Item]) -> str | None:
    """Return a line which says that fixtures choose the driver, if no option names a driver."""
    from pytest_rvads.collection import is_recorded

    ours = (item for item in items if "rvads_cell" in getattr(item, "fixturenames", ()))
    if config.stash[OPTIONS].driver or all(map(is_recorded, ours)):
        return None
    return "rvads: driven by what the fixture rvads_autopilot returns"


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Open the book of rules of a test file while it is collected."""
    with open_book(collector):
        return (yield)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Expand ``@rvads.scenario``; the plugin `Recorded` has expanded the other mark."""
    test = metafunc.definition
    if test.get_closest_marker("rvads_recorded"):
        return
    if "rvads_cell" in metafunc.fixturenames or test.get_closest_marker("rvads_scenario"):
        from pytest_rvads.collection import expand

        expand(metafunc, metafunc.config.stash[OPTIONS])


class Recorded:
    """Expands ``@rvads.recorded`` before pytest expands parametrized fixtures, because its tests ignore fixtures of drivers."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """Expand the mark."""
        if metafunc.definition.get_closest_marker("rvads_recorded"):
            from pytest_rvads.collection import expand_recorded

            expand_recorded(metafunc, metafunc.config.stash[OPTIONS])

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        """Let ``-k`` select by junction, which ids of recorded runs don't name."""
        if item.get_closest_marker("rvads_recorded"):
            item.extra_keyword_matches |= {str(mark.kwargs.get("junction", "")) for mark in item.iter_markers("rvads")}


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Refuse a mark on what can't be parametrized, so that it is not silently a plain test, and one that nothing matches."""
    for item in items:
        if "rvads_cell" in getattr(item, "fixturenames", ()):
            encode_all(sys.stdout, sys.stderr)  # what a driver prints is no reason to end its run
            continue
        for name in ("scenario", "recorded"):
            if mark := item.get_closest_marker(f"rvads_{name}"):
                said = f"has @rvads.{name}(...), which works on functions and classes of pytest only"
                raise pytest.UsageError(f"{mark.args[0].place}: {item.nodeid} {said}")
        if item.get_closest_marker("rvads_known"):
            from pytest_rvads.collection import idle

            idle(item)
    if in_part(config):
        return
    from pytest_rvads.collection import unused

    if wrong := unused(config):
        raise pytest.UsageError("; ".join(wrong))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Open the book of rules of a test file while one of its tests runs."""
    with open_book(item):
        return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Give every item of ours a record, and keep those from starting that a time budget has no room for."""
    if prepare(item) and (budget := item.config.stash[BUDGET]):
        budget.spend()


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object]) -> Generator[None, object, object]:
    """Keep the rules that a fixture registers until the scope of the fixture ends."""
    with outliving(fixturedef):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Let no item of ours pass that judged nothing, or went on after a violation as if nothing had been."""
    __tracebackhide__ = True
    if RECORD not in item.stash:
        return (yield)
    try:
        yield
    except (pytest.skip.Exception, pytest.xfail.Exception):
        settle(item, ended=False)
        raise
    settle(item, ended=True)
    return None


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


def _opened(config: pytest.Config, context: AbstractContextManager[_T]) -> _T:
    """Enter a context, and leave the context when the session ends."""
    stack = ExitStack()
    config.add_cleanup(stack.close)
    return stack.enter_context(context)

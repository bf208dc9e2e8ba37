"""The hooks of the pytest plugin; each hook calls other modules in a few lines.

Every run of pytest in an environment with this plugin imports this module, so this module imports no heavy module at top level.

Only the modules of the plugin and the tests of simulators import pytest. All other modules work in scripts and notebooks.
"""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import AbstractContextManager, ExitStack
from typing import TypeVar

import pytest

from pytest_rvads.drivers.naming import chosen
from pytest_rvads.fixtures.monitoring import monitor, rule, settle
from pytest_rvads.fixtures.running import (
    run,
    rvads_autopilot,
    rvads_cell,
    rvads_map,
    rvads_recorded,
    rvads_run,
    rvads_runs,
    rvads_simulator,
    rvads_sut,
    rvads_vehicle,
)
from pytest_rvads.session.collection import extensions
from pytest_rvads.session.collection.cells import register_marks
from pytest_rvads.session.collection.expansion import expand, expand_recorded, idle, unused
from pytest_rvads.session.collection.extensions import open_book, open_session, outliving
from pytest_rvads.session.interrupts import BUDGET, Budget, end_with_parent, heed
from pytest_rvads.session.items import RECORD, attach, letter, prepare, unwound
from pytest_rvads.session.main_process import Closing, Session
from pytest_rvads.session.options import LIMITS, NAMED, OPTIONS, Options, all_options, choice_of, declare, limits
from pytest_rvads.session.outputs import FOLDER, SessionFolder, claim
from pytest_rvads.session.plan import Planner, in_part, offer
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import encode_all, one_line

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
    """Declare the options ``--rvads-*`` and the ini settings ``rvads_*``."""
    declare(parser)


def pytest_addhooks(pluginmanager: pytest.PytestPluginManager) -> None:
    """Register the hooks that users can implement."""
    pluginmanager.add_hookspecs(extensions)


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests(early_config: pytest.Config) -> None:
    """Open a place for the rules that the session registers, and mark the report of an earlier session as replaced."""
    claim(early_config)
    _opened(early_config, open_session(early_config))


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> int | None:
    """Print the help of all options of this plugin in place of a session, if ``--rvads-help`` asks for it."""
    if not config.option.rvads_help:
        return None
    sys.stdout.write(all_options().format_help())
    return 0


def pytest_configure(config: pytest.Config) -> None:
    """Read the options once and register the marks."""
    try:
        options = config.stash[OPTIONS] = Options.read(config)
        if options.autopilot:
            chosen(options.autopilot, config.invocation_params.dir)  # a wrong name ends the session before anything runs
        config.stash[NAMED] = None
        if options.simulator:
            from pytest_rvads.simulators.simulator import named

            config.stash[NAMED] = named(options.simulator, config.invocation_params.dir)
        config.stash[LIMITS] = _opened(config, limits(config))
        register_marks(config)
    except RvadsError as error:
        raise pytest.UsageError(str(error)) from error
    if options.driver:
        offer(config)
    config.stash[BUDGET] = None
    if options.time_budget is not None:
        budget = config.stash[BUDGET] = Budget(config, options.time_budget)
        config.pluginmanager.register(budget, "rvads_budget")
    folder = config.stash[FOLDER] = SessionFolder(config, options)
    config.pluginmanager.register(folder, "rvads_folder")
    config.pluginmanager.register(Recorded(), "rvads_recorded")
    planner = Planner(config)
    config.pluginmanager.register(planner, "rvads_planner")
    if hasattr(config, "workerinput"):
        end_with_parent()
    else:
        heed(config)
        session = Session(config, planner)
        config.pluginmanager.register(session, "rvads_session")
        config.pluginmanager.register(Closing(session), "rvads_closing")


def pytest_report_header(config: pytest.Config) -> list[str]:
    """Return header lines on the driver and the simulator that options name, with file and digest of their code.

    A further line names the limits that the simulator states for its results.
    """
    options = config.stash[OPTIONS]
    lines = []
    if options.driver:
        if options.sut is not None:
            from pytest_rvads.drivers.stacks.process import Process

            driver: object = Process(options.sut)  # the process starts only when a run asks for a decision
        else:
            driver = chosen(str(options.autopilot), config.invocation_params.dir)
        lines.append(f"rvads: driven by {options.driver}{_code_of(driver, config)}")
    if not options.simulator:
        return lines
    simulator = choice_of(config).simulator
    caveat = getattr(simulator, "caveat", "")
    lines.append(f"rvads: simulated by --rvads-simulator={options.simulator}{_code_of(simulator, config)}")
    return [*lines, f"rvads: {one_line(caveat)}"] if isinstance(caveat, str) and caveat else lines


def pytest_report_collectionfinish(config: pytest.Config, items: list[pytest.Item]) -> str | None:
    """Return a line which says that a fixture chooses the driver, if no option names a driver."""
    items_of_plugin = (item for item in items if {"rvads_cell", "rvads_autopilot"} <= {*getattr(item, "fixturenames", ())})
    if config.stash[OPTIONS].driver or all(item.get_closest_marker("rvads_recorded") for item in items_of_plugin):
        return None
    return "rvads: driven by what the fixture rvads_autopilot returns"


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """While pytest collects a test file, make the rules available that the test file registers."""
    with open_book(collector):
        return (yield)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Expand the mark ``@rvads.scenario`` into test items; the plugin `Recorded` expands ``@rvads.recorded``."""
    __tracebackhide__ = True
    test = metafunc.definition
    if test.get_closest_marker("rvads_recorded"):
        return
    takes_cell = "rvads_cell" in metafunc.fixturenames and "rvads_search" not in metafunc.fixturenames
    if takes_cell or test.get_closest_marker("rvads_scenario"):
        expand(metafunc, metafunc.config.stash[OPTIONS])


class Recorded:
    """A plugin that expands ``@rvads.recorded`` before pytest expands fixtures, because recorded runs use no driver fixture."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """Expand the mark ``@rvads.recorded`` into test items."""
        __tracebackhide__ = True
        if metafunc.definition.get_closest_marker("rvads_recorded"):
            expand_recorded(metafunc, metafunc.config.stash[OPTIONS])

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        """Let ``-k`` select recorded runs by junction, although the ids of recorded runs do not name the junction."""
        if item.get_closest_marker("rvads_recorded"):
            item.extra_keyword_matches |= {str(mark.kwargs.get("junction", "")) for mark in item.iter_markers("rvads")}


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Refuse a mark on a test that can't be parametrized, and a mark ``@rvads.known`` that matches no test item."""
    for item in items:
        if "rvads_cell" in getattr(item, "fixturenames", ()):
            encode_all(sys.stdout, sys.stderr)  # no run ends because its driver prints a character that the terminal lacks
            if "rvads_search" not in item.fixturenames:  # type: ignore[attr-defined]
                continue
        for name in ("scenario", "recorded"):
            if mark := item.get_closest_marker(f"rvads_{name}"):
                reason = f"has @rvads.{name}(...), which works on functions and classes of pytest only"
                raise pytest.UsageError(f"{mark.args[0].place}: {item.nodeid} {reason}")
        if item.get_closest_marker("rvads_known"):
            idle(item)
    if in_part(config):
        return
    if unmatched := unused(config):
        raise pytest.UsageError("; ".join(unmatched))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """While a test item runs, make the rules available that its test file registers."""
    with open_book(item):
        return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Begin the record of a test item that judges a run, and skip the item after the deadline of the time budget."""
    if prepare(item) and (budget := item.config.stash[BUDGET]):
        budget.check_deadline()


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object]) -> Generator[None, object, object]:
    """Keep the rules that a fixture registers until the scope of the fixture ends."""
    with outliving(fixturedef):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Fail a test item that took a monitor and judged nothing, or whose test continued after a violation."""
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
    """Attach the record (verdicts and facts), explanation and JUnit properties of a test item to pytest's report of the item."""
    with unwound(item, call):
        report = yield
    attach(item, call, report)
    return report


def pytest_assertrepr_compare(op: str, left: object, right: object) -> list[str] | None:
    """Return the lines that explain a false comparison of two runs or two verdicts; None for other values."""
    if op not in ("==", "!="):
        return None
    if "pytest_rvads.runs.run" in sys.modules:  # else neither value is a run, and numpy need not be imported
        from pytest_rvads.runs.run import Run, diverge

        if isinstance(left, Run) and isinstance(right, Run):
            divergence = diverge(left, right)
            return [f"{left!r} {op} {right!r}", str(divergence) if divergence else f"the same bit for bit, hash {left.hash[:12]}"]
    if "pytest_rvads.logic.judging.verdicts" in sys.modules:
        from pytest_rvads.logic.judging.verdicts import Verdict

        if isinstance(left, Verdict) and isinstance(right, Verdict):
            return [f"{left.rule} {left.status} {op} {right.rule} {right.status}", left.message, right.message]
    return None


def pytest_report_teststatus(report: pytest.CollectReport | pytest.TestReport) -> tuple[str, str, str] | None:
    """Return category, letter and word by which pytest shows an item with the status NA, UNSURE or NOT RUN."""
    return letter(report)


def _code_of(factory: object, config: pytest.Config) -> str:
    """Return file and digest (or version) of a driver or simulator, such as `` (pilots.py 3fa29c01)``, or an empty text."""
    from pytest_rvads.drivers.identity import source

    code = source(factory, config.invocation_params.dir)
    return f" ({code})" if code else ""


def _opened(config: pytest.Config, context: AbstractContextManager[_T]) -> _T:
    """Enter a context manager, which pytest exits at the end of the session, and return its value."""
    stack = ExitStack()
    config.add_cleanup(stack.close)
    return stack.enter_context(context)

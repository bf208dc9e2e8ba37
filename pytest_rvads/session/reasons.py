"""The checks of a session: a check returns the reason why the session is not green (fails), or no reason.

A session is green only if a verdict was given, a driver was named, and everything planned is accounted for. A violation fails
its item even if the test, a plugin or a conftest.py catches the exception.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.support.wording import plural

if TYPE_CHECKING:
    from pytest_rvads.report.record import Record

_FAILED = int(pytest.ExitCode.TESTS_FAILED)
_NOTHING = int(pytest.ExitCode.NO_TESTS_COLLECTED)


@dataclass(frozen=True, slots=True)
class Ending:
    """All values that decide whether a session is green."""

    exitstatus: int
    """Exit status that pytest decided on."""
    collected: bool
    records: Mapping[str, Record]
    missing: int
    """Number of selected items that never ran."""
    unplanned: int
    """Number of items that workers collected, if no worker reported which items belong to this plugin; 0 if a worker did."""
    vanished: int
    """Number of items that a plugin dropped without the hook `pytest_deselected`."""
    undriven: Mapping[str, str]
    """By node id of an item without a named driver, a sentence on a misplaced definition of the driver, or an empty text."""
    turned: Set[str]
    """Node ids of items that failed and whose reports a plugin or conftest.py turned into reports of passed items."""
    late: str
    """Message of the items that the time budget kept from starting; empty without a budget."""
    lets_open_pass: bool
    """Whether the options let an item with the verdict OPEN pass or be skipped."""


@dataclass(frozen=True, slots=True)
class Reason:
    """A reason why a session is not green, or a note on the session."""

    text: str
    exitstatus: int = _FAILED
    """Exit status of the session if nothing else gives the session another status than 0; 0 for a note."""
    cut: bool = True
    """Whether so many items are missing that ``--rvads-fail-on`` excuses no failure."""


def reasons(ending: Ending) -> list[Reason]:
    """Return the reasons why the session is not green; the first reason with an exit status other than 0 decides the status."""
    records = ending.records.values()
    checked = [_ended(ending)]
    if ending.vanished:
        vanished = f"{plural(ending.vanished, 'item')} vanished"
        checked.append(Reason(f"{vanished}: a plugin or conftest.py dropped them without deselecting them"))
    checked.append(_undriven(ending))
    flaky = [record for record in records if record.status is Outcome.FLAKY and record.outcome != "failed"]
    if flaky:
        example = f", first {flaky[0].nodeid}: {flaky[0].flaky}" if flaky[0].flaky else ""
        checked.append(Reason(f"FLAKY, though nothing failed: {plural(len(flaky), 'item')}{example}", cut=False))
    if records and not any(record.status.judges or record.status is Outcome.FLAKY for record in records):
        text = "nothing was judged: no rule required an action of the system under test, or no item ran"
        checked.append(Reason(text, _NOTHING, cut=False))
    checked.append(_hushed(ending))
    unkept = [record.unkept for record in records if record.unkept]
    if unkept:
        checked.append(Reason(f"the runs of {plural(len(unkept), 'item')} could not be kept: {unkept[0]}"))
    if late := sum(record.late for record in records):
        text = f"{ending.late.partition(': ')[2]}: {plural(late, 'item')} did not run"
        checked.append(Reason(text, exitstatus=0, cut=False))
    return [reason for reason in checked if reason]


def _ended(ending: Ending) -> Reason | None:
    missing = f"{plural(ending.missing, 'item')} did not run"
    incomplete = bool(ending.missing or ending.unplanned) or not ending.collected
    if not ending.collected:
        missing = "the items to run were not yet known"
    elif ending.unplanned:
        missing = f"none of {plural(ending.unplanned, 'item')} ended, and no worker reported which of them belong to pytest-rvads"
    if ending.exitstatus not in (pytest.ExitCode.OK, _FAILED, _NOTHING):
        text = f"the session did not end by itself (exit status {ending.exitstatus}): {missing}"
        return Reason(text, cut=incomplete)
    return Reason(f"the session stopped early: {missing}") if incomplete else None


def _undriven(ending: Ending) -> Reason | None:
    if not ending.undriven:
        return None
    where = next(filter(None, ending.undriven.values()), "")
    return Reason(
        f"nothing says what drives in {plural(len(ending.undriven), 'item')}, so the bundled reference autopilot did, and "
        "nothing of yours was tested: override the fixture rvads_autopilot, or name what drives by --rvads-autopilot=module:name "
        f"or --rvads-sut (--rvads-autopilot=reference if you mean the reference){'; ' if where else ''}{where}"
    )


def _hushed(ending: Ending) -> Reason | None:
    """Return a reason why the session fails if a plugin or conftest.py turned failed test items into passed items."""
    fails = {outcome for outcome in Outcome if outcome.bad} - ({Outcome.OPEN} if ending.lets_open_pass else set())
    hidden = {name for name, r in ending.records.items() if r.status in fails and not r.failed and not r.known}
    hushed = sorted(hidden | {name for name in ending.turned if ending.records[name].status is not Outcome.FLAKY})
    if not hushed:
        return None
    return Reason(f"{plural(len(hushed), 'item')} passed in spite of a failure: a plugin catches failures, first {hushed[0]}")

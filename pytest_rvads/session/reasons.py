"""Why a session is not green, whatever pytest says: a list of small checks, each of which may give one reason.

A session is green only if a verdict was given, a driver was named, and everything planned is accounted for. A test can't pass
over a violation of its own run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.outcome import Outcome
from pytest_rvads.wording import plural

if TYPE_CHECKING:
    from pytest_rvads.report.record import Record

__all__ = ["Ending", "Reason", "reasons"]

_FAILED = int(pytest.ExitCode.TESTS_FAILED)
_NOTHING = int(pytest.ExitCode.NO_TESTS_COLLECTED)


@dataclass(frozen=True, slots=True)
class Ending:
    """How a session ended: all that decides whether it is green."""

    exitstatus: int
    """Of pytest."""
    collected: bool
    """Whether collecting came to its end."""
    records: Mapping[str, Record]
    """By node id."""
    missing: int
    """Selected items that never ran."""
    unsaid: int
    """Number of items that workers collected, if every worker ended before it reported which items belong to this plugin."""
    vanished: int
    """Number of items that a plugin dropped without the hook `pytest_deselected`."""
    undriven: Mapping[str, str]
    """Node ids of items that nothing was named to drive in, and where what was meant may be."""
    turned: Set[str]
    """Node ids of items that failed until somebody changed their reports."""
    late: str
    """Message of items that a time budget had no room for, empty without a budget."""
    lets_open_pass: bool


@dataclass(frozen=True, slots=True)
class Reason:
    """What keeps a session from being green, or should be known of it."""

    text: str
    exitstatus: int = _FAILED
    """To end with where the session would end with 0; 0 where the reason alone is none."""
    cut: bool = True
    """Whether so much is missing that a comparison with a baseline excuses no failure."""


def reasons(ending: Ending) -> list[Reason]:
    """Return every reason, the first of which with an exit status decides."""
    return [reason for check in _CHECKS if (reason := check(ending))]


def _ended(ending: Ending) -> Reason | None:
    missing = f"{plural(ending.missing, 'item')} did not run"
    lacking = bool(ending.missing or ending.unsaid) or not ending.collected
    if not ending.collected:
        missing = "it was not yet known what is to run"
    elif ending.unsaid:
        missing = f"none of {plural(ending.unsaid, 'item')} ended, and no worker came to say which of them ask for a run"
    if ending.exitstatus not in (pytest.ExitCode.OK, _FAILED, _NOTHING):
        text = f"the session did not end by itself (exit status {ending.exitstatus}): {missing}"
        return Reason(text, cut=lacking)
    return Reason(f"the session stopped early: {missing}") if lacking else None


def _vanished(ending: Ending) -> Reason | None:
    said = f"{plural(ending.vanished, 'item')} vanished: a plugin or conftest.py dropped them without deselecting them"
    return Reason(said) if ending.vanished else None


def _undriven(ending: Ending) -> Reason | None:
    if not ending.undriven:
        return None
    where = next(filter(None, ending.undriven.values()), "")
    return Reason(
        f"nothing says what drives in {plural(len(ending.undriven), 'item')}, so the bundled reference autopilot did, and "
        "nothing of yours was tested: override the fixture rvads_autopilot, or name what drives by --rvads-autopilot=module:name "
        f"or --rvads-sut (--rvads-autopilot=reference if you mean the reference){'; ' if where else ''}{where}"
    )


def _unjudged(ending: Ending) -> Reason | None:
    judged = (record.status.judges or record.status is Outcome.FLAKY for record in ending.records.values())
    if not ending.records or any(judged):
        return None
    said = "nothing was judged: no rule asked anything of what was to be tested, or no item ran"
    return Reason(said, _NOTHING, cut=False)


def _hushed(ending: Ending) -> Reason | None:
    """Items that failed, and that a plugin or conftest.py made pass."""
    fails = {outcome for outcome in Outcome if outcome.bad} - ({Outcome.OPEN} if ending.lets_open_pass else set())
    hidden = {name for name, r in ending.records.items() if r.status in fails and not r.failed and not r.known}
    hushed = sorted(hidden | {name for name in ending.turned if ending.records[name].status is not Outcome.FLAKY})
    if not hushed:
        return None
    return Reason(f"{plural(len(hushed), 'item')} passed though not kept: something catches failures, first {hushed[0]}")


def _flaky(ending: Ending) -> Reason | None:
    """Items that are FLAKY, and that pytest does not count as failed."""
    flaky = [r for r in ending.records.values() if r.status is Outcome.FLAKY and r.outcome != "failed"]
    if not flaky:
        return None
    told = f", first {flaky[0].nodeid}: {flaky[0].flaky}" if flaky[0].flaky else ""
    return Reason(f"FLAKY, though nothing failed: {plural(len(flaky), 'item')}{told}", cut=False)


def _unkept(ending: Ending) -> Reason | None:
    unkept = [record.unkept for record in ending.records.values() if record.unkept]
    return Reason(f"the runs of {plural(len(unkept), 'item')} could not be kept: {unkept[0]}") if unkept else None


def _late(ending: Ending) -> Reason | None:
    late = sum(record.late for record in ending.records.values())
    said = f"{ending.late.partition(': ')[2]}: {plural(late, 'item')} did not run"
    return Reason(said, exitstatus=0, cut=False) if late else None


_Check = Callable[[Ending], Reason | None]
_CHECKS: tuple[_Check, ...] = (_ended, _vanished, _undriven, _flaky, _unjudged, _hushed, _unkept, _late)

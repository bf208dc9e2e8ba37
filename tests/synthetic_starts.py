"""Starts of two vehicles at a stop sign that a function judges, in place of simulations."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.starts.lines import STEP, Setting
from pytest_rvads.scenarios.scenario import Scenario

Make = Callable[..., Run]
Answer = Callable[[int], tuple[bool, Mapping[str, Status]]]
"""Returns for a lead [steps of `STEP`] whether the subject enters first, and the status of every rule."""

SUBJECT_FIRST, OTHER, SUBJECT_LAST, END = 50, 75, 100, 160
"""Ticks at which the subject and the other vehicle enter the junction, and number of ticks of a run."""


def lead_of(scenario: Scenario) -> int:
    """Return the time between the arrivals of both vehicles at constant speeds [steps of `STEP`]."""
    starts = {entrance: scenario.start(entrance) for entrance, direction in enumerate(scenario.directions) if direction}
    times = {entrance: distance / speed if speed else 0.0 for entrance, (distance, speed) in starts.items()}
    subject = times.pop(scenario.subject or 0)
    (other,) = times.values()
    return round((other - subject) / STEP)


@contextmanager
def judged_by(answer: Answer | Sequence[Answer], make: Make) -> Iterator[list[int]]:
    """Let a function judge all starts, and yield the list of the leads that were judged.

    Args:
        answer: judges a start; or a function per seat of the subject.
        make: the fixture `make`.
    """
    leads: list[int] = []

    def judged(_setting: Setting, scenario: Scenario) -> tuple[Run, list[Verdict]]:
        leads.append(lead_of(scenario))
        judge = answer if callable(answer) else answer[scenario.subject or 0]
        goes, statuses = judge(leads[-1])
        vehicles: dict[int, Any] = {}
        for entrance, direction in enumerate(scenario.directions):
            if direction:
                enters = OTHER if entrance != scenario.subject else SUBJECT_FIRST if goes else SUBJECT_LAST
                vehicles[entrance] = (direction, enters - 10, enters, enters + 50)
        verdicts = [
            Verdict(rule, status, f"{rule} {status} at {leads[-1]}", explanation=f"{rule} is judged {status}")
            for rule, status in statuses.items()
        ]
        return make(scenario.place.name, vehicles, END), verdicts

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Setting, "judged", judged)
        yield leads


def setting() -> Setting:
    """Return a setting for starts that a function judges."""
    return Setting.of(rvads.Reference, ())

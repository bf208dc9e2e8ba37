"""The judgement of an instance of a rule on a run, and the template by which an instance is judged.

A template is an instance (a rule for certain vehicles and entrances) with its monitor. A judgement holds the status, the broken
atoms, the ticks and the margin of an instance, and the doubt on which an UNSURE instance depends.
"""

from __future__ import annotations

from dataclasses import dataclass

from pytest_rvads.logic.judging.instances import Template
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f


@dataclass(frozen=True, slots=True)
class Happening:
    """An event on which a verdict depends: a vehicle came to a zone, or a light changed."""

    agent: int | None
    """Column of the vehicle; None for a light."""
    light: int | None
    """Entrance of the light; None for a vehicle."""
    code: int
    """The zone that the vehicle came to, or the colour that the light turned to."""
    time: float | None
    """Time since the first state of the run [s]; None if the recording of the vehicle ends before the event."""


@dataclass(frozen=True, slots=True)
class Hinge:
    """The doubt on which an UNSURE instance of a rule depends: the order of events, or the accuracy of a measurement."""

    what: tuple[Happening, ...] = ()
    """Two events, the earlier event first, or a single event that possibly did not happen; empty for a measurement."""
    known: float = 0.0
    """Accuracy of the time between the events [s]; infinite if an event was possible at any time in the past."""
    tie: float = 0.0
    """Longest time between two events that count as simultaneous [s]."""
    reading: str = ""
    """The measurement that would have to be different, in words; empty if the order of events decides."""

    @property
    def apart(self) -> float | None:
        """Time between the two events on which the verdict depends [s]; None if the time is unknown."""
        times = [happening.time for happening in self.what if happening.time is not None]
        return round(times[1] - times[0], 9) if len(times) == 2 else None


@dataclass(frozen=True, slots=True)
class Judgement:
    """The judgement of an instance of a rule on a run; ticks count from 0."""

    template: Template
    status: Status
    trigger: int | None = None
    """First tick of the violated or open obligation. In a kept instance, the first tick of its first obligation."""
    failed: int | None = None
    """First tick from which on no continuation satisfies the instance."""
    broken: tuple[tuple[f.Atom, bool], ...] = ()
    """Atoms with their truth values in the tick `failed`; the opposite value of any of these atoms would have kept the rule."""
    margin: float | None = None
    """See `InstanceVerdict.margin` [s]."""
    together: bool = False
    """Whether the awaited event came in the tick `failed` itself, one step too late."""
    ended: int | None = None
    """Last tick in which all agents of the instance were recorded, if an agent vanishes before the run ends."""
    hinge: Hinge | None = None
    """The doubt on which an UNSURE instance depends."""


Near = tuple[Template, int, tuple[f.Formula, ...], int]
"""Where a rule came closest to being triggered: the instance, the tick, the parts of the premise that were false in the tick, and
the number of equally close ticks."""

"""The judgement of a rule on a run, complete when it is made: all that a verdict tells about driving.

`Judgement` holds the status of the rule, and the judgements of its instances (the rule for certain vehicles and entrances) with
their ticks, margins and vehicles to blame. It holds what the traffic did, and what the explanation shows of the run. Texts are
made from this value, and nothing about driving is computed while they are made.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from pytest_rvads.logic.conduct.blame import Cause
from pytest_rvads.logic.conduct.rights import Ground
from pytest_rvads.logic.judging.instances import Template
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.rule import Rule


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
class Blame:
    """The agents to blame for a violated or open instance of a rule."""

    agents: tuple[f.Element, ...] = ()
    """The agents that broke a violated instance, or that still have to wait in an open instance."""
    cause: Cause | None = None
    """Who caused the collision or meeting that broke the instance, and how; None if nothing of the kind broke it."""
    on_foot: bool = False
    """Whether pedestrians alone are to blame."""
    subject: bool = False
    """Whether the subject (the vehicle under test) is to blame; False on a run without a subject."""


@dataclass(frozen=True, slots=True)
class InstanceJudgement:
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
    blame: Blame = Blame()
    """The agents to blame; nobody as long as the rule is not judged, and for an instance that is neither violated nor open."""


@dataclass(frozen=True, slots=True)
class Nearest:
    """Where a rule that was never triggered came closest to being triggered."""

    template: Template
    tick: int
    missing: tuple[f.Formula, ...]
    """The parts of the premise that were false in the tick."""
    steps: int
    """Number of ticks that are equally close."""


@dataclass(frozen=True, slots=True)
class Cycle:
    """Vehicles in a circle of waiting: each vehicle had to wait for the next vehicle, and the last vehicle for the first."""

    tick: int
    """First tick of the cycle."""
    agents: tuple[str, ...]
    alone: bool = True
    """Whether the obligations of the judged rule alone make the cycle; if False, obligations of its companions take part."""


@dataclass(frozen=True, slots=True)
class Debt:
    """The ground on which an agent has to give way to another agent; both are columns of the run."""

    agent: int
    other: int
    ground: Ground


@dataclass(frozen=True, slots=True)
class Bend:
    """A bend in which no path keeps a vehicle in its lane."""

    vehicle: str
    radius: float
    """Radius of the bend [m]."""
    steers: float
    """Smallest turning radius of the vehicle [m]."""


@dataclass(frozen=True, slots=True)
class Course:
    """What an agent of an instance had done when the instance was broken, or when the run ended; ticks count from 0."""

    agent: f.Element
    arrived: int | None
    """Tick of its latest arrival at its entrance; None if it was never there."""
    waited: int
    """Its waiting time in its last state at the entrance, in ticks."""
    entered: int | None
    """First tick in the junction; None if it was never there."""


@dataclass(frozen=True, slots=True)
class Scene:
    """A violated or open instance, with what its explanation shows of the run."""

    instance: InstanceJudgement
    tick: int
    """The tick in which the instance was broken, or the last tick with all its agents."""
    states: tuple[tuple[int, tuple[bool, ...]], ...]
    """Ticks of the beginning, the last kept state and the end of the obligation, each with the truth values of all atoms."""
    courses: tuple[Course, ...]
    debt: Debt | None
    """Why an agent has to give way; None if lights or the order of arrival decide."""
    bends: tuple[Bend, ...]
    """Bends in which vehicles that are to blame could not keep their lanes."""
    vanished: tuple[str, int] | None
    """The agent of the instance whose recording ends first, with its last tick; None if all stay until the run ends."""


class Reason(Enum):
    """Why a rule has a status that its instances do not explain."""

    DAMAGED = auto()
    """The run can't be judged."""
    ELSEWHERE = auto()
    """The rule is not about junctions of this kind."""
    NOT_RECORDED = auto()
    """The run does not record values that the rule needs."""
    EXCLUDED = auto()
    """The junction and the ways alone exclude every instance."""
    NEVER_TRIGGERED = auto()
    NOBODY_MOVED = auto()
    """The rule was kept, but no vehicle moved."""
    NOT_ASKED = auto()
    """No instance that was triggered required an action of the subject."""
    STRAYED = auto()
    """The rule was kept until a vehicle left its route, which ended the run."""
    CUT_OFF = auto()
    """The rule was kept until the run reached its duration, before the subject had left the junction."""


ERRORS = (("places", "m", (0.1, 0.2, 0.4, 0.8, 1.6)), ("speeds", "m/s", (0.1, 0.2, 0.5, 1.0, 2.0)))
"""Per kind of measurement its name, its unit, and the errors that are tried for `Judgement.tolerance`."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """The judgement of a rule on a run."""

    rule: Rule
    status: Status
    reason: Reason | None = None
    """Why the rule has this status; None if its instances say why."""
    detail: str = ""
    """What damages the run, or what it does not record, in words."""
    instances: tuple[InstanceJudgement, ...] = ()
    """The judgements of the instances, those that the subject is to blame for first, then by severity and time."""
    collapsed: int = 0
    """Number of further instances, which are true because of the junction and the ways alone."""
    asked: bool = True
    """See `Verdict.asked`."""
    unavoidable: bool = False
    """Whether the rule was violated and no vehicle could have kept the rule."""
    provoked: bool = False
    """Whether the traffic alone caused the violation or the open obligation; without a subject, whether pedestrians did."""
    kept: int = 0
    """Number of kept instances; with a subject, of those that required an action of the subject."""
    binding: int = 0
    """Number of all instances; with a subject, of those that bind the subject to act."""
    scene: Scene | None = None
    """The gravest violated or open instance; None if the status has another reason."""
    cycle: Cycle | None = None
    """The circle of waiting vehicles that makes a violation unavoidable, or that stands behind an open obligation."""
    nearest: Nearest | None = None
    """Where a rule that was never triggered came closest to being triggered."""
    undecided: str = ""
    """The undecided ways on which a violation or open obligation does not depend, in words."""
    tie: float = 0.0
    """Largest difference of waiting times that counted as equal [s]."""
    untied: Status | None = None
    """The status without the tie window; None if it is the same."""
    tolerance: tuple[int, ...] | None = None
    """Per kind of measurement, the number of `ERRORS` with which a violation in a recorded run stays definite."""

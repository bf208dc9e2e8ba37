"""Records: one value per item, the only thing that reports are made from.

Records are typed. They cross processes and reach hooks as builtins, and are checked where they are read. Verdicts, indicators and
differences of runs are embedded unchanged; only the explanation of a verdict is left out, because a town has a million verdicts
and most explanations are never read.

Sessions make a record per item. Campaigns and ``rvads check`` make a record of a run with all its verdicts, which `run_record`
splits into a record per rule.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, TypeAlias

import msgspec
from msgspec.structs import replace

from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.logic.outcome import Outcome, Tallied
from pytest_rvads.runs.measured import Divergence, Kpis
from pytest_rvads.support.decoding import encode

__all__ = [
    "AgentRecord",
    "Computing",
    "Record",
    "RecordedItem",
    "SimulatedItem",
    "conclude",
    "planned_record",
    "properties",
    "received",
    "sent",
]

Count = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
"""What things are counted or numbered by, exact in every program that reads JSON."""


class Computing(msgspec.Struct, frozen=True, kw_only=True):
    """Computing times of a stack in another process in a run: the sum and the longest decision [s]."""

    stack: str
    decisions: Count
    compute: float
    longest: float


class AgentRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Who took part in a run; where it comes from and goes to as arm and lane."""

    name: str
    kind: str
    entrance: tuple[int, int]
    exit: tuple[int, int]

    def __str__(self) -> str:
        return f"{self.kind} {self.name} from {'{}.{}'.format(*self.entrance)} to {'{}.{}'.format(*self.exit)}"


class _Item(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type"):
    """What is known of every item; the status is NOT RUN until the item has run.

    A field with a default is left out of files where it has the default.
    """

    nodeid: str
    line: Count
    """Line of the test function in its file."""
    test: str
    """Name of the test function."""
    ways: Count
    """Number of arms of the junction."""
    junction: str
    control: str = ""
    """What regulates the junction, where that is known."""
    rule: str | None
    requirements: tuple[str, ...]
    """Identifiers of what scenario and rule trace to."""
    formula: str = ""
    """Digest of the formula of the rule, of its tie window and of who is bound by it."""
    status: Outcome
    verdicts: tuple[Verdict, ...]
    known: str | None
    """Reason of the xfail that matched."""
    outcome: str
    """Pytest's, empty if it did not run."""
    late: bool = False
    """Whether the time budget of the session was used up before the item started."""
    message: str
    run: str | None = None
    hash: str | None = None
    place: str | None = None
    """Digest of the junction: another map under the same name has another one."""
    duration: float | None = None
    """Duration of the run [s]."""
    agents: tuple[AgentRecord, ...] = ()
    kpis: Kpis | None = None
    timing: dict[str, Computing] | None = None
    """Computing times by vehicle, for vehicles that a stack in another process drove."""
    unkept: str | None = None
    """Reason why the run could not be kept."""
    flaky: Divergence | None = None
    look: str = ""
    """The replay page, with the time of the violation."""
    looks: tuple[str, ...] = ()
    """Further replay pages, of later violations in a long recording."""
    change: str = ""
    """Since the baseline, where there is one."""
    variant: str = ""
    """Values of the test's other parameters, as ids name them, such as the version of a controller; empty without any."""

    @property
    def contradiction(self) -> str:
        """What of the record can't be true at once, in words; empty for every record that a session writes."""
        rules = {verdict.rule for verdict in self.verdicts} - {"", self.rule}
        if self.rule and rules:
            return f"is about {self.rule} and has a verdict of {min(rules)}"
        worst = min((verdict.outcome for verdict in self.verdicts), key=lambda found: found.severity, default=None)
        fits = self.status is (worst or self.status)
        if self.outcome == "failed":
            fits = self.status.bad or self.status is Outcome.UNSURE or (fits and self.status is Outcome.UNAVOIDABLE)
        told = f"a verdict {worst}" if worst else "no verdict"
        return "" if fits or self.status is Outcome.FLAKY else f"is {self.status}, {self.outcome or 'never ran'}, and has {told}"

    @property
    def took_part(self) -> str:
        """The agents in words: ``car a0 from 0.0 to 2.0; truck a1 from 1.0 to 3.0``, arm and lane."""
        return "; ".join(map(str, self.agents))

    @property
    def asks(self) -> str:
        """The rule, or ``run`` where a test judges the run itself."""
        return self.rule or "run"

    @property
    def counts_as(self) -> Tallied:
        """The status for sums; None for a known failure."""
        return None if self.known else self.status

    @property
    def ran_as(self) -> str:
        """Identity of the run: its hash, or the name of the run or item if the run has no hash."""
        return self.hash or self.run or self.nodeid

    @property
    def kind(self) -> str:
        """The kind of junction: ``3-way lights``."""
        return f"{self.ways}-way {self.control}".rstrip()

    @property
    def where(self) -> str:
        """The run as sentences name it: test and run with the variant, or the run alone where there is no test."""
        return f"{self.test}[{self.run}{f', {self.variant}' if self.variant else ''}]" if self.test else str(self.run)

    @property
    def failed(self) -> bool:
        """Whether the item failed, or passed one time and not another."""
        return self.outcome == "failed" or self.status is Outcome.FLAKY

    @property
    def shows(self) -> bool:
        """Whether a replay shows what was wrong: the item has a run, and its last verdict is FAIL, OPEN or UNSURE."""
        return bool(self.hash and self.verdicts) and self.verdicts[-1].status in ("FAIL", "OPEN", "UNSURE")

    @property
    def asked(self) -> bool:
        """Whether a rule asked something of the system under test, of the subject where there is one, and got an answer."""
        given = any(verdict.asked for verdict in self.verdicts if Outcome(verdict.status).judges)
        return self.status.judges or (given and self.status is not Outcome.ERROR)


class SimulatedItem(_Item, frozen=True, kw_only=True, omit_defaults=True, tag="simulated"):
    """What is known of an item that simulates a scenario."""

    cls: Count
    scenario: str
    cfg: str
    rotation: Count
    seat: Count | None
    traffic: str | None
    driver: str
    """What drove, as it calls itself."""
    source: str = ""
    """Where what drove is defined and a digest of its code, or its version: ``pilots.py 3fa29c01``."""
    simulator: str = ""
    """What made the run, likewise."""
    orbit: str = ""
    """The least scenario of the class, where the number does not tell which one that is."""


class RecordedItem(_Item, frozen=True, kw_only=True, omit_defaults=True, tag="recorded"):
    """What is known of an item that judges a run of a file."""

    recording: str
    """What was recorded, as in the id of the item: file, and time or label where the file holds several runs."""


Record: TypeAlias = SimulatedItem | RecordedItem
"""What is known of an item. In JSON the field ``type`` tells the two apart."""


def planned_record(
    nodeid: str, line: int, test: str, keys: Mapping[str, Any], ways: int, requirements: Sequence[str] = ()
) -> Record:
    """Return the record of an item that is to run.

    Args:
        nodeid: of the item.
        line: of the test function in its file.
        test: name of the test function.
        keys: what selects the cell: junction, then recording, or cls, scenario, cfg, rotation, and seat, traffic, rule, orbit,
            control, variant where there is one.
        ways: number of arms of the junction.
        requirements: identifiers of what scenario and rule trace to.
    """
    unsaid = {} if "recording" in keys else _UNSAID
    kind: type[Record] = RecordedItem if "recording" in keys else SimulatedItem
    return kind(
        nodeid=nodeid,
        line=line,
        test=test,
        ways=ways,
        requirements=tuple(requirements),
        status=Outcome.NOT_RUN,
        verdicts=(),
        known=None,
        outcome="",
        message="",
        **{"rule": None, **unsaid, **keys},
    )


_UNSAID = {"cls": 0, "scenario": "", "cfg": "", "rotation": 0, "seat": None, "traffic": None, "driver": ""}
"""What a simulated item has where its keys do not say otherwise."""


def conclude(  # noqa: PLR0913 - what pytest tells about the end of an item
    record: Record,
    verdicts: Sequence[Verdict],
    when: str,
    outcome: str,
    *,
    known: str | None = None,
    text: str = "",
    error: Outcome | None = None,
    late: bool = False,
) -> Record:
    """Return the record of a finished item.

    Args:
        record: the item's record so far.
        verdicts: the verdicts given, in order; the record holds them without their explanations.
        when: phase of pytest's report.
        outcome: pytest's outcome.
        known: reason of the xfail that matched, or None.
        text: text of the exception, or empty.
        error: status of a failure that is no failed assertion: ERROR, NOT JUDGED for a test that asked for no verdict, or
            UNSURE if the session lets UNSURE fail.
        late: whether the time budget of the session was used up before the item started.

    The status is the worst status of the verdicts. A test without rule and monitor is PASS or FAIL by its assertions, also if an
    xfail expected the failure. A skipped test is NOT RUN. A failed test always counts as a failure.
    """
    given = tuple(replace(verdict, explanation="") for verdict in verdicts)
    worst = min((verdict.outcome for verdict in given), key=lambda found: found.severity, default=None)
    if outcome != "failed":
        ran = Outcome.FAIL if known else Outcome.NOT_RUN if outcome == "skipped" else Outcome.PASS
        status = worst or (ran if when == "call" else Outcome.NOT_RUN)
    elif error in (Outcome.NOT_JUDGED, Outcome.UNSURE):
        status = error
    elif error or when != "call" or worst is Outcome.ERROR:
        status = Outcome.ERROR
    else:
        status = worst if worst and worst.severity <= Outcome.UNAVOIDABLE.severity else Outcome.FAIL
    return replace(record, status=status, verdicts=given, known=known, outcome=outcome, message=text, late=late)


def sent(record: Record) -> dict[str, Any]:
    """Return a record as it crosses processes and reaches hooks: builtins that JSON has too."""
    content: dict[str, Any] = msgspec.json.decode(encode(record))
    return content


def received(content: Mapping[str, Any]) -> Record:
    """Return the record that was sent.

    Raises:
        msgspec.ValidationError: it is none.
    """
    record: Record = msgspec.convert(content, Record)
    return record


def properties(record: Record) -> list[tuple[str, Any]]:
    """Return the properties of an item for JUnit."""
    begun: list[tuple[str, Any]]
    made: list[tuple[str, Any]] = []
    if isinstance(record, RecordedItem):
        begun = [("recording", record.recording)]
    else:
        begun = [("class", record.cls), ("scenario", record.scenario), ("configuration", record.cfg)]
        begun += [("rotation", record.rotation)]
        begun += [] if record.seat is None else [("seat", record.seat), ("traffic", record.traffic)]
        made = [("driver", record.driver), ("simulator", record.simulator)]
    return [
        ("junction", record.junction),
        *begun,
        *([("variant", record.variant)] if record.variant else []),
        ("rule", record.rule or record.test),
        ("verdict", record.status.value),
        *([("change", record.change)] if record.change else []),
        *made,
    ]

"""Records: a record holds the verdicts and facts of one test item, and reports are made only from records.

Records are typed. Records cross processes and reach hooks as JSON values, and the reader of a record checks its types. Verdicts,
indicators and differences of runs are embedded unchanged; only the explanation of a verdict is left out, because a town (all
junctions of a map, judged together) can have a million verdicts, and most explanations are never read.

Sessions make a record per item. Campaigns and ``rvads check`` make a record of a run with all its verdicts, which `by_rule`
splits into a record per rule.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import msgspec
from msgspec.structs import replace

from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.logic.outcome import Outcome, Tallied
from pytest_rvads.runs.measured import ArrivalDifferences, Divergence, Kpis
from pytest_rvads.support.decoding import encode
from pytest_rvads.support.storage import slug

if TYPE_CHECKING:
    from pytest_rvads.runs.run import Run

Count = Annotated[int, msgspec.Meta(ge=0, le=2**53)]
"""A non-negative integer that every program reads exactly from JSON."""


class Computing(msgspec.Struct, frozen=True, kw_only=True):
    """Computing times of a stack (a driver in another process) in a run."""

    stack: str
    decisions: Count
    compute: float
    """Sum of the computing times of all decisions [s]."""
    longest: float
    """Computing time of the longest decision [s]."""


class Excess(msgspec.Struct, frozen=True, kw_only=True):
    """Accelerations that a driver asked for in a run and its vehicle can't reach."""

    requests: Count
    largest: float
    """The acceleration of the greatest magnitude [m/s^2]."""


class AgentRecord(msgspec.Struct, frozen=True, kw_only=True):
    """An agent of a run; its entrance and exit are given by arm and lane."""

    name: str
    kind: str
    entrance: tuple[int, int]
    exit: tuple[int, int]

    def __str__(self) -> str:
        return f"{self.kind} {self.name} from {'{}.{}'.format(*self.entrance)} to {'{}.{}'.format(*self.exit)}"


class _Item(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="type"):
    """The fields of every record; the status is NOT RUN until the test item has run.

    A field with a default is left out of files where it has the default.
    """

    nodeid: str
    line: Count
    """Line of the test function in its file."""
    test: str
    ways: Count
    """Number of arms of the junction."""
    junction: str
    control: str = ""
    """The control of the junction; empty if the control is not known."""
    rule: str | None
    requirements: tuple[str, ...]
    """Identifiers of the requirements to which scenario and rule trace."""
    formula: str = ""
    """Digest of the formula of the rule, of its tie window and of the agents that the rule binds."""
    status: Outcome
    verdicts: tuple[Verdict, ...]
    known: str | None
    """Reason of the xfail mark that expected the failure; None if no xfail mark expected a failure."""
    outcome: str
    """The outcome that pytest reports; empty if the item did not run."""
    late: bool = False
    """Whether the time budget of the session was used up before the item started."""
    message: str
    run: str | None = None
    hash: str | None = None
    place: str | None = None
    """Digest of the junction, which tells apart junctions that have the same name in different maps."""
    duration: float | None = None
    """Duration of the run [s]."""
    agents: tuple[AgentRecord, ...] = ()
    kpis: Kpis | None = None
    arrivals: ArrivalDifferences | None = None
    """Differences between the arrivals of vehicles with conflicting movements; None if the conflicts are not known."""
    timing: dict[str, Computing] | None = None
    """Computing times by vehicle, for vehicles that a stack in another process drove."""
    excess: dict[str, Excess] | None = None
    """Accelerations beyond the limits of the vehicle, by vehicle, for vehicles whose driver asked for some."""
    unkept: str | None = None
    """Reason why the run could not be kept."""
    flaky: Divergence | None = None
    look: str = ""
    """Path of the replay page with the time of the violation, or the reason why the page was not drawn; empty without both."""
    looks: tuple[str, ...] = ()
    """Further replay pages, of later violations in a long recording."""
    change: str = ""
    """Kind of the change since the baseline; empty without a baseline."""
    variant: str = ""
    """Values of the test's other parameters, as in ids, such as the version of a controller; empty without other parameters."""

    @property
    def contradiction(self) -> str:
        """Two fields of the record that contradict each other, in words; empty for every record that a session writes."""
        arrivals = self.arrivals
        if arrivals and (arrivals.symmetry > self.ways or any(max(pair) >= len(self.agents) for *pair, _ in arrivals.tried)):
            return f"has differences between arrivals that do not fit {self.ways} arms and {len(self.agents)} agents"
        rules = {verdict.rule for verdict in self.verdicts} - {"", self.rule}
        if self.rule and rules:
            return f"is about {self.rule} and has a verdict of {min(rules)}"
        worst = min((verdict.outcome for verdict in self.verdicts), key=lambda outcome: outcome.severity, default=None)
        fits = self.status is (worst or self.status)
        if self.outcome == "failed":
            fits = self.status.bad or self.status is Outcome.UNSURE or (fits and self.status is Outcome.UNAVOIDABLE)
        if fits or self.status is Outcome.FLAKY:
            return ""
        return f"is {self.status}, {self.outcome or 'never ran'}, and has {f'a verdict {worst}' if worst else 'no verdict'}"

    @property
    def took_part(self) -> str:
        """The agents in words, with arm and lane of entrance and exit: ``car a0 from 0.0 to 2.0; truck a1 from 1.0 to 3.0``."""
        return "; ".join(map(str, self.agents))

    @property
    def asks(self) -> str:
        """Name of the rule, or ``run`` if the test judges the run without a rule."""
        return self.rule or "run"

    @property
    def counts_as(self) -> Tallied:
        """The status under which sums count the record; None for a known failure."""
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
        """The name of the run for sentences: test, run and variant; the run alone for a record without a test."""
        return f"{self.test}[{self.run}{f', {self.variant}' if self.variant else ''}]" if self.test else str(self.run)

    @property
    def failed(self) -> bool:
        """Whether the test item failed or is FLAKY."""
        return self.outcome == "failed" or self.status is Outcome.FLAKY

    @property
    def shows(self) -> bool:
        """Whether a replay shows the failure: the test item has a run, and its last verdict is FAIL, OPEN or UNSURE."""
        return bool(self.hash and self.verdicts) and self.verdicts[-1].status in ("FAIL", "OPEN", "UNSURE")

    @property
    def asked(self) -> bool:
        """Whether a rule required an action of the system under test, or of the subject, and a verdict was given."""
        asked = any(verdict.asked for verdict in self.verdicts if Outcome(verdict.status).judges)
        return self.status.judges or (asked and self.status is not Outcome.ERROR)


class SimulatedItem(_Item, frozen=True, kw_only=True, omit_defaults=True, tag="simulated"):
    """The record of a test item that simulates a scenario."""

    cls: Count
    scenario: str
    cfg: str
    rotation: Count
    seat: Count | None
    traffic: str | None
    driver: str
    source: str = ""
    """File of the driver and digest of its code, or the version of the driver: ``pilots.py 3fa29c01``."""
    simulator: str = ""
    pedestrians: str = ""
    """The pedestrians as in ids of test items, such as ``1n.steady.e0.50``; empty if nobody walks."""
    orbit: str = ""
    """The scenario of the class with the least code; empty if the number of the class identifies the class."""


class RecordedItem(_Item, frozen=True, kw_only=True, omit_defaults=True, tag="recorded"):
    """The record of a test item that judges a recorded run of a file."""

    recording: str
    """Name of the recording, as in the id of the item: file, and time or label if the file holds several runs."""


Record: TypeAlias = SimulatedItem | RecordedItem
"""The record of an item. In JSON the field ``type`` distinguishes the two types."""


def planned_record(
    nodeid: str, line: int, test: str, keys: Mapping[str, Any], ways: int, requirements: Sequence[str] = ()
) -> Record:
    """Return the record of a planned test item, before the item runs."""
    simulated = {"cls": 0, "scenario": "", "cfg": "", "rotation": 0, "seat": None, "traffic": None, "driver": ""}
    kind: type[Record] = RecordedItem if "recording" in keys else SimulatedItem
    fields: dict[str, Any] = {"rule": None, **({} if kind is RecordedItem else simulated), **keys}
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
        **fields,
    )


def conclude(
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
    """Return the record of a finished test item; `known` is the reason of the xfail mark that expected the failure.

    The status is the worst status of the verdicts. A test without rule and monitor is PASS or FAIL by its assertions, also if an
    xfail expected the failure. A skipped test is NOT RUN. A failed test always counts as a failure.
    """
    short_verdicts = tuple(replace(verdict, explanation="") for verdict in verdicts)
    worst = min((verdict.outcome for verdict in verdicts), key=lambda result: result.severity, default=None)
    if outcome != "failed":
        ran = Outcome.FAIL if known else Outcome.NOT_RUN if outcome == "skipped" else Outcome.PASS
        status = worst or (ran if when == "call" else Outcome.NOT_RUN)
    elif error not in (None, Outcome.ERROR):
        status = error
    elif error or when != "call" or worst is Outcome.ERROR:
        status = Outcome.ERROR
    else:
        status = worst if worst and worst.severity <= Outcome.UNAVOIDABLE.severity else Outcome.FAIL
    return replace(record, status=status, verdicts=short_verdicts, known=known, outcome=outcome, message=text, late=late)


def sent(record: Record) -> dict[str, Any]:
    """Return a record as values that JSON has (dict, list, str, ...); in this form records cross processes and reach hooks."""
    content: dict[str, Any] = msgspec.json.decode(encode(record))
    return content


def received(content: Mapping[str, Any]) -> Record:
    """Return the record from the values that `sent` made of it."""
    record: Record = msgspec.convert(content, Record)
    return record


def properties(record: Record) -> list[tuple[str, Any]]:
    """Return the properties of a test item for JUnit files, as pairs of name and value."""
    pairs: list[tuple[str, Any]] = [("junction", record.junction)]
    if isinstance(record, RecordedItem):
        pairs.append(("recording", record.recording))
    else:
        pairs += [("class", record.cls), ("scenario", record.scenario), ("configuration", record.cfg)]
        pairs += [("rotation", record.rotation)]
        pairs += [] if record.seat is None else [("seat", record.seat), ("traffic", record.traffic)]
        pairs += [("pedestrians", record.pedestrians)] if record.pedestrians else []
    pairs += [("variant", record.variant)] if record.variant else []
    pairs += [("rule", record.rule or record.test), ("verdict", record.status.value)]
    pairs += [("change", record.change)] if record.change else []
    pairs += [("driver", record.driver), ("simulator", record.simulator)] if isinstance(record, SimulatedItem) else []
    return pairs


def of_run(run: Run) -> dict[str, Any]:
    """Return the fields of a record that follow from its run, except verdicts and indicators, by name."""
    fields = {"hash": run.hash, "place": run.junction.digest[:12], "duration": run.duration, "agents": took_part(run)}
    return fields | measured(run)


def took_part(run: Run) -> tuple[AgentRecord, ...]:
    """Return the agents of a run, each with arm and lane of its entrance and of its exit."""
    junction = run.junction
    entrances, exits = ([(lane.arm, lane.lane) for lane in lanes] for lanes in (junction.starts, junction.ends))
    return tuple(
        AgentRecord(name=agent.name, kind=agent.kind.value, entrance=entrances[agent.entrance], exit=exits[agent.exit])
        for agent in run.agents
    )


def kept_run(folder: Path, record: Record) -> Path:
    """Return the path of the file in which `folder` keeps a run: the id of the test item without the rule."""
    before, run, after = record.nodeid.partition(record.run or record.nodeid)
    if record.rule:
        after = after.replace(f"-{record.rule}", "", 1)
    return folder / f"{slug(before + run + after)}.npz"


def measured(run: Run) -> dict[str, Any]:
    """Return the fields of a record on the drivers of a run: ``timing`` and ``excess``, each None if no driver has entries."""
    fields: dict[str, Any] = {}
    for name, kind in (("timing", Computing), ("excess", Excess)):
        entry, by_vehicle = run.provenance.get(name), {}
        for vehicle, value in entry.items() if isinstance(entry, Mapping) else ():
            with suppress(msgspec.ValidationError):
                by_vehicle[str(vehicle)] = msgspec.convert(value, kind)
        fields[name] = by_vehicle or None
    return fields


def by_rule(run_record: Record) -> Iterator[Record]:
    """Yield a record per verdict on a run, like the records of test items in a session."""
    kind: type[Record] = RecordedItem if isinstance(run_record, RecordedItem) else SimulatedItem
    shared = {name: getattr(run_record, name) for name in kind.__struct_fields__}
    for verdict in run_record.verdicts:
        result, requirements = verdict.outcome, (verdict.requirement,) if verdict.requirement else ()
        nodeid = f"{run_record.nodeid}-{verdict.rule}"
        start = kind(**shared | {"nodeid": nodeid, "rule": verdict.rule, "requirements": requirements})
        outcome = "failed" if result.bad else "skipped" if result.meaning == "idle" else "passed"
        error = Outcome.ERROR if result is Outcome.ERROR else None
        # The reason for a missing verdict has the same text for every rule, so that all such failures of a run have one cause.
        text = verdict.reason or verdict.message if error else verdict.message
        yield conclude(start, [verdict], "call", outcome, text=text, error=error)

"""Causes of failures: groups the failing test items that probably have the same fault of the driver as their cause.

One fault breaks several rules of a run: a vehicle that enters too early also breaks rules about the vehicles that it meets. The
first violation of a run explains the later failures of the run, except violations for which only other vehicles are to blame.
Runs with the same first violation form a cause, whichever vehicle violated the rule. Grouping every failure by rule, violation
and roles instead gave three times as many groups as faults, measured with mutants of the reference driver
(tests/report/test_triage.py).

An unavoidable violation explains no other failure and is a separate cause.

A cause names the variants of its tests (the values of their other parameters) if only some variants have the cause.
"""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from operator import itemgetter

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.support.wording import first, natural, plural

_RULES = 3
"""Largest number of rules named per cause; further rules are counted."""
_VARIANTS = 5
"""Largest number of variants named per cause; further variants are counted."""
_IDS = 1000
"""Largest number of items of a cause whose ids are kept; further items are counted."""
_SEATS = 3
"""Seats of the subject (entrances of the vehicle under test) are named in a cause that concerns at most this many seats."""
_INSTANCES = 3
"""Largest number of unsure instances that are described per test item; further instances are counted."""
_VARIES = re.compile(r"0x[0-9a-fA-F]+|\d+([.,]\d+)*(e[+-]?\d+)?")
"""Matches the parts in which messages of one fault differ: vehicle numbers, times, line numbers, memory addresses."""
_YIELDING = ("left_yields", "yield_sign", "priority", "right_before_left", "merge", "crosswalk", "crosswalk_turning")
_GRAVE = ("no_collision", "no_conflict", "red", "right_on_red", *_YIELDING)
"""Rules of the first causes in a report, the gravest first: contact, meeting in the junction, then failing to yield."""
_OWN = (*_GRAVE[2:], "p4", "full_stop", "speed_limit", "keep_lane", "on_route", "on_lane_allowed")
"""Rules that a vehicle never breaks merely because another vehicle has broken a rule before."""


def verdict_of(record: Record) -> Verdict | None:
    """Return the verdict from which a record has its status; None if the status comes from an error or an exception."""
    if record.status is Outcome.ERROR:
        return None
    return next((verdict for verdict in record.verdicts if record.status in (verdict.outcome, verdict.status)), None)


def violated(record: Record) -> str:
    """Return the violated obligation or the error of a record in words."""
    if record.status is Outcome.FLAKY:
        repeated = record.flaky and record.flaky.what == "status"
        return f"not deterministic: the same start gave another {'verdict' if repeated else 'run'}"
    if record.status is Outcome.UNSURE:
        return hanging(record)
    verdict = verdict_of(record)
    if verdict is None:
        return first_line(record).removeprefix(f"{record.asks} {Outcome.ERROR}: ")
    owed = verdict.violated.removeprefix("open: ")
    return verdict.violated if owed == verdict.violated else f"still owed at the end of the run: {owed}"


def hanging(record: Record) -> str:
    """Return the doubts (events within the accuracy of a recording) that make the verdict of a record UNSURE, in words."""
    verdict = verdict_of(record)
    if verdict is None:
        return first_line(record)
    unsure = [instance for instance in verdict.instances if instance.status is Status.UNSURE and instance.hangs]
    doubts = [f"{', '.join(f'{name}={value}' for name, value in i.binding)}: {i.hangs}" for i in unsure]
    doubts = doubts or [verdict.reason]
    more = len(doubts) - _INSTANCES
    return "; ".join(doubts[:_INSTANCES]) + (f" and {more} more" if more > 0 else "") or first_line(record)


def first_line(record: Record) -> str:
    """Return the first line of a record's message."""
    return record.message.strip().partition("\n")[0]


def signature(record: Record) -> Hashable:
    """Return a key that is equal for records with the same cause, without the parts of messages that differ."""
    verdict, text = verdict_of(record), violated(record)
    if verdict is not None:
        # Violations of a rule that no vehicle could have kept are one cause, whatever their status.
        return "" if verdict.unavoidable else record.status, text
    # A fault of a stack is one cause, whatever rules would have judged its runs. So is a stack that is not deterministic.
    rule = "" if record.status in (Outcome.ERROR, Outcome.FLAKY) else record.asks
    return record.status, rule, _VARIES.sub("#", text)


def gravity(rules: Iterable[str]) -> int:
    """Return the rank of the gravest of some rules in the order of causes; a lower rank is graver."""
    return min((_GRAVE.index(rule) for rule in rules if rule in _GRAVE), default=len(_GRAVE))


@dataclass(frozen=True, slots=True)
class Cause:
    """A cause of failures: the failures of runs with the same first violation."""

    rules: tuple[str, ...]
    """The violated rules, the gravest first; of equally grave rules the rule that was first violated comes first."""
    text: str
    """First violation, without the vehicles."""
    nodeids: tuple[str, ...]
    """Node ids of the first items with this cause."""
    count: int
    runs: int
    example: str
    """Node id of the first test item that found the first violation."""
    roles: str = ""
    """The most frequent roles of the responsible vehicles, up to rotation; empty if the roles are the same in all runs."""
    junctions: int = 0
    """Number of junctions with this cause; 0 if the number is not reported."""
    title: str = ""
    """Title of the first rule in `rules`; empty unless that rule was violated first."""
    variants: tuple[str, ...] = ()
    """Variants of the test with this cause; empty if all variants have the cause."""
    seats: tuple[int, ...] = ()
    """Seats of the subject with this cause; empty if all tested seats, or more than a few seats, have the cause."""

    @property
    def rule(self) -> str:
        """The rules in a few words, the first with its title if the title differs from the name of the rule."""
        titled = self.title and self.title.casefold() != self.rules[0].replace("_", " ").casefold()
        return first((f"{self.rules[0]} ({self.title})" if titled else self.rules[0], *self.rules[1:]), _RULES)

    @property
    def line(self) -> str:
        """The cause in one line."""
        at = f" at {plural(self.junctions, 'junction')}" if self.junctions else ""
        where = f", in {plural(self.runs, 'run')}{at}" if self.runs > 1 else ""
        only = f", only {first(self.variants, _VARIANTS)}" if self.variants else ""
        only += f", only {'seats' if len(self.seats) > 1 else 'seat'} {', '.join(map(str, self.seats))}" if self.seats else ""
        return f"{self.text}{where}{f', mostly {self.roles}' if self.roles else ''}{only}"


@dataclass(slots=True)
class _Part:
    """A failure of a run, together with the later failures of the run that this failure explains."""

    number: int
    """Position of the first of these failures among all failures."""
    signature: Hashable
    text: str
    record: Record
    title: str = ""
    roles: str | None = None
    """Roles of the responsible vehicles; None if the failure has no verdict, or is grouped by a text alone."""
    explained: list[Record] = field(default_factory=list)


class ByText:
    """Groups records by a text, such as the reason of a known failure; a record whose text is None is left out."""

    def __init__(self, text: Callable[[Record], str | None]) -> None:
        self._text = text
        self._chosen: list[tuple[Record, str]] = []
        self._variants: dict[str, set[str]] = defaultdict(set)
        """All variants (values of the other parameters) of each test."""
        self._seats: set[int | None] = set()

    def add(self, record: Record) -> None:
        """Add a record to the group of its text."""
        test, variant = _variant(record)
        self._variants[test].add(variant)
        self._seats.add(getattr(record, "seat", None))
        text = self._text(record)
        if text is not None:
            self._chosen.append((record, text))

    def _parts(self) -> Iterator[_Part]:
        for number, (record, text) in enumerate(self._chosen):
            yield _Part(number, text, text, record)

    def causes(self, junctions: bool = False) -> list[Cause]:
        """Return the causes, the gravest first, then the most frequent; `junctions` asks for numbers of junctions."""
        groups: dict[Hashable, list[_Part]] = {}
        for part in self._parts():
            groups.setdefault(part.signature, []).append(part)
        ranked = [self._ranked(parts, junctions) for parts in groups.values()]
        return [cause for _, cause in sorted(ranked, key=itemgetter(0))]

    def _ranked(self, parts: list[_Part], junctions: bool) -> tuple[tuple[int, int, int], Cause]:
        """Return the cause of the failures of a group after its rank among the causes."""
        example = min(parts, key=lambda part: part.number)
        records = [record for part in parts for record in (part.record, *part.explained)]
        errors = any(record.status in (Outcome.ERROR, Outcome.FLAKY) for record in records)
        grave = -1 if errors else gravity(record.asks for record in records)
        roles_by_run: dict[str, str | None] = {}
        for part in parts:
            roles_by_run.setdefault(part.record.ran_as, part.roles)
        roles = Counter(run_roles for run_roles in roles_by_run.values() if run_roles is not None)
        rule = example.record.asks
        rules = sorted(dict.fromkeys((rule, *(record.asks for record in records))), key=lambda name: gravity((name,)))
        places = {_variant(record) for record in records}
        variants = {variant for _, variant in places}
        if "" in variants or variants >= set().union(*(self._variants[test] for test, _ in places)):
            variants = set()
        seats = {record.seat for record in records if isinstance(record, SimulatedItem) and record.seat is not None}
        cause = Cause(
            rules=tuple(rules),
            text=f"{example.text} ({example.roles})" if len(roles) == 1 and example.roles else example.text,
            nodeids=tuple(record.nodeid for record in records[:_IDS]),
            count=len(records),
            runs=len(roles_by_run),
            example=example.record.nodeid,
            roles=roles.most_common(1)[0][0] if len(roles) > 1 else "",
            junctions=len({part.record.junction for part in parts}) if junctions else 0,
            title=example.title if rules[0] == rule else "",
            seats=tuple(sorted(seats)) if len(seats) <= _SEATS and seats < self._seats else (),
            variants=tuple(sorted(variants, key=natural)),
        )
        return (grave, -len(records), example.number), cause


class ByCause(ByText):
    """Groups the records that are `chosen` by the first violation of their run; each group is a cause."""

    def __init__(self, chosen: Callable[[Record], bool]) -> None:
        super().__init__(lambda record: violated(record) if chosen(record) else None)

    def _parts(self) -> Iterator[_Part]:
        """Yield the failures that no other failure explains.

        The first violation of a run explains later failures, unless only other vehicles are to blame. The first violation also
        explains every open obligation: if a crash ends a run, other vehicles still wait at their lights.
        """
        runs: dict[str, list[tuple[tuple[bool, float, str], _Part, Verdict]]] = defaultdict(list)
        for number, (record, text) in enumerate(self._chosen):
            verdict = verdict_of(record)
            if verdict is None:
                yield _Part(number, signature(record), text, record)
                continue
            part = _Part(number, signature(record), text, record, verdict.title, verdict.roles)
            if record.hash and not verdict.unavoidable:
                # An obligation becomes overdue at the end of the run, whenever it began.
                due = record.status is Outcome.OPEN, math.inf if verdict.time is None else verdict.time, record.asks
                runs[record.ran_as].append((due, part, verdict))
            else:
                yield part
        for failures in runs.values():
            first_failures: list[tuple[_Part, set[str]]] = []
            for _, part, verdict in sorted(failures, key=itemgetter(0)):
                # Vehicles that are to blame for any instance, and vehicles that are to blame for the first instance.
                to_blame = set(verdict.responsible)
                first_to_blame = set(verdict.instances[0].responsible if verdict.instances else verdict.responsible)
                for earlier, blamed in first_failures:
                    own = part.record.asks in _OWN and earlier.record.asks in _OWN
                    independent = own and to_blame and blamed and part.record.status is not Outcome.OPEN
                    if not independent or to_blame & blamed:
                        earlier.number = min(earlier.number, part.number)
                        earlier.explained.append(part.record)
                        blamed |= first_to_blame
                        break
                else:
                    first_failures.append((part, first_to_blame))
            yield from (part for part, _ in first_failures)


def _variant(record: Record) -> tuple[str, str]:
    """Return the test of a record (file and function) and its variant; both are empty for a record without a variant."""
    # All records without a variant have the same result, because a campaign would have a million different results.
    return (record.nodeid.partition("[")[0], record.variant) if record.variant else ("", "")


def _idle(record: Record) -> str | None:
    without_verdict = not (record.failed or record.known or record.outcome == "passed" or record.status is Outcome.UNSURE)
    return first_line(record) if without_verdict and record.message else None


causes = partial(ByCause, lambda record: record.failed)
"""Makes a collector of unexpected failures by their cause."""
provoked = partial(ByCause, lambda record: record.status is Outcome.PROVOKED)
unavoidable = partial(ByCause, lambda record: record.status is Outcome.UNAVOIDABLE and not record.failed)
unsure = partial(ByText, lambda record: hanging(record) if record.status is Outcome.UNSURE and not record.failed else None)
known = partial(ByText, lambda record: record.known or None)
"""Makes a collector of known failures by the reason that their xfail marks give."""
idle = partial(ByText, _idle)
"""Makes a collector of items without a verdict, such as NA or NOT RUN, by their reason."""

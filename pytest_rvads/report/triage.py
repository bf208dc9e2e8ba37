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

from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable
from dataclasses import dataclass

from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.faults import explains, first_line, hanging, signature, time_of, verdict_of, violated
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.support.wording import first, natural, plural

Variant = tuple[str, str]
"""A test and its variant; both are empty for a record without a variant."""


class Variants:
    """Collects the variants of tests (values of their other parameters), and selects the variants that a cause names."""

    def __init__(self) -> None:
        self._variants: dict[str, set[str]] = {}
        """All variants of each test."""

    def add(self, record: Record) -> None:
        """Add the variant of a record."""
        if record.variant:
            test, variant = variant_of(record)
            self._variants.setdefault(test, set()).add(variant)

    def only(self, places: Collection[Variant]) -> tuple[str, ...]:
        """Return the given variants in order; empty if these are all variants of their tests, or a test has no variants."""
        tests, chosen = {test for test, _ in places}, {variant for _, variant in places}
        if "" in chosen or chosen >= set().union(*(self._variants.get(test, ()) for test in tests)):
            return ()
        return tuple(sorted(chosen, key=natural))


def variant_of(record: Record) -> Variant:
    """Return the test of a record (file and function) and its variant (values of the test's other parameters)."""
    # All records without a variant have the same result, because a campaign would have a million different results.
    return (record.nodeid.partition("[")[0], record.variant) if record.variant else ("", "")


_RULES = 3
"""Largest number of rules named per cause; further rules are counted."""
_VARIANTS = 5
"""Largest number of variants named per cause; further variants are counted."""
_IDS = 1000
"""Largest number of items of a cause whose ids are kept; further items are counted."""
_GROUPS = 1000
"""Largest number of causes that are distinguished; all further failures form one more cause."""
_OPEN = 10_000
"""Largest number of failing runs that wait for further failures; above this number, the longest waiting run is grouped."""
_SEATS = 3
"""Seats of the subject (entrances of the vehicle under test) are named in a cause that concerns at most this many seats."""
_YIELDING = ("left_yields", "yield_sign", "priority", "right_before_left", "merge", "crosswalk", "crosswalk_turning")
_GRAVE = ("no_collision", "no_conflict", "red", "right_on_red", *_YIELDING)
"""Rules of the first causes in a report, the gravest first: contact, meeting in the junction, then failing to yield."""
_OWN = (*_GRAVE[2:], "p4", "full_stop", "speed_limit", "keep_lane", "on_route", "on_lane_allowed")
"""Rules that a vehicle never breaks merely because another vehicle has broken a rule before."""


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
        more = len(self.rules) - _RULES
        titled = self.title and self.title.casefold() != self.rules[0].replace("_", " ").casefold()
        names = (f"{self.rules[0]} ({self.title})" if titled else self.rules[0], *self.rules[1:_RULES])
        return ", ".join(names) + (f" and {more} more" if more > 0 else "")

    @property
    def line(self) -> str:
        """The cause in one line."""
        at = f" at {plural(self.junctions, 'junction')}" if self.junctions else ""
        where = f", in {plural(self.runs, 'run')}{at}" if self.runs > 1 else ""
        only = f", only {first(self.variants, _VARIANTS)}" if self.variants else ""
        only += f", only {'seats' if len(self.seats) > 1 else 'seat'} {', '.join(map(str, self.seats))}" if self.seats else ""
        return f"{self.text}{where}{f', mostly {self.roles}' if self.roles else ''}{only}"


def _seat(record: Record) -> int | None:
    return record.seat if isinstance(record, SimulatedItem) else None


class _Part:
    """A failure of a run, together with the later failures of the run that this failure explains."""

    def __init__(self, record: Record, signature: Hashable, text: str, verdict: Verdict | None = None) -> None:
        self.signature, self.text = signature, text
        self.verdict, self.time = verdict is not None, time_of(record)
        self.open = record.status is Outcome.OPEN
        self.grave = -1 if record.status in (Outcome.ERROR, Outcome.FLAKY) else gravity((record.asks,))
        self.to_blame = set(verdict.responsible) if verdict is not None else set()
        self.first_to_blame = (
            set(verdict.instances[0].responsible) if verdict is not None and verdict.instances else self.to_blame
        )
        """Vehicles that are to blame for the first instance; `to_blame` has the vehicles that are to blame for any instance."""
        self.seats = {_seat(record)} - {None}
        self.roles = verdict.roles if verdict is not None else ""
        self.title = verdict.title if verdict is not None else ""
        self.example, self.rule = record.nodeid, record.asks
        self.run, self.junction, self.places = record.ran_as, record.junction, {variant_of(record)}
        self.rules, self.ids, self.count, self.number = {record.asks: None}, [record.nodeid], 1, 0

    def join(self, other: _Part) -> None:
        """Add a later failure of the same run that this failure explains."""
        self.rules, self.ids, self.count = self.rules | other.rules, self.ids + other.ids, self.count + other.count
        self.number, self.places = min(self.number, other.number), self.places | other.places
        self.grave, self.first_to_blame, self.seats = (
            min(self.grave, other.grave),
            self.first_to_blame | other.first_to_blame,
            self.seats | other.seats,
        )


class _Group:
    """Collects the failures of all runs with one cause."""

    def __init__(self, first: _Part) -> None:
        self.first = first
        self._rules: dict[str, None] = {}
        self._ids: list[str] = []
        self.count = 0
        self._runs: set[str] = set()
        self._junctions: set[str] = set()
        self._places: set[Variant] = set()
        self._seats: set[int | None] = set()
        self.grave = first.grave
        self._roles: Counter[str] = Counter()

    def take(self, part: _Part) -> None:
        """Add a failure of a run, with the later failures that it explains."""
        if part.number < self.first.number:
            self.first = part
        if part.verdict and part.run not in self._runs:
            self._roles[part.roles] += 1
        self._rules |= part.rules
        self._ids += part.ids[: _IDS - len(self._ids)]
        self.count += part.count
        self._runs.add(part.run)
        self._junctions.add(part.junction)
        self._places |= part.places
        self._seats |= part.seats
        self.grave = min(self.grave, part.grave)

    def cause(self, junctions: bool, variants: Variants, seats: set[int | None]) -> Cause:
        """Return the cause of the collected failures."""
        text, roles = self.first.text, self.first.roles
        if len(self._roles) == 1 and roles:
            text = f"{text} ({roles})"
        most = self._roles.most_common(1)[0][0] if len(self._roles) > 1 else ""
        rules = sorted(dict.fromkeys((self.first.rule, *self._rules)), key=lambda rule: gravity((rule,)))
        few = sorted(seat for seat in self._seats if seat is not None and len(self._seats) <= _SEATS and self._seats < seats)
        return Cause(
            rules=tuple(rules),
            text=text,
            nodeids=tuple(self._ids),
            count=self.count,
            runs=len(self._runs),
            example=self.first.example,
            roles=most,
            junctions=len(self._junctions) if junctions else 0,
            title=self.first.title if rules[0] == self.first.rule else "",
            seats=tuple(few),
            variants=variants.only(self._places),
        )


class ByText:
    """Groups records by a text, such as the reason of a known failure; a record whose text is None is left out."""

    def __init__(self, text: Callable[[Record], str | None]) -> None:
        self._text = text
        self._groups: dict[Hashable, _Group] = {}
        self._variants = Variants()
        self._seats: set[int | None] = set()
        self._number = 0

    def add(self, record: Record) -> None:
        """Add a record to the group of its text."""
        self._variants.add(record)
        self._seats.add(_seat(record))
        text = self._text(record)
        if text is not None:
            self._take(self._with_number(_Part(record, text, text)))

    def _with_number(self, part: _Part) -> _Part:
        self._number = part.number = self._number + 1
        return part

    def _take(self, part: _Part) -> None:
        if part.signature not in self._groups and len(self._groups) >= _GROUPS:
            part.signature, part.text = None, f"something else than the {_GROUPS:,} causes told apart"
            part.roles = part.title = ""
        group = self._groups.get(part.signature) or self._groups.setdefault(part.signature, _Group(part))
        group.take(part)

    def causes(self, junctions: bool = False) -> list[Cause]:
        """Return the causes, the gravest first, then the most frequent; `junctions` asks for numbers of junctions."""
        ranked = sorted(self._groups.values(), key=lambda group: (group.grave, -group.count, group.first.number))
        return [group.cause(junctions, self._variants, self._seats) for group in ranked]


class ByCause(ByText):
    """Groups the records that are `chosen` by the first violation of their run; each group is a cause."""

    def __init__(self, chosen: Callable[[Record], bool]) -> None:
        super().__init__(violated)
        self._chosen = chosen
        self._open: dict[str, list[_Part]] = {}
        """The failures so far, by run."""

    def add(self, record: Record) -> None:
        """Add a record, if it is `chosen`, to the failures of its run."""
        self._variants.add(record)
        self._seats.add(_seat(record))
        if not self._chosen(record):
            return
        part = self._with_number(_Part(record, signature(record), violated(record), verdict_of(record)))
        if not explains(record):
            self._take(part)
        else:
            self._open.setdefault(part.run, []).append(part)
            if len(self._open) > _OPEN:
                self._close(next(iter(self._open)))

    def _close(self, run: str) -> None:
        """Group the failures of a run: the first violation explains later failures, unless only other vehicles are to blame.

        The first violation also explains every open obligation: if a crash ends a run, other vehicles still wait at their lights.
        """
        first_failures: list[_Part] = []
        for part in sorted(self._open.pop(run), key=lambda part: part.time):
            for earlier in first_failures:
                independent = (
                    part.rule in _OWN and earlier.rule in _OWN and part.to_blame and earlier.first_to_blame and not part.open
                )
                if not independent or part.to_blame & earlier.first_to_blame:
                    earlier.join(part)
                    break
            else:
                first_failures.append(part)
        for part in first_failures:
            self._take(part)

    def causes(self, junctions: bool = False) -> list[Cause]:
        """Return the causes, the gravest first, then the most frequent; `junctions` asks for numbers of junctions."""
        for run in list(self._open):
            self._close(run)
        return super().causes(junctions)


def causes() -> ByCause:
    """Return an empty collector that groups the records of unexpected failures by their cause."""
    return ByCause(lambda record: record.failed)


def provoked() -> ByCause:
    """Return an empty collector that groups PROVOKED items by their cause: traffic, not the subject, is to blame."""
    return ByCause(lambda record: record.status is Outcome.PROVOKED)


def unavoidable() -> ByCause:
    """Return an empty collector that groups UNAVOIDABLE test items by their cause, without items that failed."""
    return ByCause(lambda record: record.status is Outcome.UNAVOIDABLE and not record.failed)


def unsure() -> ByText:
    """Return an empty collector that groups UNSURE test items by their doubts, without items that failed."""
    return ByText(lambda record: hanging(record) if record.status is Outcome.UNSURE and not record.failed else None)


def known() -> ByText:
    """Return an empty collector that groups known failures by the reason that their xfail marks give."""
    return ByText(lambda record: record.known or None)


def idle() -> ByText:
    """Return an empty collector that groups test items without a verdict (such as NA or NOT RUN) by their reason."""

    def reason(record: Record) -> str | None:
        without_verdict = not (record.failed or record.known or record.outcome == "passed" or record.status is Outcome.UNSURE)
        return first_line(record) if without_verdict and record.message else None

    return ByText(reason)

"""Causes of failures: which of many failing items have one thing behind them.

One fault breaks several rules of a run: who enters too early also breaks the rules about those he meets. What broke first
explains the rest, so the failures of a run belong together, and runs belong together in which the same was violated first,
whoever it was. Grouping every failure by its own rule, violation and roles instead gave three times as many groups as faults,
measured with mutants of the reference autopilot (tests/report/test_triage.py).

What no autopilot could have avoided explains nothing else and is a cause of its own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable
from dataclasses import dataclass

from pytest_rvads.report.faults import explains, first_line, hanging, signature, time_of, verdict_of, violated
from pytest_rvads.report.outcome import Outcome
from pytest_rvads.report.record import Record, VerdictRecord
from pytest_rvads.report.variants import Variant, Variants, variant_of
from pytest_rvads.wording import first, plural

__all__ = ["ByCause", "ByText", "Cause", "causes", "idle", "known", "provoked", "unavoidable", "unsure"]

_RULES = 3
"""Rules named per cause; the rest is counted."""
_VARIANTS = 5
"""Variants named per cause; likewise."""
_IDS = 1000
"""Items of a cause whose ids are kept; the rest is counted."""
_GROUPS = 1000
"""Causes that are told apart; what comes after them is one more."""
_OPEN = 10_000
"""Runs that may go on failing: of one that fails once more when so many others have begun to, that is a cause of its own."""


@dataclass(frozen=True, slots=True)
class Cause:
    """Failures that look alike: in their runs the same was violated first."""

    rules: tuple[str, ...]
    """The rule that was violated first in the first of the runs, then the others."""
    text: str
    """What was violated first, without who did it."""
    nodeids: tuple[str, ...]
    """Its first items."""
    count: int
    """How many items it broke."""
    runs: int
    example: str
    """Node id of the first item that tells it."""
    roles: str = ""
    """Who did it most often, up to rotation, where it was not always the same."""
    junctions: int = 0
    """At how many, where that is told."""
    title: str = ""
    """Of the rule that was violated first, in words."""
    variants: tuple[str, ...] = ()
    """The variants of tests it concerns, where it leaves out some of them."""

    @property
    def rule(self) -> str:
        """The rules in a few words, the first with its title, where that says more than its name."""
        more = len(self.rules) - _RULES
        told = self.title and self.title.casefold() != self.rules[0].replace("_", " ").casefold()
        names = (f"{self.rules[0]} ({self.title})" if told else self.rules[0], *self.rules[1:_RULES])
        return ", ".join(names) + (f" and {more} more" if more > 0 else "")

    @property
    def line(self) -> str:
        """The cause in one line."""
        at = f" at {plural(self.junctions, 'junction')}" if self.junctions else ""
        where = f", in {plural(self.runs, 'run')}{at}" if self.runs > 1 else ""
        only = f", only {first(self.variants, _VARIANTS)}" if self.variants else ""
        return f"{self.text}{where}{f', mostly {self.roles}' if self.roles else ''}{only}"


class _Part:
    """Failures of one run that have the same behind them, or a single one."""

    def __init__(self, record: Record, signature: Hashable, text: str, verdict: VerdictRecord | None = None) -> None:
        self.signature, self.text = signature, text
        self.verdict, self.time = verdict is not None, time_of(record)
        self.roles = verdict.roles if verdict else ""
        self.title = verdict.title if verdict else ""
        self.example, self.rule = record.nodeid, record.asks
        self.run, self.junction, self.places = record.ran_as, record.junction, {variant_of(record)}
        self.rules, self.ids, self.count, self.number = {record.asks: None}, [record.nodeid], 1, 0

    def joined(self, other: _Part) -> _Part:
        """Return this part and one that came later of the same run as one: what broke first tells it."""
        teller = other if other.time < self.time else self
        teller.rules, teller.ids, teller.count = self.rules | other.rules, self.ids + other.ids, self.count + other.count
        teller.number, teller.places = self.number, self.places | other.places
        return teller


class _Group:
    """Parts with one cause."""

    def __init__(self, first: _Part) -> None:
        self.first = first
        self._rules: dict[str, None] = {}
        self._ids: list[str] = []
        self.count = 0
        self._runs: set[str] = set()
        self._junctions: set[str] = set()
        self._places: set[Variant] = set()
        self._roles: Counter[str] = Counter()

    def take(self, part: _Part) -> None:
        """Take a part in."""
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

    def cause(self, junctions: bool, variants: Variants) -> Cause:
        """Return what is told of them, and where `junctions` at how many."""
        text, roles = self.first.text, self.first.roles
        if len(self._roles) == 1 and roles:
            text = f"{text} ({roles})"
        most = self._roles.most_common(1)[0][0] if len(self._roles) > 1 else ""
        return Cause(
            rules=tuple(dict.fromkeys((self.first.rule, *self._rules))),
            text=text,
            nodeids=tuple(self._ids),
            count=self.count,
            runs=len(self._runs),
            example=self.first.example,
            roles=most,
            junctions=len(self._junctions) if junctions else 0,
            title=self.first.title,
            variants=variants.only(self._places),
        )


class ByText:
    """Takes records in and groups those of which the same is told.

    Args:
        text: what is told of a record; None of one that is not among them.
    """

    def __init__(self, text: Callable[[Record], str | None]) -> None:
        self._text = text
        self._groups: dict[Hashable, _Group] = {}
        self._variants = Variants()
        self._number = 0

    def add(self, record: Record) -> None:
        """Take a record in."""
        self._variants.add(record)
        text = self._text(record)
        if text is not None:
            self._take(self._numbered(_Part(record, text, text)))

    def _numbered(self, part: _Part) -> _Part:
        self._number = part.number = self._number + 1
        return part

    def _take(self, part: _Part) -> None:
        if part.signature not in self._groups and len(self._groups) >= _GROUPS:
            part.signature, part.text = None, f"something else than the {_GROUPS:,} causes told apart"
            part.roles = part.title = ""
        group = self._groups.get(part.signature) or self._groups.setdefault(part.signature, _Group(part))
        group.take(part)

    def causes(self, junctions: bool = False) -> list[Cause]:
        """Return the causes, the most frequent first; where `junctions` with at how many."""
        ranked = sorted(self._groups.values(), key=lambda group: (-group.count, group.first.number))
        return [group.cause(junctions, self._variants) for group in ranked]


class ByCause(ByText):
    """Takes records in and groups some of them by what broke first in their run.

    Args:
        chosen: whether a record is one of them.
    """

    def __init__(self, chosen: Callable[[Record], bool]) -> None:
        super().__init__(violated)
        self._chosen = chosen
        self._open: dict[str, _Part] = {}
        """By run what broke first in it so far, with all that this explains."""

    def add(self, record: Record) -> None:
        """Take a record in."""
        self._variants.add(record)
        if not self._chosen(record):
            return
        part = self._numbered(_Part(record, signature(record), violated(record), verdict_of(record)))
        if not explains(record):
            self._take(part)
        elif known := self._open.get(part.run):
            self._open[part.run] = known.joined(part)
        else:
            self._open[part.run] = part
            if len(self._open) > _OPEN:
                self._take(self._open.pop(next(iter(self._open))))

    def causes(self, junctions: bool = False) -> list[Cause]:
        """Return the causes, the most frequent first; where `junctions` with at how many."""
        for part in self._open.values():
            self._take(part)
        self._open.clear()
        return super().causes(junctions)


def causes() -> ByCause:
    """Return what groups unexpected failures by their cause."""
    return ByCause(lambda record: record.failed)


def provoked() -> ByCause:
    """Return what groups what traffic did to a subject that is not to blame, likewise."""
    return ByCause(lambda record: record.status is Outcome.PROVOKED)


def unavoidable() -> ByCause:
    """Return what groups what nobody could have avoided and no test failed for, likewise."""
    return ByCause(lambda record: record.status is Outcome.UNAVOIDABLE and not record.failed)


def unsure() -> ByText:
    """Return what groups what is UNSURE, and failed no test, by what it hangs on."""
    return ByText(lambda record: hanging(record) if record.status is Outcome.UNSURE and not record.failed else None)


def known() -> ByText:
    """Return what groups known failures by what they are known as."""
    return ByText(lambda record: record.known or None)


def idle() -> ByText:
    """Return what groups what neither passed nor failed, is no known failure and not UNSURE, by the reason given."""

    def reason(record: Record) -> str | None:
        rest = not (record.failed or record.known or record.outcome == "passed" or record.status is Outcome.UNSURE)
        return first_line(record) if rest and record.message else None

    return ByText(reason)

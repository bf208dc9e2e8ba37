"""The lines of a file of results: the head, and the result of each case.

The head names the code of this package and of the driver, the rules and the versions. So results of different code never mix, and
a campaign continues after its last result.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Count, SimulatedItem

__all__ = ["FORMAT", "VERSION", "Glance", "Head", "Judged"]


FORMAT, VERSION = "rvads-campaign", 2


class Head(msgspec.Struct, frozen=True, kw_only=True):
    """Facts about all results: the first line of a file, and later lines that add facts."""

    format: str = FORMAT
    version: int = VERSION
    made: dict[str, str]
    """Values on which results depend, by name: package, code, rules, simulator, driver, bodies."""
    drivers: dict[str, str]
    """Identity of each driver, by name of the driver."""
    versions: dict[str, str]
    """Version of each package on which results depend, by name of the package."""
    cases: Count | None = None
    """Number of cases of the campaign; None until the campaign has ended."""
    results: Count = 0
    """Number of results at the end of the campaign; a file with fewer results is incomplete."""
    unfit: dict[str, int] = {}
    """Number of cases left out per junction, because a vehicle has no room at its start."""

    def with_part(self, other: Head) -> Head:
        """Return the head of both parts together; it has ended if both parts have ended."""
        ended = None if self.cases is None or other.cases is None else max(self.cases, other.cases)
        unfit = {name: max(self.unfit.get(name, 0), other.unfit.get(name, 0)) for name in sorted({**self.unfit, **other.unfit})}
        drivers, results = self.drivers | other.drivers, max(self.results, other.results)
        return msgspec.structs.replace(self, drivers=drivers, cases=ended, results=results, unfit=unfit)

    def differs(self, other: Head) -> str:
        """Return the differences to another head in words, or an empty text; drivers of a single head are no difference."""
        pairs = [(word, self.made.get(word), other.made.get(word)) for word in {**self.made, **other.made}]
        pairs += [(f"version of {name}", version, other.versions.get(name)) for name, version in self.versions.items()]
        pairs += [(f"code or values of {name}", key, other.drivers.get(name, key)) for name, key in self.drivers.items()]
        return ", ".join(word for word, own_value, other_value in pairs if own_value != other_value)


class Judged(SimulatedItem, frozen=True, kw_only=True, omit_defaults=True, tag="judged"):
    """The record of a run with the verdict of every rule, in the order of the rules, and which case of a campaign it is.

    The id is that of the run. Of a case without a run every verdict is an ERROR. `by_rule` makes a record per rule of it.
    """

    case: str
    """Hash of the case; a case with a result is not run again."""
    number: Count = 0
    """Position of the case in the campaign."""
    shape: str = ""
    """Junction of the same shape at which the run was simulated; empty if it was simulated at the junction of the case."""
    line: Count = 0
    test: str = ""
    rotation: Count = 0
    seat: Count | None = None
    traffic: str | None = None
    rule: str | None = None
    requirements: tuple[str, ...] = ()
    status: Outcome = Outcome.NOT_RUN
    known: str | None = None
    outcome: str = ""
    message: str = ""

    @property
    def name(self) -> str:
        """Id of the run as in ids of items, without a rule."""
        return self.nodeid


class _Judgement(msgspec.Struct):
    status: Outcome
    unavoidable: bool = False
    provoked: bool = False

    @property
    def outcome(self) -> Outcome:
        return Outcome.UNAVOIDABLE if self.unavoidable else Outcome.PROVOKED if self.provoked else self.status


class Glance(msgspec.Struct):
    """The fields of a `Judged` that tell which cases a file has, and their outcomes."""

    case: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
    number: Count = 0
    verdicts: tuple[_Judgement, ...] = ()

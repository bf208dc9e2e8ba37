"""What stands at the head of a file of results: on what all of them depend.

The head names the code of this package and of the driver, the rules and the versions. So results of different code never mix, and
a campaign continues where it was.
"""

from __future__ import annotations

import msgspec

from pytest_rvads.report.record import Count

__all__ = ["FORMAT", "VERSION", "Head"]

FORMAT, VERSION = "rvads-campaign", 2


class Head(msgspec.Struct, frozen=True, kw_only=True):
    """What a line that is no result says of all results: the first line, and others where more came to be known."""

    format: str = FORMAT
    version: int = VERSION
    made: dict[str, str]
    """What decides results, by words: package, code, rules, simulator, driver, bodies."""
    drivers: dict[str, str]
    """What drives, by name: its identity."""
    versions: dict[str, str]
    """Of what the results depend on: name to version."""
    cases: Count | None = None
    """Number of cases of the campaign; None until the campaign has ended."""
    results: Count = 0
    """Number of results at the end of the campaign; a file with fewer results is incomplete."""
    unfit: dict[str, int] = {}
    """Junction to how many cases were left out because a vehicle has no room where it would start."""

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
        pairs += [(f"code or values of {name}", told, other.drivers.get(name, told)) for name, told in self.drivers.items()]
        return ", ".join(word for word, one, two in pairs if one != two)

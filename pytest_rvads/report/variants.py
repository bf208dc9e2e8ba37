"""Variants of tests, that is, the values of their other parameters, and the variants to name when not all are concerned.

A variant is no part of a cell: it separates rows of tables and cached runs, but coverage counts a situation in whichever variant
it was.
"""

from __future__ import annotations

from collections.abc import Collection

from pytest_rvads.report.record import Record
from pytest_rvads.report.rollup import natural

__all__ = ["Variant", "Variants", "variant_of"]

Variant = tuple[str, str]
"""A test and its variant; both are empty for a record without a variant."""


class Variants:
    """Collects the variants of tests from records, and selects the variants to name."""

    def __init__(self) -> None:
        self._known: dict[str, set[str]] = {}
        """All variants of each test."""

    def add(self, record: Record) -> None:
        """Add a record."""
        if record.variant:
            test, variant = variant_of(record)
            self._known.setdefault(test, set()).add(variant)

    def only(self, places: Collection[Variant]) -> tuple[str, ...]:
        """Return the variants at some places in order; empty if their tests have no other variants, or a test has none."""
        tests, here = {test for test, _ in places}, {variant for _, variant in places}
        if "" in here or here >= set().union(*(self._known.get(test, ()) for test in tests)):
            return ()
        return tuple(sorted(here, key=natural))


def variant_of(record: Record) -> Variant:
    """Return the test of a record, by file and function, and its variant."""
    # Records without a variant share a place: a campaign has a million records, each with an item of its own.
    return (record.nodeid.partition("[")[0], record.variant) if record.variant else ("", "")

"""Variants of tests, the values of their other parameters: which of them something concerns, where not all."""

from __future__ import annotations

from collections.abc import Collection

from pytest_rvads.report.record import Record
from pytest_rvads.report.rollup import natural

__all__ = ["Variant", "Variants", "variant_of"]

Variant = tuple[str, str]
"""A test, and its variant; both are empty where it has none."""


class Variants:
    """Takes records in and tells which variants of a test something concerns."""

    def __init__(self) -> None:
        self._known: dict[str, set[str]] = {}
        """By test all of its variants."""

    def add(self, record: Record) -> None:
        """Take a record in."""
        if record.variant:
            test, variant = variant_of(record)
            self._known.setdefault(test, set()).add(variant)

    def only(self, places: Collection[Variant]) -> tuple[str, ...]:
        """Return the variants at some places in order, where their tests have others; nothing where a test has none."""
        tests, here = {test for test, _ in places}, {variant for _, variant in places}
        if "" in here or here >= set().union(*(self._known.get(test, ()) for test in tests)):
            return ()
        return tuple(sorted(here, key=natural))


def variant_of(record: Record) -> Variant:
    """Return which test a record is of, by its file and function, and in which variant."""
    # One place for all others: a campaign has a million records, each an item of its own.
    return (record.nodeid.partition("[")[0], record.variant) if record.variant else ("", "")

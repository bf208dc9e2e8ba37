"""Records that memory does not hold: every pass makes or reads them anew.

A report goes through its records once. Each part of the outline is a tally that takes records in and keeps only what it reports.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Collection, Iterable, Iterator
from tempfile import TemporaryFile

import msgspec

from pytest_rvads.report.record import Record
from pytest_rvads.support.decoding import encode

__all__ = ["Anew", "Spool"]


class Anew(Collection[Record]):
    """Records that are made anew in every pass, because memory may not hold all of them.

    Args:
        made: begins a pass.
        count: tells how many there are.
    """

    def __init__(self, made: Callable[[], Iterable[Record]], count: Callable[[], int]) -> None:
        self._made, self._count = made, count

    def __iter__(self) -> Iterator[Record]:
        return iter(self._made())

    def __len__(self) -> int:
        return self._count()

    def __contains__(self, record: object) -> bool:
        return any(found == record for found in self)


class Spool(Anew):
    """Records in a file without a name, a line of JSON each; every pass reads them."""

    def __init__(self) -> None:
        self._file = TemporaryFile()  # noqa: SIM115 - closed with the last reference to these records
        self._lines = 0
        weakref.finalize(self, self._file.close)
        super().__init__(self._read, lambda: self._lines)

    def add(self, record: Record) -> None:
        """Write a record down, before any pass begins."""
        self._file.write(encode(record) + b"\n")
        self._lines += 1

    def _read(self) -> Iterator[Record]:
        self._file.seek(0)
        yield from map(msgspec.json.Decoder(Record).decode, self._file)

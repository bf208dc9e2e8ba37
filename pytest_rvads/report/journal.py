"""The journal of a session: a file to which records are written as they arrive, so that records outlive the process.

A report says that it is incomplete until its session has ended. ``rvads report check`` reads the journal of a session that has
not ended, or that died.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from os import fstat
from os.path import samestat
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

import msgspec

from pytest_rvads.report.files import MOST, read
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import UNFINISHED, Report, in_order
from pytest_rvads.support.decoding import encode
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.storage import read_file

_SHOWN = 3
"""Largest number of test items without a verdict that the note on an incomplete session names."""


def journal_of(report: Path) -> Path:
    """Return the path of the journal of the session that writes a report; the journal exists until the session has ended."""
    return report.with_name(f"{report.name}.journal")


def claim(report: Path) -> None:
    """Create an empty journal beside a report unless a journal exists; the journal shows that a new session has begun."""
    with suppress(OSError):
        journal_of(report).touch()


class Journal:
    """Writes records to a file, a line of JSON each, and reads the records back at the end of the session.

    The journal lies beside the report. Without a report, or if no file can be made in its folder, it is a temporary file.
    """

    def __init__(self, report: Path | None) -> None:
        self._path = report and journal_of(report)
        self._file: IO[bytes] | None = None
        if self._path:
            with suppress(OSError):
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._path.unlink(missing_ok=True)
                self._file = self._path.open("x+b", buffering=0)
        if self._file is None:
            with suppress(OSError):
                self._file = TemporaryFile(buffering=0)  # noqa: SIM115 - `close` closes it
        self._unwritten: list[bytes] = []
        """Lines that could not be written to disk."""

    def add(self, record: Record) -> None:
        """Append a record to the file at once."""
        line = b"\n" + encode(record)  # the line end comes first: it ends a line that was cut off
        with suppress(OSError):
            if self._file and self._file.write(line) == len(line):
                return
        self._unwritten.append(line)

    def records(self) -> dict[str, Record]:
        """Return the record of each test item by node id; for an item that was repeated, its last record."""
        if not self._file:
            return _parsed(self._unwritten)
        self._file.seek(0)
        with open(self._file.fileno(), "rb", closefd=False) as lines:
            return _parsed(chain(lines, self._unwritten))

    def remove(self) -> None:
        """Remove the file of the journal, unless another session has replaced the file by its own journal."""
        with suppress(OSError):
            if self._file and self._path and samestat(fstat(self._file.fileno()), self._path.stat()):
                self._path.unlink()

    def close(self) -> None:
        """Close the file, and leave it on disk."""
        if self._file:
            self._file.close()


def _parsed(lines: Iterable[bytes]) -> dict[str, Record]:
    """Return the last record of each node id; lines that are no record, such as a line that was cut off, are skipped."""
    decoder = msgspec.json.Decoder(Record)
    records = {}
    for line in lines:
        with suppress(msgspec.DecodeError, RecursionError):
            record = decoder.decode(line)
            records[record.nodeid] = record
    return records


def recovered(path: Path) -> Report:
    """Read a JSON report; if its session has not ended, add the records of the journal and a note on the missing items."""
    report, journal = read(path), journal_of(path)
    if report.complete:
        if not journal.exists():
            return report
        note = f"of an earlier session: a session that began later has not ended, or died ({journal.name} is still there)"
        return replace(report, exitstatus=UNFINISHED, notes=(note, *report.notes), complete=False)
    records = {record.nodeid: record for record in report.records}
    try:
        with suppress(FileNotFoundError):  # a report that was copied to another folder has no journal there
            records |= _parsed(read_file(journal, MOST).splitlines())
    except OSError as error:
        raise RvadsError(f"{journal} can't be read as the journal of a session: {error}") from error
    all_records = in_order(list(records.values()))
    unjudged = [record.nodeid for record in all_records if not record.outcome]
    known = f": {len(all_records) - len(unjudged)} of {len(all_records)} items have a verdict"
    known += f", the first items without a verdict: {', '.join(unjudged[:_SHOWN])}" if unjudged else ""
    known = known if all_records else " before its items were known"
    note = f"incomplete: the session that writes it has not ended, or died{known}"
    return replace(report, records=all_records, notes=(note,))

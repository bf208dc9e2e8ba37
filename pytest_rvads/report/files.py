"""Writes the report of a session in any format, and reads reports in JSON.

Formats of this module are JSON, the traceability table (comma-separated values), and JUnit XML of reports that are no sessions.

The journal of a session is a file to which records are written as they arrive, so that records outlive the process. A report says
that it is incomplete until its session has ended. ``rvads report check`` reads the journal of a session that has not ended, or
that died.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import fields, replace
from functools import lru_cache
from itertools import chain
from os import fstat
from os.path import samestat
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any
from xml.sax.saxutils import quoteattr

import msgspec

from pytest_rvads.report.markdown import markdown
from pytest_rvads.report.outline import outline
from pytest_rvads.report.record import Record, properties
from pytest_rvads.report.session_report import UNFINISHED, Report, in_order
from pytest_rvads.support.decoding import decode, encode
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.installed import by_suffix
from pytest_rvads.support.installed import load as installed
from pytest_rvads.support.storage import read_file, write_file
from pytest_rvads.support.wording import printable

VERSION = 5
MOST = 2**28
"""Greatest length of a report that is read [bytes]; no session writes a report of this length."""
SUMMARY_LIMIT = 900 * 1024
"""Greatest length of a job summary that is written [bytes]; GitHub drops a job summary above 1 MiB as a whole."""
_SHOWN = 3
"""Largest number of test items without a verdict that the note on an incomplete session names."""


class _Head(msgspec.Struct):
    """The first fields of a report in JSON, which distinguish a report from other files."""

    format: str
    version: int


def fitting(name: str | Path) -> Path:
    """Return the path of a report, after a check that the ending of the path names a format."""
    path = Path(name)
    if path.suffix not in FORMATS:
        raise RvadsError(f"a report is a {', '.join(FORMATS)} file, got {str(path)!r}")
    return path


def save(path: Path, report: Report) -> None:
    """Write a report in the format that the ending of `path` names."""
    write(path, FORMATS[fitting(path).suffix](report, path.parent))


def write(path: Path, content: str | bytes | Iterable[str | bytes]) -> None:
    """Write the content of a report: a text, bytes, or pieces of a content that can be longer than memory."""
    pieces = [content] if isinstance(content, str | bytes) else content
    write_file(path, (piece if isinstance(piece, bytes) else piece.encode("utf-8", "backslashreplace") for piece in pieces))


def append_summary(path: Path, report: Report) -> None:
    """Append a report to the job summary of GitHub Actions; a report that is too long is replaced by a note."""
    text = markdown(report).encode()
    with path.open("ab") as out:
        out.write(text if len(text) <= SUMMARY_LIMIT else b"rvads: too many verdicts for a job summary, see the log\n")


def load(path: Path) -> Report:
    """Read the JSON report of a session that has ended."""
    report = read(path)
    if not report.complete:
        raise RvadsError(f"{path} is incomplete, its session has not ended, or died: take the report of a session that ended")
    return report


def read(path: Path) -> Report:
    """Read the JSON report of a session, even if the report is incomplete."""
    try:
        content = read_file(path, MOST)
        head = msgspec.json.decode(content, type=_Head)
    except msgspec.ValidationError:
        head = _Head("", 0)
    except (OSError, ValueError, RecursionError) as error:
        raise RvadsError(f"{path} can't be read as a report of --rvads-report: {error}") from error
    if (head.format, head.version) != ("rvads-report", VERSION):
        raise RvadsError(f"{path} is not a report of version {VERSION} written by --rvads-report=FILE.json")
    report = decode(content, Report, f"{path} is a damaged report, write it again", RvadsError)
    for record in report.records:
        if wrong := record.contradiction:
            raise RvadsError(f"{path} is a damaged report, write it again: the record of {record.nodeid} {wrong}")
    return replace(report, records=tuple(report.records))


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


def _json(report: Report) -> Iterator[str]:
    """Yield a report as JSON: the fields of the report, a record per line, and the content of the report as text."""
    yield f'{{\n "format": "rvads-report",\n "version": {VERSION},\n "records": ['
    for number, record in enumerate(report.records):
        yield f"{',' if number else ''}\n  {encode(record).decode()}"
    other_fields = {
        **{field.name: getattr(report, field.name) for field in fields(report) if field.name != "records"},
        "outline": [{"title": block.title, "lines": list(block.plain())} for block in outline(report)],
    }
    yield f"\n ],{msgspec.json.format(encode(other_fields), indent=1).decode().removeprefix('{')}"


_COLUMNS = {
    "junction": "junction",
    "control": "control",
    "class": "cls",
    "scenario": "scenario",
    "configuration": "cfg",
    "rotation": "rotation",
    "seat": "seat",
    "traffic": "traffic",
    "recording": "recording",
    "variant": "variant",
    "rule": "rule",
    "verdict": "status",
    "known": "known",
    "driver": "driver",
    "simulator": "simulator",
    "agents": "took_part",
    "run": "hash",
    "item": "nodeid",
}
"""By heading of a column, the attribute of a record that its cells show; a cell is empty if its record lacks the attribute."""
_FORMULA = re.compile(r"[\s'\"\u200b\ufeff]*[=+\-@＝＋－＠\t\r]")
"""Matches the beginning of a text that spreadsheets compute as a formula (OWASP, CSV Injection)."""
_NUMBER = re.compile(r"[+-]?\d+(\.\d*)?(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)


def table(report: Report) -> Iterator[str]:
    """Yield a report as comma-separated values: a row per requirement and test item.

    Items without a requirement come last, with the first column empty. Texts that spreadsheets would take for formulas begin with
    an apostrophe.
    """

    def row(*cells: object) -> str:
        out = io.StringIO()
        texts = (_spreadsheet_text(cell) if isinstance(cell, str) else cell for cell in cells)
        csv.writer(out, lineterminator="\n").writerow(texts)
        return out.getvalue()

    yield row("requirement", *_COLUMNS, "versions", "message")
    versions = "; ".join(f"{name} {version}" for name, version in report.versions.items())
    requirements = {name for record in report.records for name in record.requirements or ("",)}
    for requirement in sorted(requirements, key=lambda name: (name == "", name)):
        for record in report.records:
            if requirement in (record.requirements or ("",)):
                cells = [getattr(record, name, "") for name in _COLUMNS.values()]
                yield row(requirement, *cells, versions, record.message)


@lru_cache(256)  # the rows of a run have most cells in common
def _spreadsheet_text(text: str) -> str:
    """Return a text for a spreadsheet; an apostrophe before it keeps the spreadsheet from computing it as a formula."""
    safe_text = printable(text, len(text))
    return f"'{safe_text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else safe_text


def junit(report: Report) -> Iterator[str]:
    """Yield a report as JUnit XML, a case per item with its properties; that of a session is written by pytest itself."""

    def quoted(value: object) -> str:
        text = "" if value is None else str(value)
        return quoteattr("\n".join(printable(line, len(line)) for line in text.split("\n")))  # XML can't hold all characters

    yield '<?xml version="1.0" encoding="utf-8"?>\n<testsuites>\n<testsuite name="rvads">\n'
    for record in report.records:
        kind = "failure" if record.failed else "" if record.outcome == "passed" else "skipped"
        kind = "error" if record.failed and record.status.meaning in ("error", "flaky") else kind
        end = f"<{kind} message={quoted(record.known or record.message or record.status)}/>" if kind else ""
        elements = "".join(f"<property name={quoted(key)} value={quoted(value)}/>" for key, value in properties(record))
        head = f"<testcase classname={quoted(record.junction)} name={quoted(record.nodeid)}>"
        yield f"{head}<properties>{elements}</properties>{end}</testcase>\n"
    yield "</testsuite>\n</testsuites>\n"


FORMATS: dict[str, Callable[[Report, Path], Any]] = {
    ".json": lambda report, _: _json(report),
    ".html": lambda report, folder: installed("pages", "report")(report, folder),
    ".md": lambda report, _: markdown(report),
    ".csv": lambda report, _: table(report),
    ".xml": lambda report, _: junit(report),
    **by_suffix("reports"),
}
"""Per suffix, a function of a report and of the folder of the new file that returns the content of the file for `write`.

Links in the file start from its folder. Formats of other packages are entry points ``rvads.reports``, named by the suffix.
"""

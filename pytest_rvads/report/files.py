"""Writes the report of a session in any format, and reads reports in JSON.

Formats of this module are JSON, Markdown (for example for GitHub's job summary; most parts below the causes of failures are
folded), the traceability table (comma-separated values), and JUnit XML of reports that are no sessions.

The journal of a session is a file to which records are written as they arrive, so that records outlive the process. A report says
that it is incomplete until its session has ended. ``rvads report check`` reads the journal of a session that has not ended, or
that died.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from functools import lru_cache
from itertools import chain, groupby
from os import fstat
from os.path import samestat
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any
from xml.sax.saxutils import quoteattr

import msgspec

from pytest_rvads.report.matrix import Matrix
from pytest_rvads.report.outline import FAILURES, Block, Causes, Changes, Figures, Head, Notes, RollUp, Section, outline
from pytest_rvads.report.record import Record, properties
from pytest_rvads.report.rollup import WORST
from pytest_rvads.report.session_report import UNFINISHED, Report, in_order
from pytest_rvads.support.decoding import decode, encode
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.installed import by_suffix
from pytest_rvads.support.installed import load as installed
from pytest_rvads.support.storage import read_file, write_file
from pytest_rvads.support.wording import printable, quoted

VERSION = 5
MOST = 2**28
"""Greatest length of a report that is read [bytes]; no session writes a report of this length."""
SUMMARY_LIMIT = 900 * 1024
"""Greatest length of a job summary that is written [bytes]; GitHub drops a job summary above 1 MiB as a whole."""
_LINES = 50
"""Largest number of lines of a list that are not folded."""
_ESCAPES = (
    (re.compile(r"&(?=[#\w])"), "&amp;"),  # entities
    (re.compile(r"<(?=[A-Za-z/!?])"), "&lt;"),  # HTML, addresses in angle brackets
    (re.compile(r"^[-+>#\[]|[\\`*~$|]|(?<![^\W_])_|_(?![^\W_])|\](?=[(\[])"), r"\\\g<0>"),  # blocks, spans, cells, links
    (re.compile(r"(?i)\b(javascript|vbscript|data|file|http|ftp|mailto|xmpp)(?=:)|\bwww(?=\.)"), r"\g<0>\\"),  # bare addresses
    (re.compile(r"(?<!\w)@(?=\w)|(?<![\w;])#(?=\d)"), "\\g<0>\N{WORD JOINER}"),  # mentions, numbers of issues
)
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


def markdown(report: Report) -> str:
    """Return a report as Markdown; all parts but the session, the changes, the causes of failures and the sums are folded."""
    blocks = outline(report)
    shown, closed = [block for block in blocks if not _fold_title(block)], [block for block in blocks if _fold_title(block)]
    lines = ["# rvads verdicts"]
    for block in sorted(shown, key=lambda block: isinstance(block, RollUp)):
        lines += ["", *_render(block)]
    for title, several in groupby(closed, _fold_title):
        folded_lines = [line for block in several for line in ("", *_render(block))]
        lines += ["", f"<details><summary>{title}</summary>", *folded_lines, "", "</details>"]
    return "\n".join(lines) + "\n"


def _fold_title(block: Block) -> str:
    """Return the summary line of a folded part, without text from elsewhere because the line is HTML; empty for other parts."""
    if isinstance(block, Notes | Head | Changes | RollUp) or block.title == FAILURES:  # the length of sums is bounded
        return ""
    match block:
        case Matrix():
            return "verdict tables"
        case Figures(title=title):
            return f"{title} and figures"
    return block.title


def section(part: Section) -> Iterator[str]:
    """Yield a section of a comparison: a heading with a table, or with a list if there are no columns; long content is folded."""
    yield from (f"## {_escaped(part.title)}", "")
    if part.columns:
        rows = [_table_row(text for text, _ in cells) for cells in part.rows]
        yield from _folded_markdown((_table_row(part.columns), f"|{'---|' * len(part.columns)}"), rows, "rows")
    else:
        yield from _folded_markdown((), [f"- {_escaped(line)}" for line in part.lines], "lines", _LINES)


def _render(block: Block) -> Iterator[str]:
    match block:
        case Notes():
            yield "\n\n".join(f"**{_escaped(note)}**" for note in block.lines)
        case Changes(comparison):
            yield from (_heading(block.title), "", _escaped(comparison.headline), "")
            yield from _folded_markdown((), [f"- {_escaped(line)}" for line in comparison.lines()], "changes", _LINES)
        case Causes(title, causes, again):
            head = f"| items | rule | cause | {_escaped(f'first: {again}' if again else 'first')} |", "|---:|---|---|---|"
            rows = []
            for cause in causes:
                example = quoted(cause.example) if again else cause.example
                needs_escapes = re.search(r"[`\\|\s]", example)  # and a code span can't have escapes
                shown = _escaped(example) if needs_escapes else f"`{printable(example, len(example))}`"
                rows.append(f"| {cause.count} | {_escaped(cause.rule)} | {_escaped(cause.line)} | {shown} |")
            yield from (_heading(title), "", *_folded_markdown(head, rows, "causes"))
        case Head() | Figures():
            lines = block.lines if isinstance(block, Figures) else block.plain()
            yield from _folded_markdown((), [f"- {_escaped(line)}" for line in lines], "lines", _LINES)
            if isinstance(block, Figures) and block.arrivals:
                yield from ("", *section(block.arrivals))
        case RollUp(sums):
            yield _heading(block.title)
            for table in sums:
                head = _table_row(table.columns), "|" + "".join("---|" if side == "left" else "---:|" for side in table.sides)
                yield from ("", *_folded_markdown(head, [_table_row(table.cells(row)) for row in table.rows], f"{table.corner}s"))
        case Matrix() as matrix:
            yield from (f"## {_escaped(matrix.title)}", "")
            columns = [f"{matrix.numbers.get(cfg, cfg)} {rule}".lstrip() for cfg, rule in matrix.columns]
            head = _table_row([matrix.corner, *columns]), "|---|" + "---|" * len(columns)
            rows = [_table_row([label, *(entry.text for entry in entries)]) for label, entries in matrix.rows]
            yield from _folded_markdown(head, rows, "rows")
            if matrix.numbers:
                yield from ("", *(f"- {_escaped(f'{number} = {label}')}" for label, number in matrix.numbers.items()))


def _folded_markdown(head: tuple[str, ...], rows: Sequence[str], what: str, most: int = WORST) -> Iterator[str]:
    """Yield a table or a list as Markdown; the rows after the first `most` rows are folded."""
    yield from (*head, *rows[:most])
    if more := rows[most:]:
        yield from ("", f"<details><summary>{len(more)} more {what}</summary>", "", *head, *more, "", "</details>")


def _table_row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(map(_escaped, cells))} |"


def _heading(title: str) -> str:
    return f"## {title[0].upper()}{title[1:]}"


def _escaped(text: str) -> str:
    """Return a text on one line, escaped so that Markdown reads no markup, HTML, link or mention in it."""
    line = printable(text, len(text)).translate({ord("\n"): " ", ord("\t"): " "})
    for special, escaped in _ESCAPES:
        line = special.sub(escaped, line)
    return line


def junit(report: Report) -> Iterator[str]:
    """Yield a report as JUnit XML, a case per item with its properties; that of a session is written by pytest itself."""

    def attribute(value: object) -> str:
        text = "" if value is None else str(value)
        return quoteattr("\n".join(printable(line, len(line)) for line in text.split("\n")))  # XML can't hold all characters

    yield '<?xml version="1.0" encoding="utf-8"?>\n<testsuites>\n<testsuite name="rvads">\n'
    for record in report.records:
        kind = "failure" if record.failed else "" if record.outcome == "passed" else "skipped"
        kind = "error" if record.failed and record.status.meaning in ("error", "flaky") else kind
        end = f"<{kind} message={attribute(record.known or record.message or record.status)}/>" if kind else ""
        elements = "".join(f"<property name={attribute(key)} value={attribute(value)}/>" for key, value in properties(record))
        head = f"<testcase classname={attribute(record.junction)} name={attribute(record.nodeid)}>"
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

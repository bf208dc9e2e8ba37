"""A session's report on disk: the table of formats, writing, and reading JSON back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from pytest_rvads.report.junit import junit
from pytest_rvads.report.markdown import markdown
from pytest_rvads.report.outline import outline
from pytest_rvads.report.page import page
from pytest_rvads.report.session_report import Report
from pytest_rvads.report.traceability import table
from pytest_rvads.support.decoding import decode, encode
from pytest_rvads.support.entrypoints import entries
from pytest_rvads.support.entrypoints import load as load_entry
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.storage import read_file, write_file

__all__ = ["FORMATS", "MOST", "append_summary", "fitting", "load", "read", "save", "write"]


VERSION = 5
MOST = 2**28
"""A report is refused that is longer than any session writes it [bytes]."""
SUMMARY_LIMIT = 900 * 1024
"""GitHub drops a job summary above 1 MiB as a whole [bytes]."""


class _Head(msgspec.Struct):
    """What tells a report from other files."""

    format: str
    version: int


def fitting(name: str | Path) -> Path:
    """Return the path of a report, before anything is spent on the report.

    Raises:
        RvadsError: the ending names no format.
    """
    path = Path(name)
    if path.suffix not in FORMATS:
        raise RvadsError(f"a report is a {', '.join(FORMATS)} file, got {str(path)!r}")
    return path


def save(path: Path, report: Report) -> None:
    """Write a report in the format that the ending of `path` names.

    Raises:
        RvadsError: another ending.
        OSError: the file can't be written.
    """
    write(path, FORMATS[fitting(path).suffix](report, path.parent))


def write(path: Path, content: str | bytes | Iterable[str | bytes]) -> None:
    """Write the content of a report: a text, bytes, or pieces of a content that may be longer than memory.

    Raises:
        OSError: the file can't be written.
    """
    pieces = [content] if isinstance(content, str | bytes) else content
    write_file(path, (piece if isinstance(piece, bytes) else piece.encode("utf-8", "backslashreplace") for piece in pieces))


def append_summary(path: Path, report: Report) -> None:
    """Append a report to the job summary of GitHub Actions, or say that it is too long for one.

    Raises:
        OSError: the file can't be written.
    """
    text = markdown(report).encode()
    with path.open("ab") as out:
        out.write(text if len(text) <= SUMMARY_LIMIT else b"rvads: too many verdicts for a job summary, see the log\n")


def load(path: Path) -> Report:
    """Read the JSON report of a session that came to its end.

    Raises:
        RvadsError: as `read` does; or it is incomplete.
    """
    report = read(path)
    if not report.complete:
        raise RvadsError(f"{path} is incomplete, its session has not ended, or died: take the report of one that did")
    return report


def read(path: Path) -> Report:
    """Read a JSON report, also an incomplete one.

    Raises:
        RvadsError: not a report, or one of another version, or damaged: where, and what was expected there; or with a record that
            contradicts itself.
    """
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


def _json(report: Report) -> Iterator[str]:
    """Yield a report as JSON: what it is made of, to be read back, a record per line, and under ``outline`` what it says."""
    yield f'{{\n "format": "rvads-report",\n "version": {VERSION},\n "records": ['
    for number, record in enumerate(report.records):
        yield f"{',' if number else ''}\n  {encode(record).decode()}"
    rest = {
        **{field.name: getattr(report, field.name) for field in fields(report) if field.name != "records"},
        "outline": [{"title": block.title, "lines": list(block.plain())} for block in outline(report)],
    }
    yield f"\n ],{msgspec.json.format(encode(rest), indent=1).decode().removeprefix('{')}"


def _added(name: str, report: Report, folder: Path) -> Any:
    """Return a report in the format of the entry point of that name."""
    return load_entry("reports", name)(report, folder)


FORMATS: dict[str, Callable[[Report, Path], Any]] = {
    ".json": lambda report, _: _json(report),
    ".html": page,
    ".md": lambda report, _: markdown(report),
    ".csv": lambda report, _: table(report),
    ".xml": lambda report, _: junit(report),
    **{f".{name}": partial(_added, name) for name in entries("reports")},
}
"""Per suffix, a function that returns the content of a file for `write`, given the report and the folder from which links lead.

Formats of other packages are entry points ``rvads.reports``, named by the suffix.
"""

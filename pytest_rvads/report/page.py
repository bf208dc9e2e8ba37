"""Makes the self-contained HTML page of a report. The page shows session, causes and failures, and folds all other parts."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from heapq import nsmallest
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.folders import STARTS, option, sessions
from pytest_rvads.report.matrix import SAME, member_of, place_of
from pytest_rvads.report.outline import FAILURES, Block, Causes, Changes, Figures, Head, Notes, RollUp, Section, Verdicts, outline
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.report.session_report import LISTED, Report
from pytest_rvads.report.webpage import webpage
from pytest_rvads.support.wording import markup, printable, quoted

_ITEMS = 5000
"""Largest number of test items on a page: failures are taken first, then further items evenly from all junctions and rules."""
_WEB = re.compile(r"https://[^\\\s]+")
_NO_PATH = re.compile(r"[^/?#]*:| *//|.*[\\\t\n]", re.DOTALL)
"""Matches an address with a scheme or with another host, and texts that browsers would turn into such an address."""
_TERMS = ("began", "driven by", "simulated by", "command:", "", "exit status")
"""The beginnings of the lines of `Head`, in the order of the page; the line on all verdicts begins with their number."""
_UNDRAWN = "not drawn"
"""The beginning of the text that takes the place of a missing replay page; the reason follows."""
_LINES = 10
"""Largest number of lines of the head, of changes, and of lines of a section that are not folded."""
_ROWS = 50
"""Largest number of rows of a table of a section that are not folded."""
_LONG = 40
"""Largest number of characters of a text that is not wrapped in a table."""

Entry = TypeVar("Entry")
Cells = tuple[tuple[str, str], ...]


def page(report: Report, folder: Path) -> str:
    """Return a report as an HTML page."""
    blocks = outline(report, tables=True)
    records = _page_records(report)
    statuses = {record.status for record in records}
    rolled = ""
    sums: list[dict[str, Any]] = []
    groups: list[dict[str, Any]] = []
    for block in blocks:
        if isinstance(block, RollUp):
            rolled += block.title
            for table in block.sums:
                kinds = ["" if kind is None else kind.mark for kind in table.kinds]
                marks = [""] * (1 + len(table.headings)) + kinds
                rows = [table.cells(row) for row in table.rows]
                columns = {"corner": table.corner, "columns": table.columns, "sides": table.sides}
                sums.append({**columns, "marks": marks, "rows": rows})
        elif isinstance(block, Causes):
            causes = [
                {"count": c.count, "rule": c.rule, "text": c.line, "ids": c.nodeids, "first": c.example, "again": block.first(c)}
                for c in block.causes
            ]
            groups.append({"title": block.title, "failed": block.title == FAILURES, "causes": causes})
    session = _session_option(folder)
    content = {
        "items": [_item_data(record, folder, report, session) for record in records],
        "all": len(report.records),
        "sums": sums,
        "rolled": rolled,
        "causes": groups,
        "matrices": [_matrix_data(block) for block in blocks if isinstance(block, Verdicts)],
        "statuses": {outcome: outcome.mark for outcome in Outcome.worst_first() if outcome in statuses},
    }
    return rendered("rvads verdicts", blocks, content, ("pytest_rvads.report", "items"), starts=_starts_link(folder))


def rendered(title: str, blocks: Iterable[Block | Section], content: object, *part: tuple[str, str], **more: str) -> str:
    """Return an HTML page that begins with blocks of a report."""
    shown = list(blocks)
    head = "".join(map(_block_html, shown))
    figures = ""
    for block in shown:
        if isinstance(block, Figures):
            arrivals = _block_html(block.arrivals) if block.arrivals else ""
            lines = f"{_list_html(block.lines)}{arrivals}"
            figures += f"<details class=fold><summary>{block.title} and figures</summary>{lines}</details>"
    sources = [("pytest_rvads.report", "page"), *part]
    return webpage(sources, title, content, heading=markup(title), head=head, figures=figures, **more)


def _page_records(report: Report) -> list[Record]:
    """Return the records of the items that the page shows, in the order of the report."""
    if len(report.records) <= _ITEMS:
        return list(report.records)
    counts: Counter[tuple[int, str, str]] = Counter()

    def ranked() -> Iterator[tuple[int, int, int, Record]]:
        for number, record in enumerate(report.records):
            wrong = record.failed or (record.status.bad and not record.known)
            key = 0 if wrong else 1 if record.known or record.status.mark == "doubt" else 2, record.junction, record.asks
            counts[key] += 1
            yield key[0], counts[key], number, record

    numbered_records = nsmallest(_ITEMS, ranked(), key=lambda row: row[:3])
    return [record for *_, record in sorted(numbered_records, key=lambda row: row[2])]


def _block_html(block: Block | Section) -> str:
    """Return a block as HTML for the beginning of the page; the page's script makes elements that can be clicked."""
    match block:
        case Notes(lines):
            return "".join(f"<p class=note>{markup(note)}</p>" for note in lines)
        case Head(lines):
            return _head_html(lines)
        case Changes(comparison):
            changes = _folded_html(list(comparison.lines()), _LINES, "", _list_html)
            return f"<h2>{block.title}</h2><p>{markup(comparison.headline)}</p>{changes}"
        case Section(title, lines, columns, rows, side):
            content = (
                _folded_html(rows, _ROWS, " rows", partial(_table_html, columns))
                if columns
                else _folded_html(lines, _LINES, " lines", _list_html)
            )
            return f"<section{' class=side' if side else ''}><h2>{markup(title)}</h2>{content}</section>"
    return ""


def _folded_html(entries: Sequence[Entry], most: int, what: str, show: Callable[[Sequence[Entry]], str]) -> str:
    more = entries[most:]
    folded = f"<details><summary>{len(more)} more{what}</summary>{show(more)}</details>" if more else ""
    return f"{show(entries[:most])}{folded}" if entries else ""


def _list_html(lines: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{markup(line)}' for line in lines)}</ul>"


def _table_html(columns: Sequence[str], rows: Sequence[Cells]) -> str:
    """Return a table as HTML; on a narrow screen, rows with long texts become blocks, in which each cell has its heading.

    The path of a replay page becomes a link. A cell in which two sessions do not differ has a style of its own.
    """
    long = any(len(text) > _LONG for _, *cells in rows for text, _ in cells)
    head = "".join(f"<th>{markup(column)}" for column in columns)
    headings = [f' data-column="{markup(column)}"' if long else "" for column in columns]
    body: list[str] = []
    for (label, _), *cells in rows:
        body.append(f"<tr><th{headings[0]}>{markup(label)}")
        for (text, mark), heading in zip(cells, headings[1:], strict=False):
            if mark == "look" and text:
                body.append(f'<td{heading}><a href="{markup(quote(text, safe="/#=."))}">replay</a>')
                continue
            kind = "same" if text == SAME else " ".join([mark, *(["long"] if len(text) > _LONG else [])]).strip()
            body.append(f'<td class="{kind}"{heading}>{markup(text)}')
    style = "matrix texts" if long else "matrix"
    return f'<div class=scroll><table class="{style}"><thead><tr>{head}</thead><tbody>{"".join(body)}</tbody></table></div>'


def _head_html(lines: Sequence[str]) -> str:
    """Return the lines on a session as a list of terms; lines beyond the first few are folded, except the last three."""
    longest_first = sorted(_TERMS, reverse=True)  # the empty term, which begins every line, comes last
    terms = [next(term for term in longest_first if line.startswith(term)) for line in lines]
    rows = [
        f"<div><dt>{term.rstrip(':') or 'result'}</dt><dd>{markup(line.removeprefix(term).lstrip())}</dd></div>"
        for term, line in sorted(zip(terms, lines, strict=True), key=lambda row: _TERMS.index(row[0]))
    ]
    few, more = (rows, []) if len(rows) <= _LINES else (rows[: _LINES - 3] + rows[-3:], rows[_LINES - 3 : -3])
    folded = f"<details><summary>{len(more)} more</summary><dl class=head>{''.join(more)}</dl></details>" if more else ""
    return f"<dl class=head>{''.join(few)}</dl>{folded}"


def _matrix_data(block: Verdicts) -> dict[str, Any]:
    matrix = block.matrix
    rows = [
        (label, [(entry.text, entry.bad) for entry in entries], members)
        for (label, entries), members in zip(matrix.rows, matrix.members, strict=True)
    ]
    return {
        "title": block.title,
        "junction": matrix.junction,
        "corner": matrix.corner,
        "columns": matrix.columns,
        "numbers": matrix.numbers,
        "rows": rows,
    }


def _item_data(record: Record, folder: Path, report: Report, session: str) -> dict[str, Any]:
    group, _, (cfg, rule) = place_of(record)
    driver, simulator = (record.driver, record.simulator) if isinstance(record, SimulatedItem) else ("", "")
    looks = (record.look, *record.looks)
    links = [link for link in (_page_link(look, folder) for look in looks) if link]
    drawn = record.look and not record.look.startswith(_UNDRAWN)
    kept = record.hash and (record.shows if record.failed else report.kept)
    draw = ""
    if kept and not drawn and report.again.startswith("pytest"):
        draw = " ".join(filter(None, ("rvads replay", session, quoted(record.nodeid))))
    return {
        "id": record.nodeid,
        "group": group,
        "junction": record.junction,
        "kind": record.kind,
        "status": record.status,
        "failed": record.failed,
        "known": bool(record.known),
        "change": record.change if record.change in LISTED else "",
        "member": member_of(record),
        "cfg": cfg,
        "rule": rule,
        "text": record.message,
        "driver": driver,
        "simulator": simulator,
        "look": links[0] if links else "",
        "more": links[1:],
        "why": next((look for look in looks if look.startswith(_UNDRAWN)), ""),
        "draw": draw,
    }


def _starts_link(folder: Path) -> str:
    """Return a link to the page of critical starts in the folder of the page or of all sessions; empty if there is none."""
    for path in (folder / STARTS, folder.parent / STARTS):
        if path.is_file():
            return f'<p><a href="{os.path.relpath(path, folder).replace(os.sep, "/")}">critical starts</a></p>'
    return ""


def _session_option(folder: Path) -> str:
    """Return the option that names the session of a folder; an empty text if the folder is not the folder of a session."""
    place = Path(os.path.realpath(folder))  # a link such as `latest` can lead to another session later
    if place not in sessions(place.parent):
        return ""
    with suppress(ValueError):  # no relative path leads to another drive
        place = Path(os.path.relpath(place))
    return option(place)


def _page_link(look: str, folder: Path) -> str:
    """Return a link from a folder to a page; an empty text if the link would be neither a relative path nor https."""
    if look.startswith(_UNDRAWN):
        return ""
    look = printable(look, len(look))  # control characters become backslashes, which are refused
    if _WEB.fullmatch(look):
        return look
    if not look or _NO_PATH.match(look):
        return ""
    path = os.path.relpath(look, folder).replace(os.sep, "/")
    return "" if _NO_PATH.match(path) else path

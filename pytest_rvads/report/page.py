"""A report as a self-contained page: what the session was, causes, failures; all else is folded, and made when it is opened."""

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

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.folders import option, sessions
from pytest_rvads.report.matrix import SAME, member_of, place_of
from pytest_rvads.report.outline import FAILURES, Block, Causes, Changes, Figures, Head, Notes, RollUp, Section, Verdicts, outline
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.report.rollup import Sums
from pytest_rvads.report.session_report import TOLD, Report
from pytest_rvads.report.webpage import webpage
from pytest_rvads.support.wording import markup, printable, quoted

__all__ = ["page", "rendered"]

_ITEMS = 5000
"""Items in a page; of more of them those that went wrong first, from all junctions and rules alike."""
_WEB = re.compile(r"https://[^\\\s]+")
_NO_PATH = re.compile(r"[^/?#]*:| *//|.*[\\\t\n]", re.DOTALL)
"""An address with a scheme, of another host, or what browsers would make one of."""
_TERMS = ("began", "driven by", "simulated by", "command:", "", "exit status")
"""What lines of the head begin with, in the order of the page; the one on all verdicts begins with their number."""
_UNDRAWN = "not drawn"
"""What stands in place of a replay page begins so, and goes on with the reason."""
_LINES = 10
"""Lines of the head, changes, and lines of a section that are not folded."""
_ROWS = 50
"""Rows of a table of a section that are not folded."""
_LONG = 40
"""Characters of the longest text that stands on one line of a table."""

Entry = TypeVar("Entry")
Cells = tuple[tuple[str, str], ...]


def page(report: Report, folder: Path) -> str:
    """Return a report as an HTML page.

    Args:
        report: of a session, or merged.
        folder: where the page will lie, relative to the folder the session was started in; replay pages are linked from there.
    """
    blocks = outline(report, tables=True)
    chosen = _chosen(report)
    seen = {record.status for record in chosen}
    rolled = [block for block in blocks if isinstance(block, RollUp)]
    session = _session(folder)
    content = {
        "items": [_item(record, folder, report, session) for record in chosen],
        "all": len(report.records),
        "sums": [_sums(table) for block in rolled for table in block.sums],
        "rolled": "".join(block.title for block in rolled),
        "causes": [_causes(block) for block in blocks if isinstance(block, Causes)],
        "matrices": [_matrix(block) for block in blocks if isinstance(block, Verdicts)],
        "statuses": {outcome: outcome.mark for outcome in Outcome.worst_first() if outcome in seen},
    }
    return rendered("rvads verdicts", blocks, content, ("pytest_rvads.report", "items"))


def rendered(title: str, blocks: Iterable[Block | Section], content: object, *part: tuple[str, str], **more: str) -> str:
    """Return a page that begins with blocks.

    Args:
        title: the title of the page.
        blocks: the blocks; those that the script of a part shows are left out here.
        content: what the script finds as data.
        part: package and name of the sources of the part of the page below the blocks, if there is one; see `webpage`.
        more: markup that the part has places for.
    """
    shown = list(blocks)
    said = "".join(map(_said, shown))
    figures = "".join(_figures(block) for block in shown if isinstance(block, Figures))
    sources = [("pytest_rvads.report", "page"), *part]
    return webpage(sources, title, content, heading=markup(title), said=said, figures=figures, **more)


def _chosen(report: Report) -> list[Record]:
    """Return the records that the page has, in their order."""
    if len(report.records) <= _ITEMS:
        return list(report.records)
    seen: Counter[tuple[int, str, str]] = Counter()

    def ranked() -> Iterator[tuple[int, int, int, Record]]:
        for number, record in enumerate(report.records):
            wrong = record.failed or (record.status.bad and not record.known)
            key = 0 if wrong else 1 if record.known or record.status.mark == "doubt" else 2, record.junction, record.asks
            seen[key] += 1
            yield key[0], seen[key], number, record

    kept = nsmallest(_ITEMS, ranked(), key=lambda found: found[:3])
    return [record for *_, record in sorted(kept, key=lambda found: found[2])]


def _said(block: Block | Section) -> str:
    """Return a block that the page begins with as HTML; what can be clicked is made on the page."""
    match block:
        case Notes(lines):
            return "".join(f"<p class=note>{markup(note)}</p>" for note in lines)
        case Head(lines):
            return _head(lines)
        case Changes(comparison):
            changes = _folded(list(comparison.lines()), _LINES, "", _list)
            return f"<h2>{block.title}</h2><p>{markup(comparison.headline)}</p>{changes}"
        case Section(title, lines, columns, rows, side):
            told = _folded(rows, _ROWS, " rows", partial(_table, columns)) if columns else _folded(lines, _LINES, " lines", _list)
            return f"<section{' class=side' if side else ''}><h2>{markup(title)}</h2>{told}</section>"
    return ""


def _folded(entries: Sequence[Entry], most: int, what: str, show: Callable[[Sequence[Entry]], str]) -> str:
    """Return entries as HTML; those beyond the first few are folded."""
    more = entries[most:]
    rest = f"<details><summary>{len(more)} more{what}</summary>{show(more)}</details>" if more else ""
    return f"{show(entries[:most])}{rest}" if entries else ""


def _list(lines: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{markup(line)}' for line in lines)}</ul>"


def _table(columns: Sequence[str], rows: Sequence[Cells]) -> str:
    head = "".join(f"<th>{markup(column)}" for column in columns)
    body = "".join(f"<tr><th>{markup(label)}{''.join(map(_cell, cells))}" for (label, _), *cells in rows)
    return f"<div class=scroll><table class=matrix><thead><tr>{head}</thead><tbody>{body}</tbody></table></div>"


def _cell(cell: tuple[str, str]) -> str:
    """Return a cell as HTML, marked by what its text says."""
    text, mark = cell
    kind = "same" if text == SAME else " ".join([mark, *(["long"] if len(text) > _LONG else [])]).strip()
    return f'<td class="{kind}">{markup(text)}'


def _head(lines: Sequence[str]) -> str:
    """Return what the session was as a list of terms; many drivers are folded."""
    rows = [
        f"<div><dt>{term.rstrip(':') or 'found'}</dt><dd>{markup(line.removeprefix(term).lstrip())}</dd></div>"
        for term in _TERMS
        for line in lines
        if _term(line) == term
    ]
    few, more = (rows, []) if len(rows) <= _LINES else (rows[: _LINES - 3] + rows[-3:], rows[_LINES - 3 : -3])
    folded = f"<details><summary>{len(more)} more</summary><dl class=head>{''.join(more)}</dl></details>" if more else ""
    return f"<dl class=head>{''.join(few)}</dl>{folded}"


def _term(line: str) -> str:
    return next(term for term in sorted(_TERMS, reverse=True) if line.startswith(term))


def _figures(block: Figures) -> str:
    figures = "".join(f"<li>{markup(line)}" for line in block.lines)
    return f"<details class=fold><summary>{block.title} and figures</summary><ul>{figures}</ul></details>"


def _causes(block: Causes) -> dict[str, Any]:
    causes = [
        {"count": c.count, "rule": c.rule, "text": c.line, "ids": c.nodeids, "first": c.example, "again": block.first(c)}
        for c in block.causes
    ]
    return {"title": block.title, "failed": block.title == FAILURES, "causes": causes}


def _sums(table: Sums) -> dict[str, Any]:
    marks = [""] * (1 + len(table.headings)) + ["" if kind is None else kind.mark for kind in table.kinds]
    rows = [table.cells(row) for row in table.rows]
    return {"corner": table.corner, "columns": table.columns, "sides": table.sides, "marks": marks, "rows": rows}


def _matrix(block: Verdicts) -> dict[str, Any]:
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


def _item(record: Record, folder: Path, report: Report, session: str) -> dict[str, Any]:
    group, _, (cfg, rule) = place_of(record)
    driver, simulator = (record.driver, record.simulator) if isinstance(record, SimulatedItem) else ("", "")
    looks = (record.look, *record.looks)
    links = [link for link in (_link(look, folder) for look in looks) if link]
    return {
        "id": record.nodeid,
        "group": group,
        "junction": record.junction,
        "kind": record.kind,
        "status": record.status,
        "failed": record.failed,
        "known": bool(record.known),
        "change": record.change if record.change in TOLD else "",
        "member": member_of(record),
        "cfg": cfg,
        "rule": rule,
        "text": record.message,
        "driver": driver,
        "simulator": simulator,
        "look": links[0] if links else "",
        "more": links[1:],
        "why": next((look for look in looks if look.startswith(_UNDRAWN)), ""),
        "draw": _drawing(record, report, session),
    }


def _session(folder: Path) -> str:
    """Return the option that names the session whose folder this is; nothing where it is no session's."""
    place = Path(os.path.realpath(folder))  # a link may lead to another session later
    if place not in sessions(place.parent):
        return ""
    with suppress(ValueError):  # on another drive no path leads there from here
        place = Path(os.path.relpath(place))
    return option(place)


def _drawing(record: Record, report: Report, session: str) -> str:
    """Return the command that draws the replay of an item, where it has a run that may be kept and none is drawn.

    Args:
        record: of the item.
        report: of its session.
        session: the option that names the session; empty takes the latest, where nothing is known of it.
    """
    if record.look and not record.look.startswith(_UNDRAWN):
        return ""
    if not record.hash or not (record.shows if record.failed else report.kept) or not report.again.startswith("pytest"):
        return ""
    return " ".join(filter(None, ("rvads replay", session, quoted(record.nodeid))))


def _link(look: str, folder: Path) -> str:
    """Return a link to a page, for a file in a folder; nothing where that would be neither a relative path nor https."""
    if look.startswith(_UNDRAWN):
        return ""
    look = printable(look, len(look))  # control characters become backslashes, which are refused
    if _WEB.fullmatch(look):
        return look
    if not look or _NO_PATH.match(look):
        return ""
    path = os.path.relpath(look, folder).replace(os.sep, "/")
    return "" if _NO_PATH.match(path) else path

"""A report as Markdown, for GitHub's job summary among others: what the session was and causes first, the rest folded."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

from pytest_rvads.report.outline import FAILURES, Block, Causes, Changes, Figures, Head, Notes, RollUp, Verdicts, outline
from pytest_rvads.report.rollup import WORST
from pytest_rvads.report.session_report import Report
from pytest_rvads.wording import printable, quoted

__all__ = ["markdown", "section"]

_LINES = 50
"""Lines of a list that are not folded."""
_ESCAPES = (
    (re.compile(r"&(?=[#\w])"), "&amp;"),  # entities
    (re.compile(r"<(?=[A-Za-z/!?])"), "&lt;"),  # HTML, addresses in angle brackets
    (re.compile(r"^[-+>#\[]|[\\`*~$|]|(?<![^\W_])_|_(?![^\W_])|\](?=[(\[])"), r"\\\g<0>"),  # blocks, spans, cells, links
    (re.compile(r"(?i)\b(javascript|vbscript|data|file|http|ftp|mailto|xmpp)(?=:)|\bwww(?=\.)"), r"\g<0>\\"),  # bare addresses
    (re.compile(r"(?<!\w)@(?=\w)|(?<![\w;])#(?=\d)"), "\\g<0>\N{WORD JOINER}"),  # mentions, numbers of issues
)


def markdown(report: Report) -> str:
    """Return a report as Markdown: what it was, what changed, and what caused failures; sums; all else folded."""
    blocks = outline(report)
    shown, closed = [block for block in blocks if _open(block)], [block for block in blocks if not _open(block)]
    lines = ["# rvads verdicts"]
    for block in sorted(shown, key=lambda block: isinstance(block, RollUp)):
        lines += ["", *_render(block)]
    for title, several in groupby(closed, _summary):
        told = [line for block in several for line in ("", *_render(block))]
        lines += ["", f"<details><summary>{title}</summary>", *told, "", "</details>"]
    return "\n".join(lines) + "\n"


def _open(block: Block) -> bool:
    """Tell whether a block is read without opening anything: sums are, because they are as long for any number of verdicts."""
    return isinstance(block, Notes | Head | Changes | RollUp) or block.title == FAILURES


def _summary(block: Block) -> str:
    """Return what a folded part is called; nothing that comes from elsewhere, because that is HTML."""
    match block:
        case Verdicts():
            return "verdict tables"
        case Figures(title=title):
            return f"{title} and figures"
    return block.title


def section(title: str, lines: Sequence[str], columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield a heading, and below it a table, or without columns a list; what is long is folded."""
    yield from (f"## {_text(title)}", "")
    if columns:
        yield from _folded((_row(columns), f"|{'---|' * len(columns)}"), [_row(cells) for cells in rows], "rows")
    else:
        yield from _folded((), [f"- {_text(line)}" for line in lines], "lines", _LINES)


def _render(block: Block) -> Iterator[str]:
    match block:
        case Notes():
            yield "\n\n".join(f"**{_text(note)}**" for note in block.lines)
        case Changes(comparison):
            yield from (_heading(block.title), "", _text(comparison.headline), "")
            yield from _folded((), [f"- {_text(line)}" for line in comparison.lines()], "changes", _LINES)
        case Causes(title, causes, again):
            head = f"| items | rule | cause | {_text(f'first: {again}' if again else 'first')} |", "|---:|---|---|---|"
            rows = [
                f"| {c.count} | {_text(c.rule)} | {_text(c.line)} | {_code(quoted(c.example) if again else c.example)} |"
                for c in causes
            ]
            yield from (_heading(title), "", *_folded(head, rows, "causes"))
        case Head(lines) | Figures(lines):
            yield from _folded((), [f"- {_text(line)}" for line in lines], "lines", _LINES)
        case RollUp(sums):
            yield _heading(block.title)
            for table in sums:
                head = _row(table.columns), "|" + "".join("---|" if side == "left" else "---:|" for side in table.sides)
                yield from ("", *_folded(head, [_row(table.cells(row)) for row in table.rows], f"{table.corner}s"))
        case Verdicts(matrix):
            yield from (f"## {_text(matrix.title)}", "")
            columns = [f"{matrix.numbers.get(cfg, cfg)} {rule}".lstrip() for cfg, rule in matrix.columns]
            head = _row([matrix.corner, *columns]), "|---|" + "---|" * len(columns)
            rows = [_row([label, *(entry.text for entry in entries)]) for label, entries in matrix.rows]
            yield from _folded(head, rows, "rows")
            if matrix.numbers:
                yield from ("", *(f"- {_text(f'{number} = {label}')}" for label, number in matrix.numbers.items()))


def _folded(head: tuple[str, ...], rows: Sequence[str], what: str, most: int = WORST) -> Iterator[str]:
    """Yield a table or a list; what is longer than a screen is folded."""
    yield from (*head, *rows[:most])
    if more := rows[most:]:
        yield from ("", f"<details><summary>{len(more)} more {what}</summary>", "", *head, *more, "", "</details>")


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(map(_text, cells))} |"


def _heading(title: str) -> str:
    return f"## {title[0].upper()}{title[1:]}"


def _text(text: str) -> str:
    """Return a text on one line, of which Markdown takes nothing for its own, for HTML, for a link or for a mention."""
    line = printable(text, len(text)).translate({ord("\n"): " ", ord("\t"): " "})
    for special, escaped in _ESCAPES:
        line = special.sub(escaped, line)
    return line


def _code(text: str) -> str:
    """Return a text as a span of code, in which nothing can be escaped."""
    return _text(text) if re.search(r"[`\\|\s]", text) else f"`{printable(text, len(text))}`"

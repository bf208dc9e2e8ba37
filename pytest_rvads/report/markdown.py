"""Shows a report as Markdown, for example for GitHub's job summary; most parts below the causes of failures are folded."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

from pytest_rvads.report.matrix import Matrix
from pytest_rvads.report.outline import FAILURES, Block, Causes, Changes, Figures, Head, Notes, RollUp, Section, outline
from pytest_rvads.report.rollup import WORST
from pytest_rvads.report.session_report import Report
from pytest_rvads.support.wording import printable, quoted

_LINES = 50
"""Largest number of lines of a list that are not folded."""
_ESCAPES = (
    (re.compile(r"&(?=[#\w])"), "&amp;"),  # entities
    (re.compile(r"<(?=[A-Za-z/!?])"), "&lt;"),  # HTML, addresses in angle brackets
    (re.compile(r"^[-+>#\[]|[\\`*~$|]|(?<![^\W_])_|_(?![^\W_])|\](?=[(\[])"), r"\\\g<0>"),  # blocks, spans, cells, links
    (re.compile(r"(?i)\b(javascript|vbscript|data|file|http|ftp|mailto|xmpp)(?=:)|\bwww(?=\.)"), r"\g<0>\\"),  # bare addresses
    (re.compile(r"(?<!\w)@(?=\w)|(?<![\w;])#(?=\d)"), "\\g<0>\N{WORD JOINER}"),  # mentions, numbers of issues
)


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

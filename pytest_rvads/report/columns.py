"""Lays out a table as text no wider than a terminal: in blocks of columns, each of which repeats the names of all rows.

Wide texts are wrapped at their spaces. If not even the longest words fit beside each other, each row becomes a list. Only a word
that is longer than a line is broken. The class rich.table.Table is not used here, because it does not split a table into blocks
and takes six times as long for the lines of a block.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import groupby, zip_longest
from typing import NamedTuple

from rich.cells import cell_len, chop_cells
from rich.text import Text

_BREAK = re.compile(r"(?<!\d) | (?!(?:m?s|m|m/s|m/s\^2|NA)(?:[ ,:;).]|$))")
"""The spaces at which a text can be broken into lines."""

_GAPS = 3, 2
"""Gap between columns if all columns fit in one block, and gap if the columns need several blocks [characters]."""
_PLEASANT = 20
"""Width above which the texts of a column are wrapped, as far as their words allow [characters]."""
_INDENT = 2
"""Indent of a line that continues the line above [characters]."""


class Cell(NamedTuple):
    """A cell of a table: a text with its style on a terminal."""

    text: str = ""
    style: str = ""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table: its headings from top to bottom, and a cell per row."""

    heads: tuple[str, ...]
    cells: tuple[Cell, ...]
    right: bool = False
    """Whether the texts are aligned at the right, as numbers are."""
    group: Hashable = None
    """Name of a group: neighbouring columns of a group stay in one block if the width allows."""

    @property
    def texts(self) -> tuple[str, ...]:
        """The texts of all headings and cells of the column."""
        return (*self.heads, *(cell.text for cell in self.cells))


@dataclass(frozen=True, slots=True)
class Block:
    """A part of a table with some of its columns, as lines of text."""

    columns: tuple[int, ...]
    """The numbers of the columns in the table."""
    lines: tuple[Text, ...]


def wrapped(text: str, width: int, indent: int = 0) -> list[str]:
    """Return a text as lines, broken at spaces, but not between a number and its unit; a word longer than a line is cut.

    Args:
        width: greatest width of a line [characters].
        indent: indent of all lines except the first [characters].
    """
    lines = [""]
    for word in _BREAK.split(text):
        joined = f"{lines[-1]} {word}" if lines[-1].strip() else lines[-1] + word
        if cell_len(joined) <= width:
            lines[-1] = joined
            continue
        pieces = [word] if cell_len(word) <= width - indent else chop_cells(word, max(width - indent, 2))
        lines += [" " * indent + piece for piece in pieces]
    return lines[1:] if len(lines) > 1 and not lines[0] else lines


def blocks(corner: str, labels: Sequence[str], columns: Sequence[Column], width: int, rule: str = "-") -> list[Block]:
    """Return a table as blocks that are no wider than the terminal.

    Args:
        width: width of the terminal [characters].
    """
    if not columns:
        return []
    label_width = max(map(cell_len, (corner, *labels)))
    widths = [_column_width(column) for column in columns]
    gap = _GAPS[1 + label_width + sum(_GAPS[0] + column_width for column_width in widths) > width]
    if 1 + label_width + sum(gap + column_width for column_width in widths) > width:
        word = max(_longest(text) for text in (corner, *labels))
        most = max(min(label_width, width // 3), min(label_width, word + _INDENT))
        label_width = max(cell_len(line) for text in (corner, *labels) for line in wrapped(text, most, _INDENT))
        if 1 + label_width + gap + max(_longest(text) for column in columns for text in column.texts) > width:
            return [_as_list(corner, labels, columns, width)]
    room = width - 1 - label_width
    widths = [min(column_width, room - gap) for column_width in widths]
    pages = _packed(columns, [gap + column_width for column_width in widths], room)
    return [Block(page, _block_lines(corner, labels, columns, page, label_width, widths, gap, rule)) for page in pages]


def _column_width(column: Column) -> int:
    """Return the width of a column: the width of its longest text, or of its longest word if the texts are long."""
    most = max(_PLEASANT, max(map(_longest, column.texts)))
    return max(cell_len(line) for text in column.texts for line in wrapped(text, most))


def _longest(text: str) -> int:
    return max(map(cell_len, text.split(" ")))


def _packed(columns: Sequence[Column], widths: Sequence[int], room: int) -> list[tuple[int, ...]]:
    """Return the numbers of the columns in each block of a table."""
    pages: list[list[int]] = [[]]
    used = 0
    for _, members in groupby(range(len(columns)), lambda i: columns[i].group or i):
        group = list(members)
        together = sum(widths[i] for i in group)
        for k, i in enumerate(group):
            if pages[-1] and used + (widths[i] if k else together) > room:
                pages.append([])
                used = 0
            pages[-1].append(i)
            used += widths[i]
    return [tuple(page) for page in pages]


def _block_lines(
    corner: str,
    labels: Sequence[str],
    columns: Sequence[Column],
    page: Sequence[int],
    label_width: int,
    widths: Sequence[int],
    gap: int,
    rule: str,
) -> tuple[Text, ...]:
    """Return the lines of one block of a table."""
    lines: list[Text] = []
    last = len(columns[page[0]].heads) - 1
    for level in range(last + 1):
        heads = [columns[i].heads[level] for i in page]
        if level < last:  # neighbouring columns with the same heading show the heading once
            heads = [head if not k or columns[page[k - 1]].heads[level] != head else "" for k, head in enumerate(heads)]
        if level < last and not any(heads):
            continue
        cells = [Cell(head) for head in heads]
        lines += _row_lines(corner if level == last else "", cells, columns, page, label_width, widths, gap)
    lines.append(Text(rule * (1 + label_width + sum(gap + widths[i] for i in page))))
    for number, label in enumerate(labels):
        lines += _row_lines(label, [columns[i].cells[number] for i in page], columns, page, label_width, widths, gap)
    return tuple(lines)


def _row_lines(
    label: str,
    cells: Sequence[Cell],
    columns: Sequence[Column],
    page: Sequence[int],
    label_width: int,
    widths: Sequence[int],
    gap: int,
) -> list[Text]:
    """Return the lines of a row of a table; each cell can take several lines."""
    texts = [wrapped(cell.text, widths[i]) for cell, i in zip(cells, page, strict=True)]
    lines = []
    for name, *parts in zip_longest(wrapped(label, label_width, _INDENT), *texts, fillvalue=""):
        line = Text(f" {name}{' ' * (label_width - cell_len(name))}")
        for part, cell, i in zip(parts, cells, page, strict=True):
            pad = " " * (widths[i] - cell_len(part))
            line.append(" " * gap + (pad if columns[i].right else ""))
            line.append(part, style=cell.style)
            line.append("" if columns[i].right else pad)
        line.rstrip()
        lines.append(line)
    return lines


def _as_list(corner: str, labels: Sequence[str], columns: Sequence[Column], width: int) -> Block:
    """Return a table as a list: the name of each row, followed by its cells with their headings."""
    lines: list[Text] = []
    for number, label in enumerate(labels):
        lines += [Text(f" {line}") for line in wrapped(f"{corner} {label}", width - 1, _INDENT)]
        texts = [f"{' '.join(filter(None, c.heads))}: {c.cells[number].text}" for c in columns if c.cells[number].text]
        lines += [Text(f"{' ' * (1 + _INDENT)}{line}") for line in wrapped("; ".join(texts), width - 1 - _INDENT, _INDENT)]
    return Block(tuple(range(len(columns))), tuple(lines))

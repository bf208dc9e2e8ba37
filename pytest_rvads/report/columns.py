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


@dataclass(frozen=True, slots=True)
class Block:
    """A part of a table with some of its columns, as lines of text."""

    columns: tuple[int, ...]
    """The numbers of the columns in the table."""
    lines: tuple[Text, ...]


def wrapped(text: str, width: int, indent: int = 0) -> list[str]:
    """Return a text as lines, broken at spaces, but not between a number and its unit; a word longer than a line is cut.

    All lines except the first are indented by `indent` characters.
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
    """Return a table as blocks of at most `width` characters."""
    if not columns:
        return []
    label_width = max(map(cell_len, (corner, *labels)))
    widths, longest_word = [], 0
    for column in columns:  # as wide as the longest text, or as the longest word if the texts are long
        texts = [*column.heads, *(cell.text for cell in column.cells)]
        word = max(map(_longest, texts))
        longest_word = max(longest_word, word)
        widths.append(max(cell_len(line) for text in texts for line in wrapped(text, max(_PLEASANT, word))))
    gap = _GAPS[1 + label_width + sum(_GAPS[0] + column_width for column_width in widths) > width]
    if 1 + label_width + sum(gap + column_width for column_width in widths) > width:
        word = max(_longest(text) for text in (corner, *labels))
        most = max(min(label_width, width // 3), min(label_width, word + _INDENT))
        label_width = max(cell_len(line) for text in (corner, *labels) for line in wrapped(text, most, _INDENT))
        if 1 + label_width + gap + longest_word > width:
            # As a list: the name of each row, followed by its cells with their headings.
            lines: list[Text] = []
            for number, label in enumerate(labels):
                lines += [Text(f" {line}") for line in wrapped(f"{corner} {label}", width - 1, _INDENT)]
                cells = [f"{' '.join(filter(None, c.heads))}: {c.cells[number].text}" for c in columns if c.cells[number].text]
                parts = wrapped("; ".join(cells), width - 1 - _INDENT, _INDENT)
                lines += [Text(f"{' ' * (1 + _INDENT)}{line}") for line in parts]
            return [Block(tuple(range(len(columns))), tuple(lines))]
    room = width - 1 - label_width
    widths = [min(column_width, room - gap) for column_width in widths]
    result = []
    for page in _packed(columns, [gap + column_width for column_width in widths], room):
        shown = [(columns[i], widths[i]) for i in page]
        result.append(Block(page, _block_lines(corner, labels, label_width, shown, gap, rule)))
    return result


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
    corner: str, labels: Sequence[str], label_width: int, shown: Sequence[tuple[Column, int]], gap: int, rule: str
) -> tuple[Text, ...]:
    """Return the lines of one block of a table, whose columns are `shown` with their widths; a cell can take several lines."""
    lines: list[Text] = []

    def add_row(label: str, cells: Sequence[Cell]) -> None:
        texts = [wrapped(cell.text, width) for cell, (_, width) in zip(cells, shown, strict=True)]
        for name, *parts in zip_longest(wrapped(label, label_width, _INDENT), *texts, fillvalue=""):
            line = Text(f" {name}{' ' * (label_width - cell_len(name))}")
            for part, cell, (column, width) in zip(parts, cells, shown, strict=True):
                pad = " " * (width - cell_len(part))
                line.append(" " * gap + (pad if column.right else ""))
                line.append(part, style=cell.style)
                line.append("" if column.right else pad)
            line.rstrip()
            lines.append(line)

    *upper, lowest = zip(*(column.heads for column, _ in shown), strict=True)
    for heads in upper:  # neighbouring columns with the same heading show the heading once
        once = [head if not k or heads[k - 1] != head else "" for k, head in enumerate(heads)]
        if any(once):
            add_row("", [Cell(head) for head in once])
    add_row(corner, [Cell(head) for head in lowest])
    lines.append(Text(rule * (1 + label_width + sum(gap + width for _, width in shown))))
    for number, label in enumerate(labels):
        add_row(label, [column.cells[number] for column, _ in shown])
    return tuple(lines)

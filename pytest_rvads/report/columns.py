"""Tables of text as wide as a terminal: split into blocks, each with the names of all rows, and no word is cut.

What is too wide is wrapped at its spaces, and where not even the longest words fit beside each other, a row is a list. A word
that is longer than a line is the one thing that is broken. rich.table does not split a table into blocks, and takes six times as
long for the lines of a block.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import groupby, zip_longest
from typing import NamedTuple

from rich.cells import cell_len, chop_cells
from rich.text import Text

__all__ = ["Block", "Cell", "Column", "blocks", "wrapped"]

_BREAK = re.compile(r"(?<!\d) | (?!(?:m?s|m|m/s|m/s\^2|NA)(?:[ ,:;).]|$))")
"""The spaces at which a text may be broken."""

_GAPS = 3, 2
"""Between columns where one block is wide enough for all of them, and elsewhere."""
_PLEASANT = 20
"""A column whose texts are wider is wrapped, where its words allow."""
_INDENT = 2
"""Of what belongs to the line above."""


class Cell(NamedTuple):
    """A text, and how a terminal shows it."""

    text: str = ""
    style: str = ""


@dataclass(frozen=True, slots=True)
class Column:
    """A column: its headings, from above, and a cell per row."""

    heads: tuple[str, ...]
    cells: tuple[Cell, ...]
    right: bool = False
    """Whether the texts are aligned at the right, as numbers are."""
    group: Hashable = None
    """Neighbouring columns of a group stay in one block where the width allows; equal upper headings are printed once."""

    @property
    def texts(self) -> tuple[str, ...]:
        """All that stands in it."""
        return (*self.heads, *(cell.text for cell in self.cells))


@dataclass(frozen=True, slots=True)
class Block:
    """Some columns of a table, as lines."""

    columns: tuple[int, ...]
    """Which, by number."""
    lines: tuple[Text, ...]


def wrapped(text: str, width: int, indent: int = 0) -> list[str]:
    """Return a text as lines, broken at spaces, but not between a number and its unit; a word longer than a line is cut.

    Args:
        text: on one line.
        width: of the longest line.
        indent: of all lines but the first.
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
        corner: what a row is.
        labels: the names of the rows.
        columns: with a cell per row.
        width: of the terminal, in characters.
        rule: the character that the line below the headings is made of.
    """
    if not columns:
        return []
    beside = max(map(cell_len, (corner, *labels)))
    wide = [_wide(column) for column in columns]
    gap = _GAPS[1 + beside + sum(_GAPS[0] + each for each in wide) > width]
    if 1 + beside + sum(gap + each for each in wide) > width:
        word = max(_longest(text) for text in (corner, *labels))
        most = max(min(beside, width // 3), min(beside, word + _INDENT))
        beside = max(cell_len(line) for text in (corner, *labels) for line in wrapped(text, most, _INDENT))
        if 1 + beside + gap + max(_longest(text) for column in columns for text in column.texts) > width:
            return [_listed(corner, labels, columns, width)]
    room = width - 1 - beside
    wide = [min(each, room - gap) for each in wide]
    pages = _packed(columns, [gap + each for each in wide], room)
    return [Block(page, _drawn(corner, labels, columns, page, beside, wide, gap, rule)) for page in pages]


def _wide(column: Column) -> int:
    """Return the width of a column: that of its longest text, or of its longest word if the texts are long."""
    most = max(_PLEASANT, max(map(_longest, column.texts)))
    return max(cell_len(line) for text in column.texts for line in wrapped(text, most))


def _longest(text: str) -> int:
    return max(map(cell_len, text.split(" ")))


def _packed(columns: Sequence[Column], wide: Sequence[int], room: int) -> list[tuple[int, ...]]:
    """Return the columns of each block, by number."""
    pages: list[list[int]] = [[]]
    used = 0
    for _, members in groupby(range(len(columns)), lambda i: columns[i].group or i):
        group = list(members)
        together = sum(wide[i] for i in group)
        for k, i in enumerate(group):
            if pages[-1] and used + (wide[i] if k else together) > room:
                pages.append([])
                used = 0
            pages[-1].append(i)
            used += wide[i]
    return [tuple(page) for page in pages]


def _drawn(  # noqa: PLR0913 - what a layout consists of
    corner: str,
    labels: Sequence[str],
    columns: Sequence[Column],
    page: Sequence[int],
    beside: int,
    wide: Sequence[int],
    gap: int,
    rule: str,
) -> tuple[Text, ...]:
    """Return the lines of one block."""
    lines: list[Text] = []
    last = len(columns[page[0]].heads) - 1
    for level in range(last + 1):
        heads = [columns[i].heads[level] for i in page]
        if level < last:  # said once over neighbours that share it
            heads = [head if not k or columns[page[k - 1]].heads[level] != head else "" for k, head in enumerate(heads)]
        if level < last and not any(heads):
            continue
        cells = [Cell(head) for head in heads]
        lines += _row(corner if level == last else "", cells, columns, page, beside, wide, gap)
    lines.append(Text(rule * (1 + beside + sum(gap + wide[i] for i in page))))
    for number, label in enumerate(labels):
        lines += _row(label, [columns[i].cells[number] for i in page], columns, page, beside, wide, gap)
    return tuple(lines)


def _row(  # noqa: PLR0913 - likewise
    label: str, cells: Sequence[Cell], columns: Sequence[Column], page: Sequence[int], beside: int, wide: Sequence[int], gap: int
) -> list[Text]:
    """Return a row, of which each cell may take several lines."""
    texts = [wrapped(cell.text, wide[i]) for cell, i in zip(cells, page, strict=True)]
    lines = []
    for name, *parts in zip_longest(wrapped(label, beside, _INDENT), *texts, fillvalue=""):
        line = Text(f" {name}{' ' * (beside - cell_len(name))}")
        for part, cell, i in zip(parts, cells, page, strict=True):
            pad = " " * (wide[i] - cell_len(part))
            line.append(" " * gap + (pad if columns[i].right else ""))
            line.append(part, style=cell.style)
            line.append("" if columns[i].right else pad)
        line.rstrip()
        lines.append(line)
    return lines


def _listed(corner: str, labels: Sequence[str], columns: Sequence[Column], width: int) -> Block:
    """Return a table as a list: the name of each row, followed by its cells with their headings."""
    lines: list[Text] = []
    for number, label in enumerate(labels):
        lines += [Text(f" {line}") for line in wrapped(f"{corner} {label}", width - 1, _INDENT)]
        told = [f"{' '.join(filter(None, c.heads))}: {c.cells[number].text}" for c in columns if c.cells[number].text]
        lines += [Text(f"{' ' * (1 + _INDENT)}{line}") for line in wrapped("; ".join(told), width - 1 - _INDENT, _INDENT)]
    return Block(tuple(range(len(columns))), tuple(lines))

"""A report as Markdown, for GitHub's job summary among others."""

from __future__ import annotations

from collections.abc import Iterator

from pytest_rvads.report.outline import Block, Causes, Changes, Figures, Notes, Verdicts, outline
from pytest_rvads.report.session_report import Report

__all__ = ["markdown"]


def markdown(report: Report) -> str:
    """Return a report as Markdown: the tables last, because they are long."""
    blocks = sorted(outline(report), key=lambda block: isinstance(block, Verdicts))
    return "\n".join(("# rvads verdicts", *(line for block in blocks for line in ("", *_render(block))))) + "\n"


def _render(block: Block) -> Iterator[str]:
    match block:
        case Notes():
            yield "\n\n".join(f"**{_cell(note)}**" for note in block.lines)
        case Changes(comparison):
            yield from (_heading(block.title), "", _cell(comparison.headline), "")
            yield from (f"- {_cell(line)}" for line in comparison.lines())
        case Causes(title, causes):
            yield from (_heading(title), "", "| items | rule | cause | first |", "|---:|---|---|---|")
            yield from (f"| {c.count} | {_cell(c.rule)} | {_cell(c.line)} | `{_cell(c.example)}` |" for c in causes)
        case Figures(lines):
            yield from (f"- {_cell(line)}" for line in lines)
        case Verdicts(matrix):
            yield from (f"## {matrix.title}", "")
            yield "| class | " + " | ".join(f"{cfg} {rule}" for cfg, rule in matrix.columns) + " |"
            yield "|---|" + "---|" * len(matrix.columns)
            yield from (f"| {label} | " + " | ".join(_cell(e.text) for e in entries) + " |" for label, entries in matrix.rows)


def _heading(title: str) -> str:
    return f"## {title[0].upper()}{title[1:]}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")

"""Text from elsewhere, made fit to be shown: names, messages and answers of drivers, stacks, files."""

from __future__ import annotations

import io
import re
import shlex
from collections.abc import Sequence
from html import escape
from typing import TextIO

__all__ = ["encode_all", "first", "markup", "one_line", "page", "plural", "printable", "quoted"]

SITE = "https://pytest-rvads.github.io/pytest-rvads/"
"""Where the pages of ``docs/`` can be read by somebody who has only installed the package."""

_UNFIT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")
"""What steers a terminal, turns the direction of writing, or can't be encoded; line ends and tabs are fit."""

_EXPANDED = re.compile(r"[\"$`\\!]")
"""What a shell takes for its own inside of double quotes."""


def printable(text: str, most: int = 4096) -> str:
    r"""Return a text of at most about `most` characters in which what can't be shown is escaped, as in ``\x1b``."""
    cut = f"{text[:most]}... ({len(text):,} characters)" if len(text) > most else text
    return _UNFIT.sub(lambda found: found[0].encode("unicode_escape", "surrogatepass").decode("ascii"), cut)


def one_line(text: str, most: int = 400) -> str:
    """Return a text as `printable` does, on one line."""
    return printable(" ".join(text[: 4 * most].split()) + text[4 * most :], most)


def first(names: Sequence[str], most: int | None) -> str:
    """Return at most so many names as a list in a sentence, and how many more there are."""
    more = 0 if most is None else len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def markup(text: str) -> str:
    """Return a text as HTML, SVG and other XML hold it, between tags and in quotes."""
    return escape(printable(text, len(text)))


def encode_all(*streams: TextIO | None) -> None:
    r"""Let streams write any text: a character that the encoding lacks is escaped, as in ``\u2192``, and raises no error."""
    for stream in streams:
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


def plural(count: int, thing: str, several: str = "") -> str:
    """Return so many things in words: ``1 run``, ``1,200 runs``; `several` where its plural has no s."""
    return f"{count:,} {thing if count == 1 else several or f'{thing}s'}"


def quoted(name: str) -> str:
    """Return an id or a file name quoted for a shell, so that the shell expands nothing.

    The quotes are double quotes, which every shell knows, including that of Windows. A name with characters that a shell expands
    between double quotes gets single quotes.
    """
    return shlex.quote(name) if _EXPANDED.search(name) else f'"{name}"'


def page(name: str = "") -> str:
    """Return the address of a page of the documentation, by the name of its file in ``docs/`` without ending, or the first."""
    return f"{SITE}{name}.html" if name else SITE

"""Text for users: texts of drivers, stacks and files are made printable; numbers, lists and ids become parts of sentences.

A value that a notebook shows does not import the module that draws the value, so that judging and driving never load code for
pictures. `shown` finds what draws by an entry point when a notebook asks for a picture.
"""

from __future__ import annotations

import io
import re
import shlex
import sys
from collections.abc import Sequence
from html import escape
from importlib.metadata import entry_points
from typing import TextIO

_UNFIT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")
"""Characters that control a terminal, change the direction of writing, or can't be encoded; not line ends and tabs."""

_EXPANDED = re.compile(r"[\"$`\\!]")
"""Characters that a shell interprets between double quotes."""


def printable(text: str, most: int = 4096) -> str:
    r"""Return a text of at most about `most` characters, with unprintable characters escaped, as in ``\x1b``."""
    cut = f"{text[:most]}... ({len(text):,} characters)" if len(text) > most else text
    return _UNFIT.sub(lambda match: match[0].encode("unicode_escape", "surrogatepass").decode("ascii"), cut)


def one_line(text: str, most: int = 400) -> str:
    """Return a text on one line, printable as by `printable`."""
    return printable(" ".join(text[: 4 * most].split()) + text[4 * most :], most)


def named_error(error: BaseException) -> str:
    """Return the class and the message of an error on one line; the class alone if the message can't be computed."""
    try:
        return ": ".join(filter(None, (type(error).__name__, one_line(str(error)))))
    except Exception:  # __str__ of an exception class of a user
        return type(error).__name__


def first(names: Sequence[str], most: int | None) -> str:
    """Return the first `most` names as a list in a sentence, with the number of further names."""
    more = 0 if most is None else len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def markup(text: str) -> str:
    """Return a text escaped for HTML, SVG and other XML, between tags and in quotes."""
    return escape(printable(text, len(text)))


def encode_all(*streams: TextIO | None) -> None:
    r"""Let streams write any text: a character that the encoding lacks is escaped, as in ``\u2192``, and raises no error."""
    for stream in streams:
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


def plural(count: int, thing: str, several: str = "") -> str:
    """Return a number of things in words: ``1 run``, ``1,200 runs``; `several` is a plural that is not formed by an s."""
    return f"{count:,} {thing if count == 1 else several or f'{thing}s'}"


def quoted(name: str) -> str:
    """Return an id or a file name quoted for a shell, so that the shell expands nothing.

    The quotes are double quotes, which every shell knows, including that of Windows. A name with characters that a shell expands
    between double quotes gets single quotes.
    """
    return shlex.quote(name) if _EXPANDED.search(name) else f'"{name}"'


def page(name: str = "") -> str:
    """Return the command that shows a page of ``docs/``, given by name without ending; without a name, the list of pages."""
    return f"rvads docs {name}".rstrip()


def shown(value: object) -> str:
    """Return a value as HTML, drawn by the function of the entry point ``html`` in the group ``rvads.displays``."""
    display = next(iter(entry_points(group="rvads.displays", name="html")))
    return str(display.load()(value))


def show_lists(kind: type) -> None:
    """Let a running notebook show lists of values of a type as `shown` draws lists; do nothing outside of a notebook."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None:
        printers = shell.display_formatter.formatters["text/html"]
        printers.for_type(list, lambda found: shown(found) if found and all(isinstance(one, kind) for one in found) else None)


def natural(name: str) -> list[tuple[bool, int, str, str]]:
    """Return a sort key that puts name 26 before name 124; a number can have more digits than Python's int() accepts."""
    parts = [(part, part.lstrip("0") if part.isdecimal() else "") for part in re.split(r"(\d+)", name)]
    return [(part.isdecimal(), len(digits), digits, part) for part, digits in parts]

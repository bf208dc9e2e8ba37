"""Text from elsewhere, made fit to be shown: names, messages and answers of drivers, stacks, files."""

from __future__ import annotations

import re

__all__ = ["one_line", "printable"]

_UNFIT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")
"""What steers a terminal, turns the direction of writing, or can't be encoded; line ends and tabs are fit."""


def printable(text: str, most: int = 4096) -> str:
    r"""Return a text of at most about `most` characters in which what can't be shown is escaped, as in ``\x1b``."""
    cut = f"{text[:most]}... ({len(text):,} characters)" if len(text) > most else text
    return _UNFIT.sub(lambda found: found[0].encode("unicode_escape", "surrogatepass").decode("ascii"), cut)


def one_line(text: str, most: int = 400) -> str:
    """Return a text as `printable` does, on one line."""
    return printable(" ".join(text[: 4 * most].split()) + text[4 * most :], most)

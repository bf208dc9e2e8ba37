"""The sorts of variables: told by the paper's letters, or declared."""

from __future__ import annotations

import re
from enum import StrEnum

__all__ = ["Sort", "sort_of"]


class Sort(StrEnum):
    """What a variable ranges over, at the junction under test."""

    AGENT = "agent"
    LIGHT = "light"
    OBJECT = "object"
    ROAD = "road"
    JUNCTION = "junction"
    ENTRANCE = "entrance"
    EXIT = "exit"
    VERTEX = "vertex"


_NAME = re.compile(r"([A-Za-z_]+)\d*'*(?:\.(en|ex)\d*'*)?")
_LETTERS = {
    ("a", None): Sort.AGENT,
    ("lt", None): Sort.LIGHT,
    ("o", None): Sort.OBJECT,
    ("r", None): Sort.ROAD,
    ("j", None): Sort.JUNCTION,
    ("v", None): Sort.VERTEX,
    ("j", "en"): Sort.ENTRANCE,
    ("j", "ex"): Sort.EXIT,
    ("r", "en"): Sort.VERTEX,
    ("r", "ex"): Sort.VERTEX,
}


def sort_of(name: str) -> Sort | None:
    """Return the sort that the letters of a variable tell (``a'``, ``j.en2``), or None.

    The letters are the paper's (section 5.1); digits and primes make further variables of the same sort.
    """
    found = _NAME.fullmatch(name)
    return _LETTERS.get((found[1], found[2])) if found else None

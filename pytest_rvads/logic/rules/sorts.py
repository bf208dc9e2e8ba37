"""The language of rules: the sorts of variables with the paper's letters, and the names of values."""

from __future__ import annotations

from enum import StrEnum

from pytest_rvads.logic.ltl.grammar import Language

__all__ = ["COLOURS", "DIRECTIONS", "LANGUAGE", "Sort"]


class Sort(StrEnum):
    """Sort of a variable: the elements at the junction under test that the variable ranges over."""

    AGENT = "agent"
    LIGHT = "light"
    OBJECT = "object"
    ROAD = "road"
    JUNCTION = "junction"
    ENTRANCE = "entrance"
    EXIT = "exit"
    VERTEX = "vertex"


DIRECTIONS = ("left", "straight", "right", "near", "far")
COLOURS = ("green", "yellow", "red")

LANGUAGE = Language(
    sorts=tuple(Sort),
    letters={
        "a": Sort.AGENT,
        "lt": Sort.LIGHT,
        "o": Sort.OBJECT,
        "r": Sort.ROAD,
        "j": Sort.JUNCTION,
        "v": Sort.VERTEX,
        "j.en": Sort.ENTRANCE,
        "j.ex": Sort.EXIT,
        "r.en": Sort.VERTEX,
        "r.ex": Sort.VERTEX,
    },
    values=(*DIRECTIONS, *COLOURS),
    relations=("right-of", "opposite", "entex"),
    keywords=("take", "turn"),
)
"""The letters are the paper's (section 5.1)."""

"""The first-order language of rules: sorts, the letters of the variables of each sort, named values, relations."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

__all__ = ["Language"]


@dataclass(frozen=True)
class Language:
    """The words that a parser has to know beforehand; predicates are looked up after parsing."""

    sorts: tuple[str, ...]
    """Sorts of variables."""
    letters: Mapping[str, str]
    """Sort by the letters of a variable: ``x``, or ``x.part`` for a part of the element that ``x`` stands for."""
    values: tuple[str, ...]
    """Names of values, which variables can't have."""
    relations: tuple[str, ...]
    """Predicates of two terms that are written between the terms."""
    keywords: tuple[str, ...] = ()
    """Further names, which the correction of misspelt words suggests."""

    def __hash__(self) -> int:
        return hash((self.sorts, self.values, self.relations))

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """The letters after the dot."""
        return tuple(dict.fromkeys(letters.partition(".")[2] for letters in self.letters if "." in letters))

    @cached_property
    def _name(self) -> re.Pattern[str]:
        return re.compile(rf"([A-Za-z_]+)\d*'*(?:\.({'|'.join(self.parts)})\d*'*)?")

    def sort_of(self, name: str) -> str | None:
        """Return the sort that the letters of a variable imply (``x'``, ``x.part2``), or None.

        Digits and primes make further variables of the same sort.
        """
        found = self._name.fullmatch(name)
        return self.letters.get(".".join(filter(None, found.groups()))) if found else None

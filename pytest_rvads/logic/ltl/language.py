"""What a first-order language of rules adds to the logic: sorts and the letters that tell them, named values, relations."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

__all__ = ["Language"]


@dataclass(frozen=True)
class Language:
    """The words that a parser has to know beforehand; which predicates there are is no matter of grammar."""

    sorts: tuple[str, ...]
    """What variables range over."""
    letters: Mapping[str, str]
    """By the letters of a variable its sort: ``x``, or ``x.part`` for a part of what ``x`` stands for."""
    values: tuple[str, ...]
    """Names of values; no variable is called so."""
    relations: tuple[str, ...]
    """Predicates of two terms that are written between them."""
    keywords: tuple[str, ...] = ()
    """Further names that people misspell."""

    def __hash__(self) -> int:
        return hash((self.sorts, self.values, self.relations))

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """What comes after the dot in letters."""
        return tuple(dict.fromkeys(letters.partition(".")[2] for letters in self.letters if "." in letters))

    @cached_property
    def _name(self) -> re.Pattern[str]:
        return re.compile(rf"([A-Za-z_]+)\d*'*(?:\.({'|'.join(self.parts)})\d*'*)?")

    def sort_of(self, name: str) -> str | None:
        """Return the sort that the letters of a variable tell (``x'``, ``x.part2``), or None.

        Digits and primes make further variables of the same sort.
        """
        found = self._name.fullmatch(name)
        return self.letters.get(".".join(filter(None, found.groups()))) if found else None

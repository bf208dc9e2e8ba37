"""Terms of the paper's logic: variables, constants, attributes."""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal

from pytest_rvads.logic.ltl.sorts import Sort, sort_of

__all__ = ["Attr", "Binder", "Element", "Number", "Term", "Var", "Word"]


@dataclass(frozen=True, slots=True)
class Var:
    """An occurrence of a variable."""

    name: str
    at: int = field(default=0, compare=False, repr=False)
    """Where it stands in the text, for error messages."""

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Element:
    """A constant that a variable stands for: an agent, a light, an entrance ... of the model."""

    sort: Sort = field(hash=False)  # hashing an enum is slow, and the name tells the sort
    index: int
    """Column of an agent, number of an entrance, exit, light or road."""
    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Word:
    """A value of an attribute or a direction: ``red``, ``left``."""

    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Number:
    """A constant to compare with: seconds for ``wt``, m/s for ``sp``."""

    value: float

    def __str__(self) -> str:
        return format(Decimal(repr(self.value)).normalize(), "f")


@dataclass(frozen=True, slots=True)
class Attr:
    """An attribute of an agent or a light: ``a.wt``, ``a.sp``, ``lt.cl``."""

    of: Var | Element
    name: str

    def __str__(self) -> str:
        return f"{self.of}.{self.name}"


Term = Var | Element | Word | Number | Attr


@dataclass(frozen=True, slots=True)
class Binder:
    """A quantified variable with its sort, which prints only where the letters don't tell it."""

    name: str
    sort: Sort

    def __str__(self) -> str:
        return self.name if sort_of(self.name) is self.sort else f"{self.name}: {self.sort}"

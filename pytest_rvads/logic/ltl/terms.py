"""Terms of the logic: variables, constants, attributes."""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal

__all__ = ["Attr", "Binder", "Element", "Infix", "Number", "Term", "Value", "Var"]


class Infix(str):
    """The name of a relation that is written between its two terms, as comparisons are."""

    __slots__ = ()


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
    """A constant that a variable stands for, of the model."""

    sort: str = field(hash=False)  # the name tells the sort
    index: int
    """Its number among those of its kind."""
    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Value:
    """A value that has a name."""

    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Number:
    """A constant to compare with."""

    value: float

    def __str__(self) -> str:
        return format(Decimal(repr(self.value)).normalize(), "f")


@dataclass(frozen=True, slots=True)
class Attr:
    """An attribute of what a variable or constant stands for: ``x.size``."""

    of: Var | Element
    name: str

    def __str__(self) -> str:
        return f"{self.of}.{self.name}"


Term = Var | Element | Value | Number | Attr


@dataclass(frozen=True, slots=True)
class Binder:
    """A quantified variable with its sort, which prints only where the letters don't tell it."""

    name: str
    sort: str
    told: bool = field(default=False, compare=False, repr=False)
    """Whether the letters of the name tell the sort, so that it need not be declared."""

    def __str__(self) -> str:
        return self.name if self.told else f"{self.name}: {self.sort}"

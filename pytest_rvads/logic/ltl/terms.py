"""Terms of the logic: variables, constants, attributes."""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal

__all__ = ["Attr", "Binder", "Element", "Infix", "Number", "Term", "Value", "Var"]


class Infix(str):
    """The name of a relation that is written between its two terms, such as a comparison."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Var:
    """An occurrence of a variable."""

    name: str
    at: int = field(default=0, compare=False, repr=False)
    """Position of the variable in the text, for error messages."""

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Element:
    """An element of the model that a variable stands for."""

    sort: str = field(hash=False)  # the name determines the sort
    index: int
    """Number of the element among the elements of its sort."""
    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Value:
    """A named value, such as a colour."""

    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Number:
    """A number in a comparison."""

    value: float

    def __str__(self) -> str:
        return format(Decimal(repr(self.value)).normalize(), "f")


@dataclass(frozen=True, slots=True)
class Attr:
    """An attribute of an element or of the element that a variable stands for: ``x.size``."""

    of: Var | Element
    name: str

    def __str__(self) -> str:
        return f"{self.of}.{self.name}"


Term = Var | Element | Value | Number | Attr


@dataclass(frozen=True, slots=True)
class Binder:
    """A quantified variable with its sort, which is printed only if the letters of the variable don't imply it."""

    name: str
    sort: str
    told: bool = field(default=False, compare=False, repr=False)
    """Whether the letters of the name imply the sort, so that the sort need not be declared."""

    def __str__(self) -> str:
        return self.name if self.told else f"{self.name}: {self.sort}"

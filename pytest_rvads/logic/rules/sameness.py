"""Compares functions by their code, because a module that is loaded twice makes two functions that do the same.

Two words (definitions of predicates) are equal if `same` finds their functions the same. Therefore a module that is loaded twice
may register a predicate twice. Atoms compare words by identity, because atoms are keys of caches.
"""

from __future__ import annotations

from linecache import getlines
from types import CellType, FunctionType, MethodType

_PLAIN = (bool, int, float, complex, str, bytes)
_EMPTY = CellType()


def same(value: object, other: object) -> bool:
    """Return whether two functions, or two values that functions hold, are the same.

    Identical values and equal numbers and strings are the same. Two functions are the same if they come from the same lines of a
    file (or of a notebook's cell) and hold the same defaults and values of enclosing functions. Two methods need the identical
    object as well. Other objects can change, so two of them are never the same.
    """
    match value, other:
        case _ if value is other:
            return True
        case FunctionType(), FunctionType():
            one, two = value.__code__, other.__code__
            lines = one == two and one.co_filename == two.co_filename and bool(getlines(one.co_filename))
            try:
                return lines and same(_held(value), _held(other))
            except RecursionError:  # the functions hold themselves
                return False
        case MethodType(), MethodType():
            return value.__self__ is other.__self__ and same(value.__func__, other.__func__)
        case tuple(), tuple() if type(value) is type(other) is tuple:
            return len(value) == len(other) and all(map(same, value, other))
    return type(value) is type(other) and type(value) in _PLAIN and value == other


def _held(function: FunctionType) -> tuple[object, ...]:
    """Return the defaults of a function, and the values of enclosing functions that it uses (for an empty cell, the cell)."""
    cells = tuple(cell if cell == _EMPTY else cell.cell_contents for cell in function.__closure__ or ())
    return function.__defaults__, tuple(sorted((function.__kwdefaults__ or {}).items())), cells

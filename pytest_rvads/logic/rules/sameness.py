"""Comparison of functions: a module that is loaded again makes new functions, and two files may define equal functions.

Words are equal if their functions are the same in this sense. Atoms, which are keys of caches, compare words by identity.
"""

from __future__ import annotations

import dis
from collections.abc import Iterator
from types import CellType, CodeType, FunctionType, MethodType

__all__ = ["codes", "content", "same"]

_PLAIN = (bool, int, float, complex, str, bytes)
_UNBOUND = object()
_UNSEEN = {"globals", "eval", "exec", "locals", "vars", "__import__"}
"""Builtins by which a function reaches values that its code does not name."""
_IMPORT = dis.opmap["IMPORT_NAME"]


def same(value: object, other: object) -> bool:
    """Return whether two functions, or two values that functions work with, are the same.

    Identical values are the same, and so are equal plain values and tuples of same values. Two methods are the same if their
    object is identical and their functions are the same. Two functions are the same if their code, apart from line numbers,
    and their defaults, attributes, closures and globals are the same; the package counts for functions that import. All other
    values may become different without notice, so they are not the same.
    """
    try:
        return _same(value, other, set())
    except RecursionError:  # functions of functions, too deep to look through
        return False


def _same(value: object, other: object, assumed: set[tuple[int, int]]) -> bool:
    """Compare two values; a pair of functions whose comparison has begun counts as the same, since functions may be recursive."""
    if value is other:
        return True
    match value, other:
        case FunctionType(), FunctionType():
            if (id(value), id(other)) in assumed:
                return True
            assumed.add((id(value), id(other)))
            return _bare(value.__code__) == _bare(other.__code__) and _same(_works_with(value), _works_with(other), assumed)
        case MethodType(), MethodType():
            return value.__self__ is other.__self__ and _same(value.__func__, other.__func__, assumed)
        case tuple(), tuple() if type(value) is type(other) is tuple:
            return len(value) == len(other) and all(_same(a, b, assumed) for a, b in zip(value, other, strict=True))
    return type(value) is type(other) and type(value) in _PLAIN and value == other


def _works_with(function: FunctionType) -> tuple[object, ...]:
    """Return the values that a function uses besides its arguments, in an order given by its code."""
    named = (function.__kwdefaults__ or {}, vars(function))
    cells = tuple(content(cell) for cell in function.__closure__ or ())
    inner = tuple(codes(function.__code__))
    used = dict.fromkeys(name for code in inner for name in code.co_names)
    values = tuple(function.__globals__.get(name, _UNBOUND) for name in used)
    unseen = None if _UNSEEN.isdisjoint(used) else object()  # like no other
    package = function.__globals__.get("__package__") if any(_IMPORT in code.co_code[::2] for code in inner) else None
    return function.__defaults__, tuple(tuple(sorted(values.items())) for values in named), cells, values, unseen, package


def content(cell: CellType) -> object:
    """Return the content of a cell of a closure; for an empty cell, the cell itself."""
    try:
        return cell.cell_contents
    except ValueError:  # the cell is empty
        return cell


def codes(code: CodeType) -> Iterator[CodeType]:
    """Yield a code object and the code objects of its inner functions."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from codes(constant)


def _bare(code: CodeType) -> CodeType:
    """Return a code object without its file and line numbers."""
    constants = tuple(_bare(constant) if isinstance(constant, CodeType) else constant for constant in code.co_consts)
    return code.replace(co_filename="", co_firstlineno=1, co_linetable=b"", co_consts=constants)

"""Compares functions by their code, because a module that is loaded twice makes two functions that do the same.

Two words (definitions of predicates) are equal if `same` finds their functions the same. Therefore a module that is loaded twice
may register a predicate twice. Atoms compare words by identity, because atoms are keys of caches.
"""

from __future__ import annotations

import dis
from collections.abc import Iterator
from types import CellType, CodeType, FunctionType, MethodType

_PLAIN = (bool, int, float, complex, str, bytes)
_UNBOUND = object()
_UNSEEN = {"globals", "eval", "exec", "locals", "vars", "__import__"}
"""Builtins by which a function reaches values that its code does not name."""
_IMPORT = dis.opmap["IMPORT_NAME"]


def same(value: object, other: object) -> bool:
    """Return whether two functions, or two values that functions work with, are the same.

    Two functions are the same if their code (apart from line numbers), their defaults, attributes, closures and globals are the
    same. Two functions with import statements must belong to the same package as well. Two different objects are not the same,
    apart from numbers, strings, tuples and methods, because their contents can change later.
    """
    try:
        return _same(value, other, set())
    except RecursionError:  # the functions call functions that call functions, too deeply to compare
        return False


def _same(value: object, other: object, assumed: set[tuple[int, int]]) -> bool:
    if value is other:
        return True
    match value, other:
        case FunctionType(), FunctionType():
            if (id(value), id(other)) in assumed:  # their comparison has begun: functions can be recursive
                return True
            assumed.add((id(value), id(other)))
            return _bare(value.__code__) == _bare(other.__code__) and _same(_works_with(value), _works_with(other), assumed)
        case MethodType(), MethodType():
            return value.__self__ is other.__self__ and _same(value.__func__, other.__func__, assumed)
        case tuple(), tuple() if type(value) is type(other) is tuple:
            return len(value) == len(other) and all(_same(a, b, assumed) for a, b in zip(value, other, strict=True))
    return type(value) is type(other) and type(value) in _PLAIN and value == other


def _works_with(function: FunctionType) -> tuple[object, ...]:
    """Return the values that a function uses besides its arguments, in an order that its code determines."""
    named = (function.__kwdefaults__ or {}, vars(function))
    cells = tuple(content(cell) for cell in function.__closure__ or ())
    inner = tuple(codes(function.__code__))
    used = dict.fromkeys(name for code in inner for name in code.co_names)
    values = tuple(function.__globals__.get(name, _UNBOUND) for name in used)
    unseen = None if _UNSEEN.isdisjoint(used) else object()  # an object that equals no other object
    package = function.__globals__.get("__package__") if any(_IMPORT in code.co_code[::2] for code in inner) else None
    return function.__defaults__, tuple(tuple(sorted(values.items())) for values in named), cells, values, unseen, package


def content(cell: CellType) -> object:
    """Return the value in a cell of a function's closure; for an empty cell, the cell itself."""
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

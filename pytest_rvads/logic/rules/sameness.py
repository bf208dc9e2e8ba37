"""When two functions are the same: a module that is loaded again makes its functions anew, and two files may say the same.

Words are equal if their functions are the same in this sense. Atoms, by which results are kept, compare words by identity.
"""

from __future__ import annotations

import dis
from collections.abc import Iterator
from types import CellType, CodeType, FunctionType, MethodType

__all__ = ["codes", "content", "same"]

_PLAIN = (bool, int, float, complex, str, bytes)
_UNBOUND = object()
_UNSEEN = {"globals", "eval", "exec", "locals", "vars", "__import__"}
"""By these a function reaches what its code does not name."""
_IMPORT = dis.opmap["IMPORT_NAME"]


def same(one: object, two: object) -> bool:
    """Return whether two functions, or two values that functions work with, are the same.

    They are when they are identical; plain values that are equal, or tuples of such; methods of one object and the same function;
    or functions of the same code, lines apart, whose defaults, attributes, closures and globals are the same, and the package too
    where they import. Anything else may come to differ unseen, and is not.
    """
    try:
        return _same(one, two, set())
    except RecursionError:  # functions of functions, too deep to look through
        return False


def _same(one: object, two: object, assumed: set[tuple[int, int]]) -> bool:
    """Compare, and take the pairs of functions for the same that are being compared already: they may refer to each other."""
    if one is two:
        return True
    match one, two:
        case FunctionType(), FunctionType():
            if (id(one), id(two)) in assumed:
                return True
            assumed.add((id(one), id(two)))
            return _bare(one.__code__) == _bare(two.__code__) and _same(_works_with(one), _works_with(two), assumed)
        case MethodType(), MethodType():
            return one.__self__ is two.__self__ and _same(one.__func__, two.__func__, assumed)
        case tuple(), tuple() if type(one) is type(two) is tuple:
            return len(one) == len(two) and all(_same(a, b, assumed) for a, b in zip(one, two, strict=True))
    return type(one) is type(two) and type(one) in _PLAIN and one == two


def _works_with(function: FunctionType) -> tuple[object, ...]:
    """Return what a function works with beside its arguments, in an order that its code tells."""
    named = (function.__kwdefaults__ or {}, vars(function))
    cells = tuple(content(cell) for cell in function.__closure__ or ())
    inner = tuple(codes(function.__code__))
    used = dict.fromkeys(name for code in inner for name in code.co_names)
    values = tuple(function.__globals__.get(name, _UNBOUND) for name in used)
    unseen = None if _UNSEEN.isdisjoint(used) else object()  # like no other
    package = function.__globals__.get("__package__") if any(_IMPORT in code.co_code[::2] for code in inner) else None
    return function.__defaults__, tuple(tuple(sorted(values.items())) for values in named), cells, values, unseen, package


def content(cell: CellType) -> object:
    """Return what is in a cell of a closure, or the cell itself while it is empty."""
    try:
        return cell.cell_contents
    except ValueError:  # nothing is in it yet
        return cell


def codes(code: CodeType) -> Iterator[CodeType]:
    """Yield a code and those of the functions in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from codes(constant)


def _bare(code: CodeType) -> CodeType:
    """Return a code without the lines it stands at."""
    constants = tuple(_bare(constant) if isinstance(constant, CodeType) else constant for constant in code.co_consts)
    return code.replace(co_filename="", co_firstlineno=1, co_linetable=b"", co_consts=constants)

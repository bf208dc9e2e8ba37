"""Parameters and expressions in attributes of OpenSCENARIO XML 1.2: ``$speed``, ``${$speed / 3.6}``."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping

__all__ = ["valued"]

_LONGEST, _NUMBER = 1000, 40
"""Longest expression that is evaluated, and longest number that a parameter gives to it [characters]."""
_PARAMETER = re.compile(r"\$(\w+)")
_OPERATORS: Mapping[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: math.fmod,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
    ast.And: lambda *values: all(values),
    ast.Or: lambda *values: any(values),
}
_FUNCTIONS: Mapping[str, Callable[..., float]] = {
    **{name: getattr(math, name) for name in ("floor", "ceil", "sqrt", "pow", "sin", "cos", "tan", "asin", "acos", "atan")},
    "round": lambda x: math.floor(x + 0.5),
    "sign": lambda x: (x > 0) - (x < 0),
    "max": max,
    "min": min,
}


def valued(text: str, parameters: Mapping[str, str]) -> str:
    r"""Return the value of an attribute that begins with a dollar sign.

    Args:
        text: ``$name`` or ``${expression}`` with the operators and functions of the standard, on numbers and truth values.
        parameters: values by name.

    Raises:
        ValueError: an unknown parameter, or an expression that is none or has no finite value; the message says which.
    """
    for name in _PARAMETER.findall(text):
        if name not in parameters:
            raise ValueError(f"refers to no parameter: {name!r} is not declared")
    if not text.startswith("${"):
        return parameters[text[1:]]
    if len(text) > _LONGEST or not text.endswith("}"):
        raise ValueError(f"is no expression in braces of at most {_LONGEST:,} characters")
    inner = _PARAMETER.sub(lambda found: f"({parameters[found[1]][:_NUMBER]})", text[2:-1])
    try:
        value = _value(ast.parse(inner.strip(), mode="eval").body)
    except (SyntaxError, TypeError, ArithmeticError, ValueError, RecursionError, MemoryError) as error:
        raise ValueError(f"can't be evaluated: {error}") from error
    if not math.isfinite(value):
        raise ValueError("has no finite value")
    return str(value).lower() if isinstance(value, bool) else f"{value:.17g}"


def _value(node: ast.AST) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id="true" | "false" as word):
            return word == "true"
        case ast.UnaryOp(op=op, operand=inner) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value(inner))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value(left), _value(right))
        case ast.BoolOp(op=op, values=values):
            return _OPERATORS[type(op)](*map(_value, values))
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _FUNCTIONS:
            return _FUNCTIONS[name](*map(_value, args))
    raise ValueError("only numbers, + - * / %, not, and, or, and the functions of OpenSCENARIO 1.2 may stand in it")

"""Reads a file of OpenSCENARIO XML as a tree of elements, up to bounds for the size of the tree.

The vertices of a polyline are stored in an array. Parameters and expressions in attributes (``$speed``, ``${$speed / 3.6}``) are
replaced by their values.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.satellites.tracks.source import Watch, opened
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.storage import number_in, read_xml
from pytest_rvads.support.wording import one_line

_LONGEST_EXPRESSION, _LONGEST_NUMBER = 1000, 40
"""Greatest length of an expression, and of the value of a parameter inside of an expression [characters]."""
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
VERTEX = ("row", "time", "x", "y", "h")
"""Fields of a vertex: line in the file, time [s], position [m], heading [rad]."""
_MOST_NODES = 200_000
"""Largest number of elements of a file, without the elements inside of polylines."""
_MOST_VERTICES = 5_000_000
"""Largest number of vertices of a polyline: an hour of fourteen vehicles at 100 Hz has as many."""
_LONGEST = 2**20
"""Greatest length of the value of an attribute [characters]."""
_MOST_CHARACTERS = 2**26
"""Largest sum of the lengths of all attributes of a file, without the attributes inside of polylines [characters]."""


@dataclass(slots=True, eq=False)
class Node:
    """An element of the tree."""

    tag: str
    attributes: dict[str, str]
    where: str
    """File and line, for messages."""
    children: list[Node] = field(default_factory=list)
    vertices: array[float] | None = None
    """The vertices of a polyline one after the other, each with the fields of `VERTEX`; a missing number is NaN."""

    def walk(self, *tags: str) -> Iterator[Node]:
        """Yield the elements inside of this element that have any of these tags, in the order of the file."""
        for child in self.children:
            if child.tag in tags:
                yield child
            yield from child.walk(*tags)

    def first(self, *path: str) -> Node | None:
        """Return the first element of each tag of a path inside of the one before, the last of them; None if there is none."""
        node: Node | None = self
        for tag in path:
            node = None if node is None else next(node.walk(tag), None)
        return node

    def text(self, name: str) -> str:
        """Return an attribute."""
        if name not in self.attributes:
            raise self.refused(f"has no attribute {name!r}")
        return self.attributes[name]

    def number(self, name: str, default: float | None = None) -> float:
        """Return an attribute as a finite number."""
        if default is not None and name not in self.attributes:
            return default
        text = self.text(name)
        value = number_in(text)
        if not abs(value) <= 1e12:
            raise self.refused(f"has {name}={text!r:.60}, expected a finite number")
        return value

    def points(self) -> NDArray[np.float64]:
        """Return the vertices of a polyline with the fields of `VERTEX`, shape ``(vertices, 5)``."""
        return np.array(self.vertices or (), dtype=np.float64).reshape(-1, len(VERTEX))

    def refused(self, why: str) -> RunError:
        """Return an error about this element, whose message names file, line, tag and reason."""
        return RunError(one_line(f"{self.where}: <{self.tag}> {why}"))


class _Builder:
    """Builds the tree from the events of the parser."""

    def __init__(self, where: str) -> None:
        self.where = where
        self.root: Node | None = None
        self._stack: list[Node] = []
        self._parameters: dict[str, str] = {}
        self._nodes = self._characters = 0
        self._line: Node | None = None
        """The polyline that the parser is inside of; None outside of polylines."""
        self._inside = 0
        """Number of elements inside of the polyline whose end tags the parser has not reached."""
        self._time = (0, math.nan)

    def start(self, tag: str, attributes: dict[str, str], row: int) -> None:
        place = f"{self.where}: row {row}"
        if tag == "ParameterDeclaration":  # some tools put a dollar sign before the declared name
            attributes["name"] = attributes.get("name", "").removeprefix("$")
        node = Node(tag, dict(attributes), place)
        for name, text in attributes.items():
            if len(text) > _LONGEST:
                raise RunError(f"{place}: an attribute has {len(text):,} characters, expected at most {_LONGEST:,}")
            if text.startswith("$"):
                try:
                    node.attributes[name] = evaluate(text, self._parameters)
                except ValueError as error:
                    raise RunError(one_line(f"{place}: {text[:60]!r} {error}")) from error
        if self._line is not None:
            self._inside += 1
            self._vertex(self._line, node, row)
            return
        self._nodes += 1
        self._characters += sum(map(len, attributes.values()))
        if self._nodes > _MOST_NODES or self._characters > _MOST_CHARACTERS:
            raise RunError(
                f"{self.where}: the file has more than {_MOST_NODES:,} elements, or more than {_MOST_CHARACTERS:,} characters in "
                "attributes: cut the file into several files"
            )
        if self._stack:
            self._stack[-1].children.append(node)
        elif tag != "OpenSCENARIO":
            raise RunError(one_line(f"{self.where}: the root is <{tag[:60]}>, expected <OpenSCENARIO>"))
        else:
            self.root = node
        self._stack.append(node)
        if tag == "ParameterDeclaration":
            self._parameters[node.attributes.get("name", "")] = node.attributes.get("value", "")
        elif tag == "Polyline":
            self._line, node.vertices = node, array("d")

    def end(self, _tag: str) -> None:
        if self._inside:
            self._inside -= 1
        else:
            self._line = None
            self._stack.pop()

    def _vertex(self, line: Node, node: Node, row: int) -> None:
        """Store a part of a vertex: the time in the element `Vertex`, or the position in the inner element `WorldPosition`."""
        if node.tag == "Vertex":
            self._time = row, number_in(node.attributes.get("time", "nan"))
        elif node.tag == "WorldPosition" and line.vertices is not None:
            place = node.number("x"), node.number("y")
            heading = node.number("h") if "h" in node.attributes else math.nan
            line.vertices.extend((*self._time, *place, heading))
            if len(line.vertices) > _MOST_VERTICES * len(VERTEX):
                raise RunError(
                    f"{self.where}: a polyline has more than {_MOST_VERTICES:,} vertices: cut the file into several files"
                )
        elif node.tag != "Position":
            raise node.refused("is not read as a position of a trajectory, expected a <WorldPosition>")


def read_tree(path: Path, watch: Watch | None = None) -> Node:
    """Return the root element of a file."""
    with opened(path, watch) as source:
        builder = _Builder(source.where)
        read_xml(source.chunks(), "OpenSCENARIO XML", builder.start, builder.end)
    assert builder.root is not None, "expat refuses a file without elements"
    return builder.root


def evaluate(text: str, parameters: Mapping[str, str]) -> str:
    """Return the value of an attribute that begins with a dollar sign."""
    for name in _PARAMETER.findall(text):
        if name not in parameters:
            raise ValueError(f"refers to {name!r}, which is no declared parameter")
    if not text.startswith("${"):
        return parameters[text[1:]]
    if len(text) > _LONGEST_EXPRESSION or not text.endswith("}"):
        raise ValueError(f"is no expression in braces of at most {_LONGEST_EXPRESSION:,} characters")
    inner = _PARAMETER.sub(lambda match: f"({parameters[match[1]][:_LONGEST_NUMBER]})", text[2:-1])
    try:
        value = _value_of_node(ast.parse(inner.strip(), mode="eval").body)
    except (SyntaxError, TypeError, ArithmeticError, ValueError, RecursionError, MemoryError) as error:
        raise ValueError(f"can't be evaluated: {error}") from error
    if not math.isfinite(value):
        raise ValueError("has no finite value")
    return str(value).lower() if isinstance(value, bool) else f"{value:.17g}"


def _value_of_node(node: ast.AST) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id="true" | "false" as word):
            return word == "true"
        case ast.UnaryOp(op=op, operand=inner) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value_of_node(inner))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value_of_node(left), _value_of_node(right))
        case ast.BoolOp(op=op, values=values):
            return _OPERATORS[type(op)](*map(_value_of_node, values))
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _FUNCTIONS:
            return _FUNCTIONS[name](*map(_value_of_node, args))
    raise ValueError("expected only numbers, + - * / %, not, and, or, and the functions of OpenSCENARIO 1.2")

"""OpenSCENARIO XML as a tree of bounded size, in which the vertices of a polyline are one array."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.boundedxml import read_xml
from pytest_rvads.errors import RunError
from pytest_rvads.satellites.openscenario.expressions import valued
from pytest_rvads.satellites.tracks.source import Watch, opened
from pytest_rvads.wording import one_line

__all__ = ["VERTEX", "Node", "read_tree"]

VERTEX = ("row", "time", "x", "y", "h")
"""What a vertex has: the line of the file that it stands in, its time [s], its place [m], its heading [rad]."""
_MOST_NODES = 200_000
_MOST_VERTICES = 5_000_000
"""An hour of fourteen vehicles at 100 Hz."""
_LONGEST = 2**20
"""Longest value of an attribute that is kept [characters]."""
_MOST_KEPT = 2**26
"""All attributes outside of trajectories together [characters]."""


@dataclass(slots=True, eq=False)
class Node:
    """An element."""

    tag: str
    attributes: dict[str, str]
    where: str
    """File and line, for messages."""
    children: list[Node] = field(default_factory=list)
    vertices: array[float] | None = None
    """Of a polyline, one after the other, see `VERTEX`; NaN where one has none."""

    def walk(self, *tags: str) -> Iterator[Node]:
        """Yield what is inside and has one of these tags, in the order of the file."""
        for child in self.children:
            if child.tag in tags:
                yield child
            yield from child.walk(*tags)

    def first(self, *path: str) -> Node | None:
        """Return the first element inside with the first tag, in it that with the second, and so on; None if there is none."""
        found: Node | None = self
        for tag in path:
            found = None if found is None else next(found.walk(tag), None)
        return found

    def text(self, name: str) -> str:
        """Return an attribute.

        Raises:
            RunError: it is missing.
        """
        if name not in self.attributes:
            raise self.refused(f"has no attribute {name!r}")
        return self.attributes[name]

    def number(self, name: str, default: float | None = None) -> float:
        """Return an attribute as a finite number.

        Raises:
            RunError: the attribute is no finite number, or is missing without a default.
        """
        if default is not None and name not in self.attributes:
            return default
        text = self.text(name)
        value = _number(text)
        if not abs(value) <= 1e12:
            raise self.refused(f"has {name}={text!r:.60}, expected a finite number")
        return value

    def points(self) -> NDArray[np.float64]:
        """Return the vertices of a polyline, shape ``(vertices, 5)``, see `VERTEX`."""
        return np.array(self.vertices or (), dtype=np.float64).reshape(-1, len(VERTEX))

    def refused(self, why: str) -> RunError:
        """Return the error that something is wrong with this element."""
        return RunError(one_line(f"{self.where}: <{self.tag}> {why}"))


class _Builder:
    """Builds the tree; parameters are replaced by their values where they are referred to."""

    def __init__(self, where: str) -> None:
        self.where = where
        self.root: Node | None = None
        self._stack: list[Node] = []
        self._parameters: dict[str, str] = {}
        self._nodes = self._kept = 0
        self._line: Node | None = None
        """The polyline that is being read."""
        self._inside = 0
        """How deep in it."""
        self._time = (0, math.nan)

    def start(self, tag: str, attributes: dict[str, str], row: int) -> None:
        place = f"{self.where}: row {row}"
        if tag == "ParameterDeclaration":  # some tools write the sign of a reference into the name, too
            attributes["name"] = attributes.get("name", "").removeprefix("$")
        node = Node(tag, {name: self._value(value, place) for name, value in attributes.items()}, place)
        if self._line is not None:
            self._inside += 1
            self._vertex(self._line, node, row)
            return
        self._nodes += 1
        self._kept += sum(map(len, attributes.values()))
        if self._nodes > _MOST_NODES or self._kept > _MOST_KEPT:
            raise RunError(
                f"{self.where}: it has more than {_MOST_NODES:,} elements, or {_MOST_KEPT:,} characters in them: cut it into "
                "several files"
            )
        if self._stack:
            self._stack[-1].children.append(node)
        elif tag != "OpenSCENARIO":
            raise RunError(one_line(f"{self.where}: its root is <{tag[:60]}>, expected <OpenSCENARIO>"))
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

    def _value(self, text: str, place: str) -> str:
        if len(text) > _LONGEST:
            raise RunError(f"{place}: an attribute has {len(text):,} characters, expected at most {_LONGEST:,}")
        if not text.startswith("$"):
            return text
        try:
            return valued(text, self._parameters)
        except ValueError as error:
            raise RunError(one_line(f"{place}: {text[:60]!r} {error}")) from error

    def _vertex(self, line: Node, node: Node, row: int) -> None:
        """Read a part of a vertex: the element `Vertex` has the time, and the inner element `WorldPosition` has the position."""
        if node.tag == "Vertex":
            self._time = row, _number(node.attributes.get("time", "nan"))
        elif node.tag == "WorldPosition" and line.vertices is not None:
            place = node.number("x"), node.number("y")
            heading = node.number("h") if "h" in node.attributes else math.nan
            line.vertices.extend((*self._time, *place, heading))
            if len(line.vertices) > _MOST_VERTICES * len(VERTEX):
                raise RunError(f"{self.where}: it has more than {_MOST_VERTICES:,} vertices: cut it into several files")
        elif node.tag != "Position":
            raise node.refused("is a place of a trajectory that is not read, expected a <WorldPosition>")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def read_tree(path: Path, watch: Watch | None = None) -> Node:
    """Return the root of a file.

    Raises:
        RunError: it can't be read, is no OpenSCENARIO XML, or holds too much.
    """
    with opened(path, watch) as source:
        builder = _Builder(source.where)
        read_xml(source.chunks(), "OpenSCENARIO XML", builder.start, builder.end)
    if builder.root is None:  # expat refuses a file without elements
        raise RunError(f"{path.name}: it has no <OpenSCENARIO>")
    return builder.root

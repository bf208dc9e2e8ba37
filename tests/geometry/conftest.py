"""Helpers to write variants of maps and to read them back."""

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pytest_rvads.geometry.road_map import RoadMap, read_map
from tools.crossings import Layout, opendrive

Tree = Callable[..., ElementTree.Element]
Read = Callable[..., RoadMap]


@pytest.fixture
def tree() -> Tree:
    """Make the XML tree of a layout, to be changed before it is read."""
    return lambda **layout: ElementTree.fromstring(opendrive(Layout(**layout)).encode())


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Read a map from text, bytes or an XML tree."""

    def read(content: str | bytes | ElementTree.Element, name: str = "map.xodr") -> RoadMap:
        path = tmp_path / name
        if isinstance(content, ElementTree.Element):
            content = ElementTree.tostring(content)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return read_map(path)

    return read

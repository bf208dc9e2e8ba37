"""OpenDRIVE files: the built-in maps, and the parsing of files from unknown writers.

Size, depth, numbers and speeds of a file are bounded, and every error is one sentence.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder

from pytest_rvads.geometry.segment import NO_LIMIT
from pytest_rvads.support.errors import MapError
from pytest_rvads.support.storage import XmlError, read_file, read_xml
from pytest_rvads.support.wording import one_line

NAMES = (
    "stop4",
    "stop3",
    "light4",
    "light3",
    "paper_stop4",
    "paper_light4",
    "yield4",
    "right4",
    "lanes4",
    "zebra4",
    "walk4",
    "roundabout4",
)
"""Names of the built-in maps, which `tools/make_maps.py` writes."""


def path_of(name: str) -> Path:
    """Return the OpenDRIVE file of the built-in map `name`."""
    return Path(__file__).parents[1] / "data" / f"{name}.xodr"


ARM = "rvads-arm"
"""Code of the ``<userData>`` in which a road names the first road of its arm, in files that the project wrote from lanelets."""
MAX_BYTES = 128 * 2**20
"""Largest file that is read [bytes]; whole towns have 1 to 20 MB."""
MAX_ELEMENTS = 300_000
"""Most elements of a file that are read; a town has 30,000."""
_ID = re.compile(r"[^\x00-\x1f\x7f-\x9f]{0,1000}")
"""Pattern of ids: ids name junctions in tables, reports and files of runs."""
_ENCODING = re.compile(rb"""<\?xml[^>]*encoding=["']([A-Za-z0-9._-]+)""")
"""The encoding that an XML declaration names."""
_SKIPPED = frozenset(
    {"userData", "roadMark", "elevationProfile", "lateralProfile", "surface", "railroad", "crossSectionSurface", "outlines"}
)
"""Elements that do not matter to the lanes in plan view."""

_UNITS = {"": 1.0, "m/s": 1.0, "mph": 0.44704, "km/h": 1 / 3.6}
"""Per unit its size [m/s]: OpenDRIVE 1.8, section 8.2; an international mile has 1,609.344 m."""
_WITH_UNIT = re.compile(r"\s*(\d{1,9}\.?\d{0,30}(?:e[-+]?\d{1,2})?)\s*(m/s|mph|km/h)?\s*", re.IGNORECASE)


class _Builder:
    """Builds elements without namespaces and without the elements in `_SKIPPED`."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.tree = TreeBuilder()
        self.skipping = 0
        self.count = 0
        self.crosswalk = False
        """Whether the last ``<object>`` is a crosswalk, whose outlines matter."""
        self.projection = False
        """Whether the parser is in ``<geoReference>``; the text of other elements is not stored."""

    def start(self, tag: str, attributes: dict[str, str], _row: int) -> None:
        tag = tag.rpartition(":")[2]
        if tag == "object":
            self.crosswalk = attributes.get("type", "").lower() == "crosswalk"
        if self.skipping or (tag in _SKIPPED and attributes.get("code") != ARM and not (tag == "outlines" and self.crosswalk)):
            self.skipping += 1
            return
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise MapError(f"{self.name} has more than {MAX_ELEMENTS:,} elements; cut the map into pieces")
        if self.count == 1 and tag != "OpenDRIVE":
            raise MapError(f"{self.name} is not an OpenDRIVE file: its root element is <{tag[:40]}>, expected <OpenDRIVE>")
        if not _ID.fullmatch(attributes.get("id", "")):
            raise MapError(
                f"{self.name}: the id of <{one_line(tag, 40)}> must have at most 1,000 characters and no control characters, "
                f"got {attributes['id'][:40]!r}"
            )
        self.tree.start(tag, attributes)
        self.projection = tag == "geoReference"

    def text(self, text: str) -> None:
        if self.projection and not self.skipping:
            self.tree.data(text)

    def end(self, tag: str) -> None:
        if self.skipping:
            self.skipping -= 1
        else:
            self.tree.end(tag.rpartition(":")[2])
            self.projection = False


def load(path: str | os.PathLike[str]) -> Element:
    """Parse an OpenDRIVE file into elements without namespaces."""
    try:
        file = Path(path)
        if not file.is_file():
            fault = "is not a regular file" if file.exists() else "does not exist"
            raise MapError(f"map file {file} {fault}; give the path of an OpenDRIVE file (.xodr)")
        size = file.stat().st_size
        if size > MAX_BYTES:
            raise MapError(f"map file {file} has {size / 2**20:.0f} MB, more than the {MAX_BYTES // 2**20} MB that are read")
        if not size:
            raise MapError(f"map file {file} is empty, expected an OpenDRIVE file")
        builder = _Builder(f"map file {file}")
        with file.open("rb") as stream:
            chunks = iter(lambda: stream.read(2**18), b"")
            read_xml(chunks, "an OpenDRIVE file (.xodr)", builder.start, builder.end, builder.text)
        return builder.tree.close()
    except XmlError as error:
        raise MapError(f"map file {path}: {error}") from None
    except (OSError, ValueError, TypeError) as error:
        raise MapError(f"map file {path} cannot be read: {error}") from None


def number(element: Element, name: str, place: str, default: float | None = None) -> float:
    """Return attribute `name` of `element` as a finite number; `default` is the value of a missing or empty attribute."""
    text = element.get(name)
    if not text:
        if default is not None:
            return default
        raise MapError(f"{place}: <{element.tag}> has no attribute {name!r}, expected a number")
    try:
        value = float(text)
    except ValueError:
        raise MapError(f"{place}: {name}={text[:40]!r} of <{element.tag}> is not a number") from None
    if not -1e12 <= value <= 1e12:
        raise MapError(f"{place}: {name}={text[:40]!r} of <{element.tag}> is not a finite number between -1e12 and 1e12")
    return value


def integer(element: Element, name: str, place: str) -> int:
    """Return attribute `name` of `element` as a whole number of at most six digits."""
    text = element.get(name, "")
    try:
        value = int(text)
    except ValueError:
        raise MapError(f"{place}: {name}={text[:40]!r} of <{element.tag}> is not a whole number") from None
    if abs(value) > 999_999:
        raise MapError(f"{place}: {name}={text[:40]!r} of <{element.tag}> is out of range, expected at most six digits")
    return value


def speed_of(text: str, what: str) -> float:
    """Return a speed [m/s] from text with or without a unit, such as ``30mph``."""
    match = _WITH_UNIT.fullmatch(text)
    speed = float(match[1]) * _UNITS[(match[2] or "").lower()] if match else 0.0
    if not 0.0 < speed < NO_LIMIT:
        raise MapError(f"{what} must be a speed above 0 such as 30mph, 50km/h or, in m/s, 13.9, got {text[:40]!r}")
    return speed


def limit_of(element: Element) -> float | None:
    """Return the speed limit of an element [m/s], None if the element leaves the limit undefined."""
    most = element.get("max", "").strip()
    if most.lower() in ("undefined", ""):
        return None
    return NO_LIMIT if most.lower() == "no limit" else speed_of(f"{most} {element.get('unit', '')}".strip(), "it")


def text_of(path: Path) -> str:
    """Return the text of an XML file, in the encoding that its XML declaration names; UTF-8 without a declaration."""
    try:
        content = read_file(path, MAX_BYTES)
        declared = _ENCODING.match(content)
        return content.decode(declared[1].decode() if declared else "utf-8-sig")
    except (OSError, ValueError, LookupError) as error:
        raise MapError(f"map file {path} can't be read as text: {error}") from None

"""Names and files of the built-in maps."""

from __future__ import annotations

from pathlib import Path

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
    return Path(__file__).parent / "data" / f"{name}.xodr"

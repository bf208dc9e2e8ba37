"""The maps that ship with the package: X and T junctions with stop signs or lights, and the recorded Xs of the paper."""

from __future__ import annotations

from pathlib import Path

from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.opendrive.writer import Layout

__all__ = ["LAYOUTS", "path_of"]

_STOP, _LIGHTS = JunctionControl.STOP, JunctionControl.LIGHTS

LAYOUTS = {
    "stop4": Layout(4, _STOP),
    "stop3": Layout(3, _STOP),
    "light4": Layout(4, _LIGHTS),
    "light3": Layout(3, _LIGHTS),
    "paper_stop4": Layout(4, _STOP, stop=14.5, lane_offset=4.6),
    "paper_light4": Layout(4, _LIGHTS, stop=14.5, lane_offset=4.6),
}
"""Per name the layout that the file was written from. The last two have about the lengths of the paper's recorded
junctions: 15.6 m to the right, 29 m straight on, 30 m to the left."""


def path_of(name: str) -> Path:
    """Return the OpenDRIVE file of the built-in map `name`."""
    return Path(__file__).parent / "data" / f"{name}.xodr"

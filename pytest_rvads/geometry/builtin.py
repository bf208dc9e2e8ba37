"""The built-in maps: Xs and Ts with every kind of control, turn lanes, a roundabout, the Xs of the paper."""

from __future__ import annotations

from pathlib import Path

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.opendrive.roundabout import Roundabout
from pytest_rvads.geometry.opendrive.writer import Layout

__all__ = ["CROSSINGS", "LAYOUTS", "path_of"]

_STOP, _LIGHTS = JunctionControl.STOP, JunctionControl.LIGHTS

CROSSINGS = {
    "stop4": Layout(4, _STOP),
    "stop3": Layout(3, _STOP),
    "light4": Layout(4, _LIGHTS),
    "light3": Layout(3, _LIGHTS),
    "paper_stop4": Layout(4, _STOP, stop=14.5, lane_offset=4.6),
    "paper_light4": Layout(4, _LIGHTS, stop=14.5, lane_offset=4.6),
    "yield4": Layout(4, JunctionControl.YIELD, signs=(Sign.YIELD, Sign.PRIORITY) * 2),
    "right4": Layout(4, JunctionControl.NONE),
    "lanes4": Layout(4, _LIGHTS, lanes=(((1, 2), (3,)),) * 4, shift=1.75),
}
"""Layouts of maps with one junction.

The maps of the paper have about the lengths of its recorded junctions: 15.6 m to the right, 29 m straight on, 30 m to the left.
The major road of ``yield4`` runs from west to east. In ``lanes4`` the left-turn lanes face each other.
"""

LAYOUTS: dict[str, Layout | Roundabout] = {**CROSSINGS, "roundabout4": Roundabout(4)}
"""Per name, the layout from which the file was written."""


def path_of(name: str) -> Path:
    """Return the OpenDRIVE file of the built-in map `name`."""
    return Path(__file__).parent / "data" / f"{name}.xodr"

"""The layouts of the built-in maps, which ``python -m tools.make_maps`` writes anew."""

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.opendrive.map_file import path_of
from tools.crossings import Layout, opendrive
from tools.roundabouts import Roundabout, roundabout

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
    "zebra4": Layout(4, JunctionControl.YIELD, signs=(Sign.YIELD, Sign.PRIORITY) * 2, crosswalk=3.0),
    "walk4": Layout(4, _LIGHTS, crosswalk=3.0),
}
"""Layouts of maps with one junction.

In ``paper_stop4`` and ``paper_light4`` the movements are about as long as in the junctions that the paper recorded: 15.6 m to the
right, 29 m straight on, 30 m to the left.
The major road of ``yield4`` runs from west to east. In ``lanes4`` the left-turn lanes face each other. The layout ``zebra4`` is
``yield4``, and ``walk4`` is ``light4``, with a crosswalk over every arm; in ``walk4`` pedestrians have lights.
"""

LAYOUTS: dict[str, Layout | Roundabout] = {**CROSSINGS, "roundabout4": Roundabout(4)}
"""Per name of a built-in map, the layout from which the file of the map was written."""


def main() -> None:
    """Write one OpenDRIVE file per built-in layout."""
    for name, layout in LAYOUTS.items():
        path = path_of(name)
        path.parent.mkdir(exist_ok=True)
        text = roundabout(layout, name) if isinstance(layout, Roundabout) else opendrive(layout, name)
        path.write_text(text, encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main()

"""Who gives way in SUMO: the type of the node, the priorities of its edges, and whether netconvert made of them what we mean."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element

from pytest_rvads.errors import ScenarioError
from pytest_rvads.junctions.conflicts import Key
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.junctions.yielding import Reason
from pytest_rvads.maps.control import Sign

__all__ = ["check_yields", "node_type", "priority"]

_RANK = {Sign.STOP: 1, Sign.YIELD: 1, Sign.NONE: 2, Sign.LIGHTS: 2, Sign.PRIORITY: 3}
"""As in `pytest_rvads.junctions.yielding`."""


def priority(sign: Sign) -> int:
    """Return the priority of an edge that ends at a sign; the higher one goes first."""
    return _RANK[sign]


def node_type(junction: Junction) -> str:
    """Return the type of the node that a junction is in SUMO (page "Networks/PlainXML", node types).

    Raises:
        ScenarioError: SUMO has no such junction.
    """
    signs = {entrance.sign for entrance in junction.entrances}
    lower = {sign for sign in signs if _RANK[sign] == min(_RANK[s] for s in signs)}
    if Sign.LIGHTS in signs:
        if len(signs) > 1 or None in {entrance.phase for entrance in junction.entrances}:
            raise _refused(junction, "lights at some entrances only, where SUMO has them at all or none")
        return "traffic_light"
    if signs == {Sign.STOP}:
        return "allway_stop"
    if len({_RANK[sign] for sign in signs}) == 1 and Sign.STOP not in signs:
        return "right_before_left"
    if lower == {Sign.STOP, Sign.YIELD}:
        raise _refused(junction, "stop signs beside yield signs, where SUMO has one of the two at all minor roads")
    return "priority_stop" if lower == {Sign.STOP} else "priority"


def check_yields(junction: Junction, node: Element, links: Sequence[Key]) -> None:
    """Check that who has to give way does so in SUMO, and not the other; at an all-way stop it is who came later.

    Between movements that don't touch here SUMO may ask for more, and where nobody can say who gives way it decides: that is its
    own model.

    Args:
        junction: as it is meant.
        node: the junction in the network, with a ``request`` per link.
        links: the movement of every link, in the order of their numbers.

    Raises:
        ScenarioError: it is not so.
    """
    if node.get("type") == "allway_stop":
        return
    # The last digit is that of link 0.
    rows = {links[int(item.attrib["index"])]: item.attrib["response"][::-1] for item in node.iter("request")}
    entrances, lights = junction.entrances, node.get("type") == "traffic_light"
    for (one, other), reason in (junction.yields or {}).items():
        if reason is Reason.UNDECIDED:
            continue
        at_once = not lights or entrances[one[0]].phase == entrances[other[0]].phase
        gives, takes = rows[one][links.index(other)] == "1", rows[other][links.index(one)] == "1"
        if at_once and (takes or not gives):
            ways = f"who goes from {one[0]} to {one[1]} gives way to who goes from {other[0]} to {other[1]}"
            raise _refused(junction, f"a right of way that SUMO's network does not have: {ways}")


def _refused(junction: Junction, why: str) -> ScenarioError:
    return ScenarioError(f"junction {junction.name!r} can't be simulated in SUMO, it has {why}: choose another simulator for it")

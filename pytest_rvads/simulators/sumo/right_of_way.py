"""Who gives way in SUMO: the type of the node, the priorities of its edges, and whether netconvert made of them what we mean."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element

from pytest_rvads.errors import ScenarioError
from pytest_rvads.junctions.conflicts import Key
from pytest_rvads.junctions.junction import Junction
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
            raise _refused(junction, "lights at some entrances only, SUMO's have them at all")
        return "traffic_light"
    if signs == {Sign.STOP}:
        return "allway_stop"
    if len({_RANK[sign] for sign in signs}) == 1 and Sign.STOP not in signs:
        return "right_before_left"
    if lower == {Sign.STOP, Sign.YIELD}:
        raise _refused(junction, "stop signs beside yield signs, SUMO's have one of both at all minor roads")
    return "priority_stop" if lower == {Sign.STOP} else "priority"


def check_yields(junction: Junction, node: Element, links: Sequence[Key]) -> None:
    """Check that who gives way to whom is what the junction says; at an all-way stop that is decided by who came first.

    Args:
        junction: as it is meant.
        node: the junction in the network, with a ``request`` per link.
        links: the movement of every link, in the order of their numbers.

    Raises:
        ScenarioError: it is not.
    """
    if node.get("type") == "allway_stop":
        return
    yields, entrances = junction.yields or {}, junction.entrances
    lights = node.get("type") == "traffic_light"
    for request in node.iter("request"):
        one = links[int(request.attrib["index"])]
        bits = request.attrib["response"][::-1]  # the last digit is that of link 0
        for other, bit in zip(links, bits, strict=True):
            at_once = not lights or entrances[one[0]].phase == entrances[other[0]].phase
            if at_once and one[0] != other[0] and (bit == "1") != ((one, other) in yields):
                ways = f"who goes from {one[0]} to {one[1]}", f"who goes from {other[0]} to {other[1]}"
                told = "{} gives way to {}" if bit == "1" else "{} does not give way to {}"
                raise _refused(junction, f"another right of way: in SUMO's network {told.format(*ways)}")


def _refused(junction: Junction, why: str) -> ScenarioError:
    return ScenarioError(f"junction {junction.name!r} can't be simulated in SUMO, it has {why}: choose another simulator for it")

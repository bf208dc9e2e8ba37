"""On which side traffic keeps where a file does not state it, or states it wrongly."""

import math
from itertools import permutations

import pytest

from .conftest import Read, Tree

SIDES = [(0.0, 1), (90.0, 2), (180.0, 3), (270.0, 0)]
"""Direction of each arm as seen from the centre [degrees], and its number."""


def one_way(left_hand: bool) -> str:
    """Return an X of one-way roads that are all drawn along their traffic, lane -1, as SUMO writes them, without any rule."""
    roads, rows = [], []
    beside = 2.0 if left_hand else -2.0  # of the way out, to the left of the direction away from the centre
    places = {}

    def road(id: int, junction: int, length: float, start: tuple[float, float, float], shape: str, link: str) -> None:
        x, y, heading = start
        lane = '<lane id="-1" type="driving"><link><predecessor id="-1"/><successor id="-1"/></link><width a="3"/></lane>'
        roads.append(
            f'<road id="{id}" junction="{junction}" length="{length}"><link>{link}</link><planView>'
            f'<geometry s="0" x="{x}" y="{y}" hdg="{heading}" length="{length}">{shape}</geometry></planView><lanes>'
            f'<laneSection s="0"><right>{lane}</right></laneSection></lanes></road>'
        )

    for arm, (degrees, _) in enumerate(SIDES):
        a = math.radians(degrees)
        for out in (False, True):
            off = beside if out else -beside
            near = 20 * math.cos(a) - off * math.sin(a), 20 * math.sin(a) + off * math.cos(a)
            far = near[0] + 80 * math.cos(a), near[1] + 80 * math.sin(a)
            heading = a if out else a + math.pi
            x, y = near if out else far
            # Half a lane to the left, so that the lane centre runs through these points.
            start = x - 1.5 * math.sin(heading), y + 1.5 * math.cos(heading), heading
            tag = "predecessor" if out else "successor"
            road(2 * arm + out, -1, 80, start, "<line/>", f'<{tag} elementType="junction" elementId="9"/>')
            places[arm, out] = near[0] - 1.5 * math.sin(heading), near[1] + 1.5 * math.cos(heading), heading
    for id, (one, two) in enumerate(permutations(range(4), 2), start=100):
        (x, y, h), (u, v, k) = places[one, False], places[two, True]
        dx, dy = u - x, v - y
        pu, pv = dx * math.cos(h) + dy * math.sin(h), dy * math.cos(h) - dx * math.sin(h)
        size = math.hypot(pu, pv)
        tu, tv = size * math.cos(k - h), size * math.sin(k - h)
        # The cubic with these ends and directions there.
        cu, du = 3 * pu - 2 * size - tu, size + tu - 2 * pu
        cv, dv = 3 * pv - tv, tv - 2 * pv
        steps = [(size + 2 * cu * p + 3 * du * p * p, 2 * cv * p + 3 * dv * p * p) for p in (i / 500 for i in range(501))]
        length = sum(math.hypot(*step) for step in steps) / len(steps)
        shape = f'<paramPoly3 bU="{size}" cU="{cu}" dU="{du}" cV="{cv}" dV="{dv}" pRange="normalized"/>'
        ends = ((2 * one, "predecessor", "end"), (2 * two + 1, "successor", "start"))
        link = "".join(f'<{tag} elementType="road" elementId="{r}" contactPoint="{end}"/>' for r, tag, end in ends)
        road(id, 9, length, (x, y, h), shape, link)
        row = f'<connection id="{id}" incomingRoad="{2 * one}" connectingRoad="{id}" contactPoint="start">'
        rows.append(f'{row}<laneLink from="-1" to="-1"/></connection>')
    return f'<OpenDRIVE>{"".join(roads)}<junction id="9">{"".join(rows)}</junction></OpenDRIVE>'


@pytest.mark.parametrize("left_hand", [False, True])
def test_one_way_roads_tell_by_where_the_way_back_lies(read: Read, left_hand: bool) -> None:
    road_map = read(one_way(left_hand))
    (report,) = road_map.junctions
    assert report.usable, report.reason
    assert report.left_hand == left_hand
    assert [warning.kind for warning in road_map.warnings] == (["side"] if left_hand else [])
    turns = {(way.entrance, way.exit): way.turn for way in report.movements}
    arms = [number for _, number in SIDES]
    assert {key: turn.value for key, turn in turns.items()} == {
        (a, b): {1: "right", 2: "straight", 3: "left"}[(b - a) % 4] for a in arms for b in arms if a != b
    }
    # At an X, who is right-of me stands on my right; where traffic keeps left, on my left.
    assert report.right_of == {((i + (3 if left_hand else 1)) % 4, i) for i in range(4)}


def test_tables_tell_where_no_road_does(read: Read, tree: Tree) -> None:
    """All rows come from lanes that lead into the junction only if traffic keeps left."""
    root, stated = tree(left_hand=True), read(tree(left_hand=True)).report("1")
    for element in root.iter("road"):
        del element.attrib["rule"]
    road_map = read(root)
    report = road_map.report("1")
    assert report.left_hand
    assert [warning.kind for warning in road_map.warnings] == ["side"]
    assert report.right_of == stated.right_of == {((i + 3) % 4, i) for i in range(4)}
    assert [way[:4] for way in report.movements] == [way[:4] for way in stated.movements]


def test_connecting_roads_that_state_the_wrong_side_follow_their_arms(read: Read, tree: Tree) -> None:
    """scenariogeneration writes RHT on the connecting roads of arms that state LHT."""
    root, stated = tree(left_hand=True), read(tree(left_hand=True)).report("1")
    for element in root.iter("road"):
        if element.get("junction") != "-1":
            element.set("rule", "RHT")
    road_map = read(root)
    (warning,) = road_map.warnings
    assert (warning.kind, warning.junction) == ("side", "1")
    assert "12 connecting road(s) of junction '1'" in warning.message
    assert road_map.report("1").usable
    assert [way[:4] for way in road_map.report("1").movements] == [way[:4] for way in stated.movements]


def test_one_wrong_connecting_road_is_turned_alone(read: Read, tree: Tree) -> None:
    root = tree()
    wrong = next(element for element in root.iter("road") if element.get("junction") != "-1")
    wrong.set("rule", "LHT")
    road_map = read(root)
    assert road_map.report("1").usable
    assert not road_map.report("1").left_hand
    assert "1 connecting road(s) of junction '1'" in road_map.warnings[0].message

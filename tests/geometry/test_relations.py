"""Who conflicts with whom and who gives way, against geometry and rules written down here once more."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, permutations, product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.finder import find, names
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import CONFLICT_WIDTH, Key
from pytest_rvads.satellites.relations.variants import mirrored
from tools.crossings import Layout, opendrive

JUNCTIONS = [*names(), *(f"{name} in a mirror" for name in ("stop4", "stop3", "light4", "light3"))]


def junction_of(name: str) -> Junction:
    name, _, seen = name.partition(" ")
    return mirrored(find(name)) if seen else find(name)


def nearest(one: NDArray[np.float64], two: NDArray[np.float64]) -> float:
    """Return the distance of two lines given by their points, 0 where they cross [m]."""
    (a, b), (c, d) = ((line[:-1], line[1:]) for line in (one, two))

    def side(p: NDArray[np.float64], q: NDArray[np.float64], r: NDArray[np.float64]) -> NDArray[np.float64]:
        u, v = q - p, r - p
        return np.sign(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])

    a_, b_, c_, d_ = a[:, None], b[:, None], c[None], d[None]
    if ((side(a_, b_, c_) * side(a_, b_, d_) < 0) & (side(c_, d_, a_) * side(c_, d_, b_) < 0)).any():
        return 0.0

    def to_pieces(points: NDArray[np.float64], p: NDArray[np.float64], q: NDArray[np.float64]) -> float:
        along = np.clip(((points[:, None] - p) * (q - p)).sum(axis=-1) / ((q - p) ** 2).sum(axis=-1), 0.0, 1.0)
        return float(np.linalg.norm(points[:, None] - p - along[..., None] * (q - p), axis=-1).min())

    return min(to_pieces(one, c, d), to_pieces(two, a, b))


def comes_from(junction: Junction, entrance: int, other: int) -> str:
    """Return from where, for a driver at `entrance`, a vehicle at `other` comes: from ahead, from the first or the last side.

    The first side is that of whoever goes first between equals: the right, in a mirror the left.
    """
    mine, yours = (junction.way_in(e).pose(junction.way_in(e).length).heading for e in (entrance, other))
    turned = math.degrees(math.remainder(yours - mine, math.tau)) * (-1 if junction.left_hand else 1)
    return "ahead" if abs(turned) > 135 else "first" if turned > 45 else "last"


MINOR, MAJOR = {Sign.STOP, Sign.YIELD}, {Sign.PRIORITY}


def gives_way(junction: Junction, one: Key, other: Key) -> bool:
    """Return whether who makes the movement `one` gives way to who makes the conflicting one `other`, by the law."""
    mine, yours = (junction.entrances[entrance].sign for entrance, _ in (one, other))
    if mine is yours is Sign.LIGHTS and not any({one[0], other[0]} <= group for group in junction.phase_groups):
        return False  # one of them has red
    if (mine in MINOR) != (yours in MINOR):
        return mine in MINOR
    if (mine in MAJOR) != (yours in MAJOR):
        return yours in MAJOR
    where = comes_from(junction, one[0], other[0])
    if where == "ahead":
        across = Turn.RIGHT if junction.left_hand else Turn.LEFT
        return junction.movements[one].turn is across and junction.movements[other].turn is not across
    return where == "first" and Sign.LIGHTS not in (mine, yours)


def check_yields(junction: Junction) -> None:
    """Compare all pairs of conflicting movements with the law; of no two does each give way to the other."""
    yields = junction.yields
    assert yields.keys() <= junction.conflicts
    for one, other in junction.conflicts:
        assert ((one, other) in yields) == gives_way(junction, one, other), (one, other, junction.entrances)
        assert not {(one, other), (other, one)} <= yields.keys()


@pytest.mark.parametrize("name", JUNCTIONS)
def test_movements_conflict_where_their_lines_cross_join_or_pass_too_near(name: str) -> None:
    junction = junction_of(name)
    for one, two in permutations(junction.movements, 2):
        gap = nearest(junction.way_through(*one).points, junction.way_through(*two).points)
        assert ((one, two) in junction.conflicts) == (one[0] != two[0] and gap < CONFLICT_WIDTH)
        if one[0] != two[0] and one[1] == two[1]:
            assert junction.stretches[one, two].merges


@pytest.mark.parametrize("name", JUNCTIONS)
def test_what_two_movements_share_is_the_same_seen_from_either(name: str) -> None:
    junction = junction_of(name)
    for (one, two), shared in junction.stretches.items():
        assert junction.stretches[two, one] == (shared.yours, shared.mine, shared.merges)
        assert 0 <= shared.mine.start <= shared.mine.end <= junction.movements[one].length
        assert shared.merges == (one[1] == two[1])
        if shared.merges:
            assert shared.mine.end == junction.movements[one].length


@pytest.mark.parametrize("name", JUNCTIONS)
def test_who_gives_way_at_a_built_in_junction(name: str) -> None:
    check_yields(junction_of(name))


def signs(ways: int) -> Iterator[tuple[Sign, ...]]:
    kinds = (Sign.STOP, Sign.YIELD, Sign.NONE, Sign.PRIORITY)
    if ways == 3:
        yield from product(kinds, repeat=3)
    else:
        yield from (pair * 2 for pair in product(kinds, repeat=2))
        yield from permutations(kinds)


@pytest.mark.parametrize("name", ["stop3", "stop4", "stop4 in a mirror"])
def test_signs_come_before_sides(name: str) -> None:
    junction = junction_of(name)
    for kinds in signs(junction.ways):
        entrances = zip(junction.entrances, kinds, strict=True)
        check_yields(replace(junction, entrances=tuple(replace(lane, sign=sign) for lane, sign in entrances)))


@pytest.mark.parametrize("ways", [5, 6])
def test_no_two_vehicles_yield_to_each_other_at_junctions_of_many_arms(ways: int, tmp_path: Path) -> None:
    path = tmp_path / "many.xodr"
    path.write_text(opendrive(Layout(ways, JunctionControl.NONE, stop=25.0)))
    junction = find("1", path)
    for one, other in combinations(junction.movements, 2):
        assert ((one, other) in junction.conflicts) == ((other, one) in junction.conflicts)
        assert not {((one, other)), ((other, one))} <= junction.yields.keys()
    assert junction.yields

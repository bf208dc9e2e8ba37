"""The numbers of classes and pairs to cover at junctions, if the numbers of ways do not determine them."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec.structs import replace

from pytest_rvads.junctions.junction import Junction
from pytest_rvads.report.session_report import Extent, Move
from pytest_rvads.scenarios.orbits import WAYS, Orbits
from pytest_rvads.scenarios.pairs import PAIRED, pairs_at
from pytest_rvads.scenarios.selection import Selection

__all__ = ["extended"]


def extended(extents: Mapping[str, Extent], selection: Selection) -> dict[str, Extent]:
    """Return extents with the extent of a selection added; junctions as in the paper, with whole classes, need no extent."""
    place = selection.place
    full, usual = Orbits.at(place, selection.occupancy), Orbits.at(place)
    occupancy = "arms" if full == usual else selection.occupancy
    if selection.cover in ("class", "scenario", "rotation") and place.ways in WAYS and full == Orbits.plain(place.ways):
        return dict(extents)
    before = extents.get(place.name, Extent(turns=full.blocks))
    partial = {occupancy: selection.orbits.count} if selection.cover == "partial" else {}
    seated = sum(map(full.seated, range(full.size))) // full.blocks
    classes = before.classes | {occupancy: (full.count, full.scenarios, seated)}
    after = replace(before, classes=classes, partial=before.partial | partial)
    if selection.cover in PAIRED or not place.one_lane_each:
        known = place.conflicts is not None
        conflicts = _moves(place, conflicting=True) if known else ()
        after = replace(after, pairs=_moves(place, conflicting=False), conflicts=conflicts)
    return {**extents, place.name: after}


def _moves(place: Junction, *, conflicting: bool) -> tuple[tuple[Move, Move], ...]:
    def move(key: tuple[int, int]) -> Move:
        entrance, exit = place.entrances[key[0]], place.exits[key[1]]
        return (entrance.arm, entrance.lane), (exit.arm, exit.lane)

    return tuple((move(one), move(other)) for one, other in pairs_at(place, conflicting=conflicting))

"""The digest of a junction: equal for junctions on which every case gives the same runs and verdicts."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence

from pytest_rvads.geometry.crosswalks import Crosswalk
from pytest_rvads.geometry.ways import Entrance, Exit, Further, Key, Movement, centre_lines


def digest_of(  # noqa: PLR0913 - the fields of a junction, by keyword
    *,
    entrances: Sequence[Entrance],
    exits: Sequence[Exit],
    movements: Mapping[Key, Movement],
    right_of: Collection[tuple[int, int]],
    opposite: Collection[tuple[int, int]],
    left_hand: bool,
    lane_width: float,
    stated: Collection[tuple[Key, Key]],
    joining: Collection[tuple[Key, Key]],
    further: Sequence[Further],
    crossings: Sequence[Crosswalk],
) -> str:
    """Return the digest of the fields of a junction, see `Junction.digest`."""
    known = centre_lines(entrances, exits, movements)
    lines = [line for line in known if line is not None]
    drivable = len(lines) == len(known)
    lanes_in = [(e.arm, e.lane, e.sign, e.phase, e.setback) for e in entrances]
    lanes_out = [(e.arm, e.lane) for e in exits]
    ways = sorted((m.entrance, m.exit, m.turn, m.length) for m in movements.values())
    relations = sorted(right_of), sorted(opposite)
    # A rare property enters the digest only if the junction has the property. So a new property changes no digest of a
    # junction without the property.
    signs = [e.sign_setback for e in entrances] if any(e.sign_setback is not None for e in entrances) else None
    unused = {"beyond": [e.beyond for e in entrances]} if any(e.beyond is not None for e in entrances) else None
    joins = {"joining": sorted(joining)} if joining else None
    limits = [line.limits for line in lines]
    on_red = {"no_turn_on_red": [e.no_turn_on_red for e in entrances]} if any(e.no_turn_on_red for e in entrances) else None
    beside = further and {
        "further": [
            (way.kind, way.turn, way.width, way.length, start.arm, start.sign, start.phase, start.setback, end.arm)
            for way, start, end in further
        ]
    }
    rare = [item for item in (signs, sorted(stated), joins, limits if any(limits) else None, beside, on_red, unused) if item]
    sha = hashlib.sha256(json.dumps([lanes_in, lanes_out, ways, relations, left_hand, drivable, *rare]).encode())
    if drivable:
        sha.update(json.dumps([lane_width, [len(line.points) for line in lines]]).encode())
        for line in lines:
            sha.update(line.points.tobytes())
        for way, start, end in further:
            for part in (start.approach, way.path, end.road):
                sha.update(b"-" if part is None else part.points.tobytes())
        for crosswalk in crossings if further else ():
            sha.update(json.dumps([crosswalk.arm, crosswalk.middle, crosswalk.island]).encode() + crosswalk.area.tobytes())
    return sha.hexdigest()

"""What a ``<junction>`` of a file is to the model: arms, movements, priorities, control, and whether it is usable."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from pytest_rvads.junctions.arms import Arm, Path, arms_of, paths_of, sort_arms, turn_type, turns_in_order, walk
from pytest_rvads.junctions.junction import JunctionControl, Sign
from pytest_rvads.maps.doubts import Doubt, MapWarning
from pytest_rvads.maps.network import Network
from pytest_rvads.maps.segment import GAP_LIMIT, Turn
from pytest_rvads.opendrive.records import Document
from pytest_rvads.opendrive.signals import MapObject, ObjectKind, setback_of

__all__ = ["JunctionReport", "Way", "analyse", "control_of", "opposite_pairs", "phase_groups", "right_of_pairs"]

FEWEST, MOST = 3, 8
"""Ways a junction of the model can have."""
Pairs = frozenset[tuple[int, int]]


class Way(NamedTuple):
    """A way through a junction between two arms."""

    entrance: int
    exit: int
    turn: Turn
    length: float
    """Along the lane centre line [m]."""
    turning: float
    """Total unwrapped change of heading [rad]."""
    path: Path


@dataclass(frozen=True, slots=True, eq=False)
class JunctionReport:
    """A ``<junction>`` of a file, usable or not."""

    id: str
    arms: tuple[Arm, ...]
    """Counter-clockwise."""
    movements: tuple[Way, ...]
    """Sorted by entrance and exit."""
    control: JunctionControl
    reason: str | None
    """Why it cannot be used, None where it can."""
    approach: tuple[float, ...]
    """Per arm, length walked upstream to the previous junction or the end of the road; 0 for an arm without entrance [m]."""
    right_of: Pairs
    opposite: Pairs
    phase_groups: tuple[frozenset[int], ...]
    setbacks: tuple[float, ...]
    """Per arm, distance of the stopping line before the vertex [m]."""
    objects: tuple[MapObject, ...]
    left_hand: bool

    @property
    def ways(self) -> int:
        """Number of arms."""
        return len(self.arms)

    @property
    def signs(self) -> tuple[Sign, ...]:
        """What regulates every arm."""
        if self.control in (JunctionControl.STOP, JunctionControl.LIGHTS):
            return (Sign(self.control.value),) * self.ways
        kinds = [{item.kind for item in self.objects if item.edge in arm.entrances} for arm in self.arms]
        return tuple(
            Sign.LIGHTS if ObjectKind.LIGHT in here else Sign.STOP if ObjectKind.STOP in here else Sign.NONE for here in kinds
        )

    @property
    def usable(self) -> bool:
        """Whether scenarios can run there."""
        return self.reason is None


def analyse(
    document: Document,
    network: Network,
    id: str,
    objects: Sequence[MapObject],
    warnings: list[MapWarning],
    *,
    drop_uturns: bool = False,
) -> JunctionReport:
    """Analyse junction `id` of a document.

    Args:
        document: the records of the map.
        network: its lanes.
        id: of the junction.
        objects: signs, lights and stop lines of this junction.
        warnings: doubts about the order of movements and about priorities are appended here.
        drop_uturns: leave U-turns out instead of refusing the junction.
    """
    paths = paths_of(network, id)
    pairs = [(path.entrance, path.exit) for path in paths] + network.direct.get(id, [])
    arms = arms_of(network, pairs)

    def numbered(order: Sequence[Arm]) -> list[tuple[int, int, float]]:
        entrances = {edge: i for i, arm in enumerate(order) for edge in arm.entrances}
        exits = {edge: i for i, arm in enumerate(order) for edge in arm.exits}
        return [(entrances[p.entrance], exits[p.exit], p.turning) for p in paths]

    arms = sort_arms(arms, lambda order: turns_in_order(numbered(order), len(order)))
    ways = [
        Way(entrance, exit, turn_type(turning), path.length, turning, path)
        for (entrance, exit, turning), path in zip(numbered(arms), paths, strict=True)
        if not (drop_uturns and entrance == exit)
    ]
    ways.sort(key=lambda way: (way.entrance, way.exit, way.length, way.path.edges))
    left_hand = any(network.left_hand[end[0]] for arm in arms for end in arm.ends)
    turns = {(way.entrance, way.exit): way.turn for way in reversed(ways)}
    controlled = [{item.kind for item in objects if item.edge in arm.entrances} for arm in arms if arm.entrances]
    # With more arms than the model has room for there may be thousands, and their priorities mean nothing.
    ranked = turns if len(arms) <= MOST else {}
    opposite = opposite_pairs(ranked)
    reason = _reason(document, network, id, arms, ways, pairs)
    right_of = right_of_pairs(ranked, left_hand=left_hand)
    control = control_of(controlled)
    if reason is None:
        _doubts(id, arms, ways, right_of, control, controlled, warnings)
    groups = phase_groups(len(arms), opposite, _controllers(document, arms, objects)) if control is JunctionControl.LIGHTS else ()
    return JunctionReport(
        id,
        arms,
        tuple(ways),
        control,
        reason,
        tuple(min((_walked(network, edge) for edge in arm.entrances), default=0.0) for arm in arms),
        right_of,
        opposite,
        groups,
        tuple(setback_of(item for item in objects if item.edge in arm.entrances) for arm in arms),
        tuple(objects),
        left_hand,
    )


def control_of(controlled: Sequence[set[ObjectKind]]) -> JunctionControl:
    """Return the control of a junction from the kinds of objects at each entrance."""
    if controlled and all(ObjectKind.LIGHT in kinds for kinds in controlled):
        return JunctionControl.LIGHTS
    if controlled and all(ObjectKind.STOP in kinds for kinds in controlled):
        return JunctionControl.STOP
    if any(kinds & {ObjectKind.LIGHT, ObjectKind.STOP} for kinds in controlled):
        return JunctionControl.PARTIAL
    return JunctionControl.NONE


def right_of_pairs(turns: dict[tuple[int, int], Turn], *, left_hand: bool) -> Pairs:
    """Return the pairs ``v1 right-of v2`` (paper, table of semantics), mirrored where traffic keeps left.

    A right movement from v1 and a straight one from v2 share an exit, or a straight one from v1 and a left one
    from v2 do; with traffic on the left, right and left change places.
    """
    near, far = (Turn.LEFT, Turn.RIGHT) if left_hand else (Turn.RIGHT, Turn.LEFT)
    wanted = {(near, Turn.STRAIGHT), (Turn.STRAIGHT, far)}
    return frozenset(
        (v1, v2)
        for (v1, exit1), one in turns.items()
        for (v2, exit2), two in turns.items()
        if exit1 == exit2 and v1 != v2 and (one, two) in wanted
    )


def opposite_pairs(turns: dict[tuple[int, int], Turn]) -> Pairs:
    """Return the pairs of entrances with straight movements to each other's arm (paper, table of semantics)."""
    return frozenset(
        (a, b) for (a, b), turn in turns.items() if a != b and turn is Turn.STRAIGHT and turns.get((b, a)) is Turn.STRAIGHT
    )


def phase_groups(ways: int, opposite: Pairs, controllers: Iterable[frozenset[int]] = ()) -> tuple[frozenset[int], ...]:
    """Return the entrances that have green together, the group of entrance 0 first.

    Args:
        ways: number of entrances.
        opposite: pairs of entrances facing each other.
        controllers: entrances per controller; they count only where each one's are pairwise opposite, they cover
            every entrance once, and they say more than "one controller per signal".
    """
    given = [group for group in controllers if group]
    fits = all((a, b) in opposite for group in given for a in group for b in group if a != b)
    covers = sorted(e for group in given for e in group) == list(range(ways))
    if not (fits and covers and any(len(group) > 1 for group in given)):
        given = [frozenset([entrance]) for entrance in range(ways)]
        for a, b in sorted(opposite):
            apart = [group for group in given if not group & {a, b}]
            given = [*apart, frozenset().union(*(group for group in given if group & {a, b}))]
    return tuple(sorted(given, key=min))


def _controllers(document: Document, arms: Sequence[Arm], objects: Sequence[MapObject]) -> list[frozenset[int]]:
    number = {edge: i for i, arm in enumerate(arms) for edge in arm.entrances}
    lights: dict[str, set[int]] = {}
    for item in objects:
        if item.kind is ObjectKind.LIGHT and item.edge in number:
            lights.setdefault(item.id, set()).add(number[item.edge])
    return [frozenset(e for signal in signals for e in lights.get(signal, ())) for signals in document.controllers.values()]


def _walked(network: Network, edge: str) -> float:
    return sum(network.edges[id].length for id in walk(network, edge, upstream=True)[0])


def _reason(
    document: Document, network: Network, id: str, arms: Sequence[Arm], ways: Sequence[Way], pairs: Sequence[tuple[str, str]]
) -> str | None:
    """Return the first reason, the gravest first, why the model has no room for a junction."""
    type = document.junctions[id].type
    if type not in ("default", ""):
        return f'it is of type "{type}", and only junctions made of connecting roads (type "default") can be used'
    lost = _left_out(document, network, id)
    if lost is not None:
        return f"road {lost!r}, which belongs to it or leads to it, has no geometry or no length"
    if not ways:
        return "no drivable lane leads through it"
    for one, two in pairs:
        for edge in (network.edges[one], network.edges[two]):
            if edge.junction is not None:
                return f"road {edge.road!r}, which leads into or out of it, is itself part of junction {edge.junction!r}"
    if not FEWEST <= len(arms) <= MOST:
        return f"it has {len(arms)} arms, and only junctions of {FEWEST} to {MOST} can be used"
    if len({network.left_hand[end[0]] for arm in arms for end in arm.ends}) > 1:
        return "traffic keeps right on some of its roads and left on others"
    for i, arm in enumerate(arms):
        roads = " and ".join(f"road {end[0]!r}" for end in arm.ends)
        for lanes, what in ((arm.entrances, "entrance"), (arm.exits, "exit")):
            if not lanes:
                return f"arm {i} ({roads}) is one-way and has no {what} lane, expected one entrance and one exit lane per arm"
    crowded = next(((i, arm) for i, arm in enumerate(arms) if len(arm.entrances) > 1 or len(arm.exits) > 1), None)
    if crowded:
        i, arm = crowded
        return (
            f"arm {i} (road {arm.ends[0][0]!r}) has {len(arm.entrances)} entrance and {len(arm.exits)} exit lanes, "
            "expected one of each"
        )
    turning_back = sorted({way.entrance for way in ways if way.entrance == way.exit})
    if turning_back:
        return (
            f"it has a U-turn at entrance {turning_back[0]}, which the model has no room for; leave U-turns out with drop_uturns"
        )
    present = {(way.entrance, way.exit) for way in ways}
    missing = [(i, k) for i in range(len(arms)) for k in range(len(arms)) if i != k and (i, k) not in present]
    if missing:
        listed = ", ".join(f"{i} to {k}" for i, k in missing[:6])
        return f"it lacks {len(missing)} movements: from entrance to exit {listed}; every entrance needs one to each other arm"
    return _widest_gap(network, ways)


def _left_out(document: Document, network: Network, id: str) -> str | None:
    """Return a road of a junction, or one that it connects, whose lanes have no place."""
    if not network.left_out:
        return None
    for row in document.junctions[id].connections:
        road = document.roads.get(row.connecting)
        links = () if road is None else (road.predecessor, road.successor)
        for name in (row.incoming, row.connecting, *(link.element for link in links if link is not None and not link.junction)):
            if name in network.left_out:
                return name
    return None


def _widest_gap(network: Network, ways: Sequence[Way]) -> str | None:
    widest, where = 0.0, ("", "")
    for way in ways:
        chain = [way.path.entrance, *way.path.edges, way.path.exit]
        for one, two in pairwise(chain):
            gap = math.dist(network.edges[one].points[-1], network.edges[two].points[0])
            if gap > widest:
                widest, where = gap, (one, two)
    if widest <= GAP_LIMIT:
        return None
    return f"lanes {where[0]} and {where[1]} are linked but {widest:.2f} m apart, expected at most {GAP_LIMIT:.1f} m"


def _doubts(
    id: str,
    arms: Sequence[Arm],
    ways: Sequence[Way],
    right_of: Pairs,
    control: JunctionControl,
    controlled: Sequence[set[ObjectKind]],
    warnings: list[MapWarning],
) -> None:
    if not turns_in_order(((w.entrance, w.exit, w.turning) for w in ways), len(arms)):
        message = f"the movements of junction {id!r}, sorted by turn, do not follow the order of its exits"
        warnings.append(MapWarning(Doubt.ORDER, message, None, id))
    if not right_of:
        message = f"no entrance of junction {id!r} is right-of another (a Y junction), so the priority rules say nothing"
        warnings.append(MapWarning(Doubt.RIGHT_OF, message, None, id))
    doubled = {(w.entrance, w.exit) for w in ways if sum((v.entrance, v.exit) == (w.entrance, w.exit) for v in ways) > 1}
    for entrance, exit in sorted(doubled):
        message = f"junction {id!r} has several movements from entrance {entrance} to exit {exit}; the shortest was taken"
        warnings.append(MapWarning(Doubt.TABLE, message, None, id))
    if control is JunctionControl.PARTIAL:
        bare = [f"e{i}" for i, kinds in enumerate(controlled) if not kinds & {ObjectKind.LIGHT, ObjectKind.STOP}]
        what = (
            f"entrances {', '.join(bare)} of junction {id!r} have no stop sign or light"
            if bare
            else f"the entrances of junction {id!r} mix stop signs and lights"
        )
        warnings.append(MapWarning(Doubt.SIGNAL, f"{what}, so its control is partial", None, id))

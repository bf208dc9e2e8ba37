"""What a junction of a file is to the model: arms, movements, priorities, control, and whether it is usable."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pytest_rvads.junctions.arms import RoadArm, arms_of, sort_arms, turns_in_order
from pytest_rvads.junctions.graph import MetricGraph
from pytest_rvads.junctions.usability import MOST, unusable
from pytest_rvads.junctions.ways import Way, paths_of, walk
from pytest_rvads.maps.control import JunctionControl, MapObject, ObjectKind, Sign, control_of, phase_groups, setback_of, signs_of
from pytest_rvads.maps.doubts import Doubt, MapWarning
from pytest_rvads.maps.network import Network
from pytest_rvads.maps.segment import Turn

__all__ = ["JunctionReport", "analyse", "opposite_pairs", "right_of_pairs"]

Pairs = frozenset[tuple[int, int]]


@dataclass(frozen=True, slots=True, eq=False)
class JunctionReport:
    """A junction of a file, usable or not."""

    id: str
    arms: tuple[RoadArm, ...]
    """Counter-clockwise."""
    movements: tuple[Way, ...]
    """Sorted by entrance and exit."""
    signs: tuple[Sign, ...]
    """What regulates every arm that has an entrance."""
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
    def control(self) -> JunctionControl:
        """What regulates the junction as a whole."""
        return control_of(self.signs)

    @property
    def usable(self) -> bool:
        """Whether scenarios can run there."""
        return self.reason is None


def analyse(
    graph: MetricGraph, id: str, objects: Sequence[MapObject], warnings: list[MapWarning], *, drop_uturns: bool = False
) -> JunctionReport:
    """Analyse junction `id` of a map.

    Args:
        graph: of the map.
        id: of the junction.
        objects: signs, lights and stop lines of this junction.
        warnings: doubts about the order of movements and about priorities are appended here.
        drop_uturns: leave U-turns out instead of refusing the junction.
    """
    network = graph.network
    paths = paths_of(graph, id)
    pairs = [(path.entrance, path.exit) for path in paths] + [*network.junctions[id].direct]
    arms = arms_of(graph, pairs)

    def numbered(order: Sequence[RoadArm]) -> list[tuple[int, int, float]]:
        entrances = {edge: i for i, arm in enumerate(order) for edge in arm.entrances}
        exits = {edge: i for i, arm in enumerate(order) for edge in arm.exits}
        return [(entrances[p.entrance], exits[p.exit], p.turning) for p in paths]

    arms = sort_arms(arms, lambda order: turns_in_order(numbered(order), len(order)))
    ways = [
        Way(entrance, exit, Turn.of(turning), path.length, turning, path)
        for (entrance, exit, turning), path in zip(numbered(arms), paths, strict=True)
        if not (drop_uturns and entrance == exit)
    ]
    ways.sort(key=lambda way: (way.entrance, way.exit, way.length, way.path.edges))
    left_hand = any(road in network.left_hand for arm in arms for road, _ in arm.ends)
    turns = {(way.entrance, way.exit): way.turn for way in reversed(ways)}
    signs = signs_of([{item.kind for item in objects if item.edge in arm.entrances} for arm in arms if arm.entrances])
    # With more arms than the model has room for there may be thousands, and their priorities mean nothing.
    ranked = turns if len(arms) <= MOST else {}
    opposite, right_of = opposite_pairs(ranked), right_of_pairs(ranked, left_hand=left_hand)
    reason = unusable(graph, id, arms, ways, pairs)
    if reason is None:
        for kind, message in _doubts(id, ways, signs, right_of):
            warnings.append(MapWarning(kind, message, None, id))
    lit = control_of(signs) is JunctionControl.LIGHTS
    return JunctionReport(
        id,
        arms,
        tuple(ways),
        signs,
        reason,
        tuple(min((_walked(graph, edge) for edge in arm.entrances), default=0.0) for arm in arms),
        right_of,
        opposite,
        phase_groups(len(arms), opposite, _controllers(network, arms, objects)) if lit else (),
        tuple(setback_of(item for item in objects if item.edge in arm.entrances) for arm in arms),
        tuple(objects),
        left_hand,
    )


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


def _controllers(network: Network, arms: Sequence[RoadArm], objects: Sequence[MapObject]) -> list[frozenset[int]]:
    number = {edge: i for i, arm in enumerate(arms) for edge in arm.entrances}
    lights: dict[str, set[int]] = {}
    for item in objects:
        if item.kind is ObjectKind.LIGHT and item.edge in number:
            lights.setdefault(item.id, set()).add(number[item.edge])
    return [frozenset(e for signal in signals for e in lights.get(signal, ())) for signals in network.controllers]


def _walked(graph: MetricGraph, edge: str) -> float:
    return sum(graph.edges[id].length for id in walk(graph, edge, upstream=True))


def _doubts(id: str, ways: Sequence[Way], signs: Sequence[Sign], right_of: Pairs) -> Iterator[tuple[Doubt, str]]:
    if not turns_in_order(((w.entrance, w.exit, w.turning) for w in ways), len(signs)):
        yield Doubt.ORDER, f"the movements of junction {id!r}, sorted by turn, do not follow the order of its exits"
    if not right_of:
        yield (
            Doubt.RIGHT_OF,
            f"no entrance of junction {id!r} is right-of another (a Y junction), so the priority rules say nothing",
        )
    count = Counter((way.entrance, way.exit) for way in ways)
    for entrance, exit in sorted(pair for pair in count if count[pair] > 1):
        message = f"junction {id!r} has several movements from entrance {entrance} to exit {exit}; the shortest was taken"
        yield Doubt.TABLE, message
    if control_of(signs) is JunctionControl.PARTIAL:
        bare = [f"e{i}" for i, sign in enumerate(signs) if sign is Sign.NONE]
        what = (
            f"entrances {', '.join(bare)} of junction {id!r} have no stop sign or light"
            if bare
            else f"the entrances of junction {id!r} mix stop signs and lights"
        )
        yield Doubt.SIGNAL, f"{what}, so its control is partial"

"""Analysis of a junction of a map file: arms, movements, priorities, control, and whether scenarios can run there."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

from pytest_rvads.geometry.arms import MOST, RoadArm, arms_of, sort_arms, turns_in_order, unusable, widest_gap
from pytest_rvads.geometry.conflicts import conflicts_of
from pytest_rvads.geometry.control import (
    JunctionControl,
    MapObject,
    ObjectKind,
    Sign,
    control_of,
    phase_groups,
    setback_of,
    sign_setback_of,
    signs_of,
)
from pytest_rvads.geometry.graph import MetricGraph, Path, Route, paths_of, walk
from pytest_rvads.geometry.network import Doubt, MapWarning, Network
from pytest_rvads.geometry.segment import GAP_LIMIT, join
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Key, Movement
from pytest_rvads.support.wording import plural

Pairs = frozenset[tuple[int, int]]


@dataclass(frozen=True, slots=True, eq=False)
class LaneEnd:
    """The end of a lane at a junction."""

    arm: int
    lane: int
    """Number of the lane on its arm, counted from the kerb."""
    edge: str


@dataclass(frozen=True, slots=True, eq=False)
class JunctionReport:
    """The analysis of a junction of a map file, also of a junction that scenarios can't use."""

    id: str
    arms: tuple[RoadArm, ...]
    """Arms, counter-clockwise."""
    entrances: tuple[LaneEnd, ...]
    """Entrances arm by arm, on each arm from the kerb; the number of an entrance is its index."""
    exits: tuple[LaneEnd, ...]
    """Exits, likewise."""
    movements: tuple[Route, ...]
    """Movements, sorted by entrance and exit."""
    signs: tuple[Sign, ...]
    reason: str | None
    """The reason why the junction cannot be used; None for a usable junction."""
    approach: tuple[float, ...]
    """Per entrance, length walked upstream to the previous junction or the end of the road [m]."""
    right_of: Pairs
    """Pairs of arms of which the first is to the right of the second (paper, table of semantics)."""
    opposite: Pairs
    phase_groups: tuple[frozenset[int], ...]
    """Groups of entrances that have green together."""
    setbacks: tuple[float, ...]
    """Per entrance, distance of the stopping line before the vertex [m]; 0 without a line, negative for a line behind it."""
    sign_setbacks: tuple[float | None, ...]
    """Per entrance, distance of its stop sign before the vertex [m]; None without a stop sign away from the stopping line."""
    beyond: tuple[float | None, ...]
    """Per entrance, distance behind the vertex of a line that lies where ways have met [m]; None without such a line."""
    stated: frozenset[tuple[Key, Key]]
    """Pairs of movements of which, according to the file, the first gives way to the second."""
    joining: frozenset[tuple[Key, Key]]
    """Pairs of movements into one exit of which, according to the lanes and roads of the file, the first joins the second."""
    objects: tuple[MapObject, ...]
    left_hand: bool
    warnings: tuple[MapWarning, ...]
    """Doubts about the movements and priorities of a usable junction."""

    @property
    def ways(self) -> int:
        """Number of arms."""
        return len(self.arms)

    @property
    def control(self) -> JunctionControl:
        """Control of the junction as a whole."""
        return control_of(self.signs)

    @property
    def usable(self) -> bool:
        """Whether scenarios can run at the junction."""
        return self.reason is None

    @property
    def usable_from(self) -> float:
        """Greatest distance before the stopping line that vehicles can start from at every entrance [m]."""
        return min((length - back for length, back in zip(self.approach, self.setbacks, strict=True)), default=0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """A junction cut from the metric graph: the paths through the junction, and the road ends at its border."""

    id: str
    paths: tuple[Path, ...]
    pairs: tuple[tuple[str, str], ...]
    """Pairs (entrance edge, exit edge) of all ways through the junction."""
    arms: tuple[RoadArm, ...]
    """Arms, in no particular order."""
    left_out: tuple[str, ...] = ()
    """Messages about paths of the map file that are left out because two of their lanes do not meet."""


def cut(graph: MetricGraph, id: str) -> Cut:
    """Return the part of a metric graph that is junction `id`.

    A path with a gap above `GAP_LIMIT` between two lanes is left out if the junction keeps all its arms without the path.
    """
    paths, direct = paths_of(graph, id), graph.network.junctions[id].direct
    gaps = [widest_gap(graph, path) for path in paths]
    whole = [path for path, (gap, _) in zip(paths, gaps, strict=True) if gap <= GAP_LIMIT]
    pairs = (*((path.entrance, path.exit) for path in paths), *direct)
    arms = arms_of(graph, pairs)
    if len(whole) == len(paths):
        return Cut(id, tuple(paths), pairs, arms)
    whole_pairs = (*((path.entrance, path.exit) for path in whole), *direct)
    whole_arms = arms_of(graph, whole_pairs)
    if {(bool(a.entrances), a.ends) for a in whole_arms} != {(bool(a.entrances), a.ends) for a in arms}:
        return Cut(id, tuple(paths), pairs, arms)
    worst, (lane, next_lane) = max(gaps)
    message = (
        f"{len(paths) - len(whole)} of {len(paths)} movements of junction {id!r} are left out: lanes {lane} and {next_lane} are "
        f"linked but {worst:.2f} m apart"
    )
    return Cut(id, tuple(whole), whole_pairs, whole_arms, (message,))


def joints_of(cuts: Iterable[Cut]) -> frozenset[str]:
    """Return the ids of junctions that only join two roads: of two arms, one has several lanes in a direction, as for turns."""
    return frozenset(
        cut.id
        for cut in cuts
        if len(cut.arms) == 2 and any(len(lanes) > 1 for arm in cut.arms for lanes in (arm.entrances, arm.exits))
    )


def analyse(
    graph: MetricGraph, cut: Cut, objects: Sequence[MapObject], *, joints: frozenset[str], uturns: bool
) -> JunctionReport:
    """Analyse a junction of a map."""
    network, id, paths, pairs, arms = graph.network, cut.id, cut.paths, cut.pairs, cut.arms

    def turning(order: Sequence[RoadArm]) -> list[tuple[int, int, float]]:
        entering = {edge: i for i, arm in enumerate(order) for edge in arm.entrances}
        leaving = {edge: i for i, arm in enumerate(order) for edge in arm.exits}
        return [(entering[p.entrance], leaving[p.exit], p.turning) for p in paths]

    arms = sort_arms(arms, lambda order: turns_in_order(turning(order), len(order)))
    # A lane that leads only to the arm it comes from has no movement without U-turns, and is no entrance if other lanes are.
    onward = {p.entrance for p in paths for arm in arms if p.entrance in arm.entrances and (uturns or p.exit not in arm.exits)}
    idle = {path.entrance for path in paths} - onward if onward else set()
    arms = tuple(replace(arm, entrances=tuple(lane for lane in arm.entrances if lane not in idle)) for arm in arms)
    entrances, exits = (
        tuple(LaneEnd(arm, lane, edge) for arm, edges in enumerate(lanes) for lane, edge in enumerate(edges))
        for lanes in ([arm.entrances for arm in arms], [arm.exits for arm in arms])
    )
    numbers = {end.edge: k for k, end in enumerate(entrances)}, {end.edge: k for k, end in enumerate(exits)}
    ways = [
        Route(numbers[0][path.entrance], numbers[1][path.exit], Turn.of(path.turning), path.length, path.turning, path)
        for path in paths
        if path.entrance not in idle
    ]
    ways.sort(key=lambda way: (way.entrance, way.exit, way.length, way.path.edges))
    movements = [way for way in ways if uturns or entrances[way.entrance].arm != exits[way.exit].arm]
    left_hand = any(road in network.left_hand for arm in arms for road, _ in arm.ends)
    objects_of_entrances = [[item for item in objects if item.edge == end.edge] for end in entrances]
    signs = signs_of([{item.kind for item in items} for items in objects_of_entrances])
    # A junction with more arms than the model allows can have thousands of turns, whose priorities mean nothing.
    turns = turns_of_arms(arms, entrances, exits, ways) if len(arms) <= MOST else {}
    opposite, right_of = opposite_pairs(turns), right_of_pairs(turns, left_hand=left_hand)
    reason = unusable(graph, id, arms, movements, pairs)
    setbacks = list(map(setback_of, objects_of_entrances))
    beyond = _beyond(graph, movements, setbacks) if reason is None else (None,) * len(entrances)
    warnings = []
    if reason is None:
        warnings = [MapWarning(Doubt.GAP, message, None, id) for message in cut.left_out]
        if len(movements) < len(paths):
            count = len(paths) - len(movements)
            message = f"{plural(count, 'U-turn')} of junction {id!r} {'is' if count == 1 else 'are'} left out"
            if idle:
                message += f", and no traffic enters by {plural(len(idle), 'lane')} without another way, {min(idle)} first"
            warnings.append(MapWarning(Doubt.TABLE, message, None, id))
        if far := [place for place in beyond if place is not None]:
            message = (
                f"{plural(len(far), 'stop line')} of junction {id!r} {'lies' if len(far) == 1 else 'lie'} up to {max(far):.1f} m "
                "behind the end of the lane, where ways have met; the end of the lane is taken for the line, and a violation "
                "that depends on it is UNSURE"
            )
            warnings.append(MapWarning(Doubt.SIGNAL, message, None, id))
        doubts = _doubts(id, movements, entrances, exits, signs, right_of)
        warnings += [MapWarning(kind, message, None, id) for kind, message in doubts]
    walks = [walk(graph, end.edge, upstream=True, joints=joints) for end in entrances]
    return JunctionReport(
        id=id,
        arms=arms,
        entrances=entrances,
        exits=exits,
        movements=tuple(movements),
        signs=signs,
        reason=reason,
        approach=tuple(math.fsum(graph.edges[edge].length for edge in edges) for edges in walks),
        right_of=right_of,
        opposite=opposite,
        phase_groups=_phases(network, entrances, opposite, objects_of_entrances, movements, left_hand=left_hand),
        setbacks=tuple(0.0 if place else back for back, place in zip(setbacks, beyond, strict=True)),
        beyond=beyond,
        sign_setbacks=tuple(map(sign_setback_of, objects_of_entrances)),
        stated=_stated(graph, id, movements),
        joining=_joining(graph, movements),
        objects=tuple(objects),
        left_hand=left_hand,
        warnings=tuple(warnings),
    )


def lifted(pairs: Pairs, entrances: Sequence[LaneEnd]) -> Pairs:
    """Return pairs of arms as the pairs of the entrances on these arms."""
    table: dict[int, list[int]] = {}
    for number, end in enumerate(entrances):
        table.setdefault(end.arm, []).append(number)
    return frozenset((a, b) for arm, other_arm in pairs for a in table.get(arm, ()) for b in table.get(other_arm, ()))


def turns_of_arms(
    arms: Sequence[RoadArm], entrances: Sequence[LaneEnd], exits: Sequence[LaneEnd], ways: Sequence[Route]
) -> dict[tuple[int, int], Turn]:
    """Return the turn from every arm to every other arm, by a movement or, without one, by the directions of the two arms."""
    turns: dict[tuple[int, int], Turn] = {}
    for way in ways:
        turns.setdefault((entrances[way.entrance].arm, exits[way.exit].arm), way.turn)
    for (arm_number, arm), (other_number, other_arm) in permutations(enumerate(arms), 2):
        if (arm_number, other_number) not in turns:
            turns[arm_number, other_number] = Turn.of(math.remainder(other_arm.outward - arm.outward - math.pi, math.tau))
    return turns


def right_of_pairs(turns: dict[tuple[int, int], Turn], *, left_hand: bool) -> Pairs:
    """Return the pairs ``v1 right-of v2`` (paper, table of semantics), mirrored where traffic keeps left.

    A right movement from v1 and a straight movement from v2 share an exit, or a straight one from v1 and a left one from v2.
    """
    near, far = (Turn.LEFT, Turn.RIGHT) if left_hand else (Turn.RIGHT, Turn.LEFT)
    right_of_turns = {(near, Turn.STRAIGHT), (Turn.STRAIGHT, far)}
    return frozenset(
        (v1, v2)
        for (v1, exit1), turn1 in turns.items()
        for (v2, exit2), turn2 in turns.items()
        if exit1 == exit2 and v1 != v2 and (turn1, turn2) in right_of_turns
    )


def opposite_pairs(turns: dict[tuple[int, int], Turn]) -> Pairs:
    """Return the pairs of arms with straight movements from each arm to the other (paper, table of semantics)."""
    return frozenset(
        (a, b) for (a, b), turn in turns.items() if a != b and turn is Turn.STRAIGHT and turns.get((b, a)) is Turn.STRAIGHT
    )


def _beyond(graph: MetricGraph, ways: Sequence[Route], setbacks: Sequence[float]) -> tuple[float | None, ...]:
    """Return, per entrance, how far behind the vertex its line lies [m], if vehicles can't wait there because ways have met."""
    if min(setbacks, default=0.0) >= 0.0:
        return (None,) * len(setbacks)
    lines = {(way.entrance, way.exit): join([graph.segment(edge) for edge in way.path.edges]) for way in reversed(ways)}
    movements = {key: Movement(*key, Turn.STRAIGHT, 0.0, "", line) for key, line in lines.items()}
    free = dict.fromkeys(range(len(setbacks)), math.inf)
    for way in ways:
        free[way.entrance] = min(free[way.entrance], way.length - GAP_LIMIT)
    for ((entrance, _), _), shared in (conflicts_of(movements, movements, {}) or {}).items():
        free[entrance] = min(free[entrance], shared.mine.start)
    return tuple(-back if -back > max(free[entrance], 0.0) else None for entrance, back in enumerate(setbacks))


def _phases(
    network: Network,
    entrances: Sequence[LaneEnd],
    opposite: Pairs,
    objects: Sequence[Sequence[MapObject]],
    ways: Sequence[Route],
    *,
    left_hand: bool,
) -> tuple[frozenset[int], ...]:
    """Return the groups of entrances with lights that have green together."""
    # Entrances that allow only the turn across oncoming traffic, and whose lights all have an arrow for this turn.
    across = {Turn.RIGHT if left_hand else Turn.LEFT}
    protected = set()
    for number, items in enumerate(objects):
        shown = {item.arrows for item in items if item.kind is ObjectKind.LIGHT}
        if shown == {frozenset(across)} and {way.turn for way in ways if way.entrance == number} == across:
            protected.add(number)
    signs = signs_of([{item.kind for item in items} for items in objects])
    lit = [number for number, sign in enumerate(signs) if sign is Sign.LIGHTS]
    lights: dict[str, set[int]] = {}
    for k, number in enumerate(lit):
        for item in objects[number]:
            if item.kind is ObjectKind.LIGHT:
                lights.setdefault(item.id, set()).add(k)
    controllers = [frozenset(e for signal in signals for e in lights.get(signal, ())) for signals in network.controllers]
    facing = lifted(opposite, [entrances[number] for number in lit])
    arrows = {k for k, number in enumerate(lit) if number in protected and any(k == entrance for entrance, _ in facing)}
    groups = phase_groups([entrances[number].arm for number in lit], facing, controllers, arrows)
    return tuple(frozenset(lit[k] for k in group) for group in groups)


def _stated(graph: MetricGraph, id: str, ways: Sequence[Route]) -> frozenset[tuple[Key, Key]]:
    """Return the pairs of movements of which, by the priorities of roads in the file, the first gives way to the second."""
    by_road: dict[str, dict[Key, None]] = {}
    for way in ways:
        for edge in (way.path.entrance, *way.path.edges):
            by_road.setdefault(graph.edges[edge].road, {})[way.entrance, way.exit] = None
    pairs = {
        (yielding, prior)
        for high, low in dict.fromkeys(graph.network.junctions[id].priorities)
        for yielding in by_road.get(low, ())
        for prior in by_road.get(high, ())
        if yielding[0] != prior[0]
    }
    return frozenset(pairs - {(b, a) for a, b in pairs})


def _joining(graph: MetricGraph, ways: Sequence[Route]) -> frozenset[tuple[Key, Key]]:
    """Return the pairs of movements into one exit of which the first joins the second, see `Junction.joining`."""

    def rank(way: Route) -> tuple[bool, bool]:
        edges = [graph.edges[edge] for edge in (way.path.entrance, *way.path.edges)]
        return not any(edge.joins for edge in edges), edges[0].road in graph.network.motorways

    # Of several routes between two lanes, the shortest comes first in `ways` and is kept.
    ranks = {(way.entrance, way.exit): rank(way) for way in reversed(ways)}
    return frozenset((a, b) for a, b in permutations(ranks, 2) if a[1] == b[1] and ranks[a] < ranks[b])


def _doubts(
    id: str,
    ways: Sequence[Route],
    entrances: Sequence[LaneEnd],
    exits: Sequence[LaneEnd],
    signs: Sequence[Sign],
    right_of: Pairs,
) -> Iterator[tuple[Doubt, str]]:
    arms = 1 + max(end.arm for end in (*entrances, *exits))
    if not turns_in_order(((entrances[w.entrance].arm, exits[w.exit].arm, w.turning) for w in ways), arms):
        yield Doubt.ORDER, f"the movements of junction {id!r}, sorted by turn, do not follow the order of its exits"
    if not right_of:
        message = f"no entrance of junction {id!r} is right-of another (a Y junction), so the priority rules say nothing"
        yield Doubt.RIGHT_OF, message
    count = Counter((way.entrance, way.exit) for way in ways)
    for entrance, exit in sorted(pair for pair in count if count[pair] > 1):
        message = f"junction {id!r} has several movements from entrance {entrance} to exit {exit}; the shortest was taken"
        yield Doubt.TABLE, message
    if control_of(signs) is JunctionControl.PARTIAL:
        bare = [str(i) for i, sign in enumerate(signs) if sign is Sign.NONE]
        mixed = f"the entrances of junction {id!r} mix signs and lights"
        fault = f"entrances {', '.join(bare)} of junction {id!r} have no sign or light" if bare else mixed
        yield Doubt.SIGNAL, f"{fault}, so its control is partial"

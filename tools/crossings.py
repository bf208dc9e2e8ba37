"""Writing junctions as OpenDRIVE 1.7: the built-in maps, and variants of the built-in maps for tests and experiments.

The arms are straight and meet in one centre. Every turning movement is an arc tangent to the two lanes that the movement joins. A
straight piece comes before or after the arc if the lanes lie at different distances from the centre. So the centre lines have
continuous headings and no gaps.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from pytest_rvads.geometry.control import JunctionControl, Sign, control_of, phase_groups
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.satellites.opendrive_writer import (
    Lane,
    Post,
    add,
    add_crosswalk,
    add_lanes,
    add_regulation,
    add_road,
    document,
    finished,
)
from pytest_rvads.support.errors import MapError

_STRAIGHT = 1e-9
_JUNCTION = "1"
_FACING = math.radians(10.0)
_ARROWS = {Turn.LEFT: 10, Turn.RIGHT: 20}
_BESIDE = 0.8
"""Distance from the kerb to a sign [m]."""
_BEHIND = 1.5
"""Distance from the middle of a stop line to the crosswalk behind it [m].

Between the edge of the line, which is 0.3 m wide, and the crosswalk lies more than 4 ft, 1.22 m (MUTCD 2009, 3B.16).
"""
_FLARE = 0.5
"""Length of a crosswalk on either side of the lanes [m]: the corners of a junction widen the roadway behind the stop line."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece of a reference line: straight, or an arc."""

    start: Pose
    length: float
    curvature: float = 0.0


@dataclass(frozen=True, slots=True)
class Layout:
    """Shape and control of a junction.

    Raises:
        MapError: the numbers describe no junction.
    """

    ways: int = 4
    """Number of arms, 3 to 8; 3 arms make a T with its stem in the south, other numbers are evenly spaced from the south on."""
    control: JunctionControl = JunctionControl.STOP
    """Control of all arms, STOP, LIGHTS or NONE; with `signs`, the control that follows from `signs`."""
    stop: float = 15.0
    """Distance from the centre of the junction to the entrance and exit vertices [m]."""
    lane_offset: float = 1.75
    """Distance from the line that separates the directions of a road to the centre of the first lane [m]; more than half the lane
    width leaves a median."""
    lane_width: float = 3.5
    """Width of the lanes [m]."""
    approach: float = 120.0
    """Length of the arms [m]."""
    setback: float = 0.0
    """Distance of stop lines and signs before the entrance vertices [m]."""
    left_hand: bool = False
    """Whether traffic keeps left."""
    angles: tuple[float, ...] = ()
    """Directions of the arms, counter-clockwise from east, in ascending order [rad]; empty for the usual directions."""
    signs: tuple[Sign, ...] = ()
    """Control of each arm; empty if `control` holds for all arms."""
    lanes: tuple[tuple[tuple[int, ...], ...], ...] = ()
    """Per arm the lanes that lead in, from the kerb, each lane with its allowed directions; direction ``j`` leads to the ``j``-th
    arm after this arm, counter-clockwise. If empty, every arm has a lane that allows all directions. Several lanes that allow a
    direction lead into as many lanes of the target arm: the lanes at the kerb or, for a turn across oncoming traffic, the lanes
    at the centre. A lane that allows only this turn, beside other lanes, has a light with an arrow and its own green phase."""
    exits: tuple[int, ...] = ()
    """Per arm the number of lanes that lead out; if empty, one lane leads out on every arm."""
    shift: float = 0.0
    """Displacement of the line between the directions, to the side of the lanes that lead out [m]. Opposite lanes face each other
    if the displacement is half a lane and arms have one more lane in than out."""
    crosswalk: float = 0.0
    """Width of the crosswalk over every arm, 1.5 m behind the stop line [m]; 0 for a junction without crosswalks. If the junction
    has lights, pedestrians have lights, too."""

    def __post_init__(self) -> None:
        if not 3 <= self.ways <= 8:
            raise MapError(f"a junction has 3 to 8 ways, got {self.ways!r}")
        numbers = (self.stop, self.lane_offset, self.lane_width, self.approach, self.setback)
        finite = all(map(math.isfinite, (*numbers, self.shift, self.crosswalk)))
        if not finite or min(numbers[:4]) <= 0 or not 0 <= self.setback < self.approach or self.crosswalk < 0:
            raise MapError(f"lengths of a junction must be positive and the setback shorter than the approach, got {numbers}")
        if self.lane_offset < self.lane_width / 2:
            raise MapError(
                f"lanes of {self.lane_width:g} m at an offset of {self.lane_offset:g} m overlap, expected half the width or more"
            )
        for name in ("angles", "signs", "lanes", "exits"):
            values = getattr(self, name)
            if values and len(values) != self.ways:
                raise MapError(f"a junction of {self.ways} ways needs {self.ways} {name}, got {len(values)}")
        self._check_signs()
        self._check_lanes()

    def _check_signs(self) -> None:
        control = control_of(sign for sign, lanes in zip(self.regulation, self.entrances, strict=True) if lanes)
        if control is not self.control:
            cause = f"its signs make up {control}" if self.signs else "this control needs signs, one per arm"
            raise MapError(f"a junction was to be written with control {self.control}, but {cause}")

    def _check_lanes(self) -> None:
        for arm, lanes in enumerate(self.entrances):
            for lane, directions in enumerate(lanes):
                for j in directions:
                    if not 1 <= j < self.ways or self.leaving[(arm + j) % self.ways] < 1:
                        raise MapError(
                            f"lane {lane} of arm {arm} allows direction {j}, expected 1 to {self.ways - 1} "
                            "and a lane that leads out there"
                        )
        if not list(self.ways_through()):
            raise MapError("a junction needs a lane that leads in and allows a direction")

    @property
    def directions(self) -> tuple[float, ...]:
        """Directions of the arms from the centre [rad]."""
        if self.angles:
            return self.angles
        if self.ways == 3:
            return (-math.pi / 2, 0.0, math.pi)
        return tuple(-math.pi / 2 + math.tau * i / self.ways for i in range(self.ways))

    @property
    def regulation(self) -> tuple[Sign, ...]:
        """Control of each arm."""
        usual = {JunctionControl.STOP: Sign.STOP, JunctionControl.LIGHTS: Sign.LIGHTS}
        return self.signs or (usual.get(self.control, Sign.NONE),) * self.ways

    @property
    def leaving(self) -> tuple[int, ...]:
        """Per arm the number of lanes that lead out."""
        return self.exits or (1,) * self.ways

    @property
    def entrances(self) -> tuple[tuple[tuple[int, ...], ...], ...]:
        """Per arm the lanes that lead in, from the kerb, each lane with its allowed directions."""
        if self.lanes:
            return self.lanes
        arms, n = range(self.ways), self.ways
        return tuple((tuple(j for j in range(1, n) if self.leaving[(arm + j) % n]),) for arm in arms)

    @property
    def opposite(self) -> frozenset[tuple[int, int]]:
        """Pairs of arms that face each other."""
        turned = [
            (i, k, math.remainder(b - a - math.pi, math.tau))
            for i, a in enumerate(self.directions)
            for k, b in enumerate(self.directions)
        ]
        return frozenset((i, k) for i, k, off in turned if abs(off) < _FACING)

    @property
    def across(self) -> Turn:
        """The turn across oncoming traffic."""
        return Turn.RIGHT if self.left_hand else Turn.LEFT

    def turn(self, arm: int, direction: int) -> Turn:
        """Return the turn of a movement from an arm into a symbolic direction."""
        start, end = self.directions[arm], self.directions[(arm + direction) % self.ways]
        return Turn.of(math.remainder(end - start - math.pi, math.tau))

    def protected(self, arm: int, lane: int) -> bool:
        """Return whether a lane has a separate light for the turn across oncoming traffic."""
        lanes = self.entrances[arm]
        return len(lanes) > 1 and bool(lanes[lane]) and {self.turn(arm, j) for j in lanes[lane]} == {self.across}

    def ways_through(self) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
        """Yield the movements, each as arm and lane at its start and arm and lane at its end."""
        for arm, lanes in enumerate(self.entrances):
            for direction in range(1, self.ways):
                allowing = [lane for lane, directions in enumerate(lanes) if direction in directions]
                out = (arm + direction) % self.ways
                if len(allowing) > self.leaving[out]:
                    raise MapError(
                        f"{len(allowing)} lanes of arm {arm} lead to arm {out}, expected no more than the {self.leaving[out]} "
                        "that lead out there"
                    )
                skipped = self.leaving[out] - len(allowing) if self.turn(arm, direction) is self.across else 0
                for number, lane in enumerate(allowing):
                    yield (arm, lane), (out, number + skipped)


def opendrive(layout: Layout, name: str = "junction") -> str:
    """Return an OpenDRIVE document with one junction, as text.

    Args:
        layout: shape and control of the junction.
    """
    root = document(name, layout.stop + layout.approach)
    for arm in range(layout.ways):
        _arm(root, layout, arm)
    junction = Element("junction", {"id": _JUNCTION, "name": name})
    for entrance, exit in sorted(layout.ways_through(), key=lambda way: (way[0][0], way[1][0], way)):
        _movement(root, junction, layout, entrance, exit)
    _controllers(root, junction, layout)
    root.append(junction)
    return finished(root)


def _controllers(root: Element, junction: Element, layout: Layout) -> None:
    """Write a controller for every group of lights that have green together."""
    lit = [
        (arm, lane)
        for arm, lanes in enumerate(layout.entrances)
        for lane in range(len(lanes))
        if layout.regulation[arm] is Sign.LIGHTS
    ]
    facing = ((i, k) for i, (a, _) in enumerate(lit) for k, (b, _) in enumerate(lit) if (a, b) in layout.opposite)
    protected = [number for number, (arm, lane) in enumerate(lit) if layout.protected(arm, lane)]
    groups = phase_groups([arm for arm, _ in lit], frozenset(facing), protected=protected)
    # Pedestrians walk with the first group in which neither their arm nor the arm opposite has green.
    together = layout.opposite | {(arm, arm) for arm in range(layout.ways)}
    walks = {
        arm: next((k for k, group in enumerate(groups) if all((lit[p][0], arm) not in together for p in group)), None)
        for arm in range(layout.ways if layout.crosswalk else 0)
    }
    for number, group in enumerate(groups):
        controller = add(root, "controller", id=number, name=f"phase {number}", sequence=number)
        for place in sorted(group):
            add(controller, "control", signalId=_signal(layout, *lit[place]), type="vehicle")
        for light in [id for arm, walking in walks.items() if walking == number for id, _ in _pedestrian_lights(layout, arm)]:
            add(controller, "control", signalId=light, type="pedestrian")
        add(junction, "controller", id=number, type="vehicle", sequence=number)


def _pedestrian_lights(layout: Layout, arm: int) -> tuple[tuple[str, float], ...]:
    """Return the ids of the lights on both sides of the crosswalk of an arm, with their lateral positions [m]."""
    left, right = _kerbs(layout, arm)
    lights = (f"walk{arm}.left", left + _FLARE + _BESIDE), (f"walk{arm}.right", right - _FLARE - _BESIDE)
    return lights if layout.control is JunctionControl.LIGHTS else ()


def _kerbs(layout: Layout, arm: int) -> tuple[float, float]:
    """Return the lateral positions of the left and the right kerb of an arm, to the left of its reference line [m]."""
    ids = [_inbound(layout, arm, 0)] * bool(layout.entrances[arm]) + [_outbound(layout, arm, 0)] * bool(layout.leaving[arm])
    edges = [_aside(layout, id) + side * layout.lane_width / 2 for id in ids for side in (-1, 1)]
    return max(edges), min(edges)


def _signal(layout: Layout, arm: int, lane: int) -> int:
    return arm + layout.ways * lane


def _innermost(layout: Layout) -> int:
    """Return the number of the innermost driving lanes, counted from the centre: 2 beside a median, 1 without a median."""
    return 2 if layout.lane_offset > layout.lane_width / 2 + 1e-9 else 1


def _inbound(layout: Layout, arm: int, lane: int) -> int:
    """Return the id of a lane that leads in, from the number of the lane from the kerb."""
    number = _innermost(layout) + len(layout.entrances[arm]) - 1 - lane
    return -number if layout.left_hand else number


def _outbound(layout: Layout, arm: int, lane: int) -> int:
    """Return the id of a lane that leads out, from the number of the lane from the kerb."""
    number = _innermost(layout) + layout.leaving[arm] - 1 - lane
    return number if layout.left_hand else -number


def _aside(layout: Layout, lane: int) -> float:
    """Return the distance of the centre of a lane to the left of the axis of its arm, seen outward [m]."""
    across = layout.lane_offset + layout.lane_width * (abs(lane) - _innermost(layout))
    return math.copysign(across, lane) - (-layout.shift if layout.left_hand else layout.shift)


def _arm(root: Element, layout: Layout, arm: int) -> None:
    """Write an arm; its reference line runs outward from the entrance vertex."""
    angle = layout.directions[arm]
    road = add_road(root, arm, layout.approach, left_hand=layout.left_hand)
    add(road[0], "predecessor", elementType="junction", elementId=_JUNCTION)
    add_plan(road, [Piece(Pose(*_at(layout, angle, 0.0), angle), layout.approach)])
    median, counts = layout.lane_offset - layout.lane_width / 2, (len(layout.entrances[arm]), layout.leaving[arm])
    lanes = [Lane(0, mark="none" if _innermost(layout) > 1 else "centre" if all(counts) else "solid")]
    for side, count in zip((-1, 1) if layout.left_hand else (1, -1), counts, strict=True):
        if _innermost(layout) > 1:
            lanes.append(Lane(side, "median", median, "solid"))
        for number in range(count):
            mark = "broken" if number < count - 1 else "solid"
            lanes.append(Lane(side * (_innermost(layout) + number), "driving", layout.lane_width, mark))
    add_lanes(road, lanes, layout.shift if layout.left_hand else -layout.shift)
    if layout.regulation[arm] is not Sign.NONE and layout.entrances[arm]:
        _regulate(road, layout, arm)
    if layout.crosswalk:
        left, right = _kerbs(layout, arm)
        near = layout.setback - _BEHIND
        far = near - layout.crosswalk
        corners = [(near, right - _FLARE), (near, left + _FLARE), (far, left + _FLARE), (far, right - _FLARE)]
        add_crosswalk(road, f"crosswalk{arm}", corners, [(id, layout.setback, t) for id, t in _pedestrian_lights(layout, arm)])


def _regulate(road: Element, layout: Layout, arm: int) -> None:
    """Write the stopping line, and the sign or lights, of an arm, whose traffic enters against the reference line."""
    sign, count = layout.regulation[arm], len(layout.entrances[arm])
    ids = [_inbound(layout, arm, lane) for lane in range(count)]
    kerb, inner = _aside(layout, ids[0]), _aside(layout, ids[-1])
    beside = kerb + math.copysign(layout.lane_width / 2 + _BESIDE, ids[0])
    everywhere = Post(arm, sign, (ids[0], ids[-1]), layout.setback, beside)
    posts = [everywhere]
    if sign is Sign.LIGHTS:
        arrows = [_ARROWS[layout.across] if layout.protected(arm, lane) else None for lane in range(count)]
        posts = [
            Post(_signal(layout, arm, k), sign, (id, id), layout.setback, _aside(layout, id) if k else beside, arrows[k])
            for k, id in enumerate(ids)
        ]
    add_regulation(road, posts, [(everywhere, (kerb + inner) / 2, layout.lane_width * count)])


def _movement(root: Element, junction: Element, layout: Layout, entrance: tuple[int, int], exit: tuple[int, int]) -> None:
    """Write the connecting road of a movement; its reference line is the centre of its lane."""
    side = -1.0 if layout.left_hand else 1.0
    (arm, lane), (out, onto) = entrance, exit
    inbound, outbound = _inbound(layout, arm, lane), _outbound(layout, out, onto)
    angle, away = layout.directions[arm], layout.directions[out]
    if abs(abs(math.remainder(away - angle - math.pi, math.tau)) - math.pi) < 1e-6:
        raise MapError(f"arms {arm} and {out} of the junction point in the same direction")
    try:
        pieces = joined(
            Pose(*_at(layout, angle, _aside(layout, inbound)), angle + math.pi),
            Pose(*_at(layout, away, _aside(layout, outbound)), away),
        )
    except MapError:
        raise MapError(
            f"arms {arm} and {out} are too close together for a turn; move the stop lines out from {layout.stop:g} m"
        ) from None
    id = 100 + (lane * max(layout.leaving) + onto) * layout.ways**2 + arm * layout.ways + out
    road = add_road(root, id, math.fsum(piece.length for piece in pieces), junction=_JUNCTION, left_hand=layout.left_hand)
    for tag, number in (("predecessor", arm), ("successor", out)):
        add(road[0], tag, elementType="road", elementId=number, contactPoint="start")
    add_plan(road, pieces)
    only = 1 if layout.left_hand else -1
    add_lanes(road, [Lane(0), Lane(only, "driving", layout.lane_width, links=(inbound, outbound))], side * layout.lane_width / 2)
    row = add(junction, "connection", id=id, incomingRoad=arm, connectingRoad=id, contactPoint="start")
    add(row, "laneLink", **{"from": inbound}, to=only)


def _at(layout: Layout, angle: float, aside: float) -> tuple[float, float]:
    """Return the point `aside` to the left of the axis at the vertex of the arm in direction `angle`, seen outward."""
    x, y = layout.stop, aside
    return x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)


def add_plan(road: Element, pieces: Iterable[Piece]) -> None:
    """Add the reference line of a road, piece by piece."""
    plan, s = add(road, "planView"), 0.0
    for piece in pieces:
        start = piece.start
        geometry = add(plan, "geometry", s=s, x=start.x, y=start.y, hdg=start.heading, length=piece.length)
        add(geometry, "arc", curvature=piece.curvature) if piece.curvature else add(geometry, "line")
        s += piece.length


def joined(start: Pose, end: Pose) -> tuple[Piece, ...]:
    """Return the pieces of a smooth line between two poses: a straight line, an arc with a straight part, or two arcs."""
    turn = math.remainder(end.heading - start.heading, math.tau)
    dx, dy = end.x - start.x, end.y - start.y
    ux, uy = math.cos(start.heading), math.sin(start.heading)
    if abs(turn) < _STRAIGHT:
        return _beside(start, dx * ux + dy * uy, dy * ux - dx * uy)
    vx, vy = math.cos(end.heading), math.sin(end.heading)
    # The distances from the start to the meeting point of the two tangents, and from the meeting point to the end.
    before, after = (dx * vy - dy * vx) / math.sin(turn), (ux * dy - uy * dx) / math.sin(turn)
    tangent = min(before, after)
    if tangent <= 0:
        raise MapError(f"no arc leads from ({start.x:g}, {start.y:g}) to ({end.x:g}, {end.y:g}) without bending back")
    lines = [length - tangent if length - tangent > _STRAIGHT else 0.0 for length in (before, after)]
    first = Pose(start.x + lines[0] * ux, start.y + lines[0] * uy, start.heading)
    last = Pose(end.x - lines[1] * vx, end.y - lines[1] * vy, end.heading)
    curvature = 2 * math.sin(turn / 2) / math.hypot(last.x - first.x, last.y - first.y)
    pieces = (Piece(start, lines[0]), Piece(first, turn / curvature, curvature), Piece(last, lines[1]))
    return tuple(piece for piece in pieces if piece.length)


def _beside(start: Pose, ahead: float, aside: float) -> tuple[Piece, ...]:
    """Return the pieces of a line to a pose of the same heading: straight, or two arcs if the pose lies to the side."""
    if ahead <= 0:
        raise MapError(f"no way leads from ({start.x:g}, {start.y:g}) to a place {-ahead:g} m behind it")
    if abs(aside) < _STRAIGHT:
        return (Piece(start, math.hypot(ahead, aside)),)
    swing = 2 * math.atan2(aside, ahead)
    curvature = 2 * math.sin(swing) / ahead
    x, y, heading = start
    middle = Pose(
        x + (ahead * math.cos(heading) - aside * math.sin(heading)) / 2,
        y + (ahead * math.sin(heading) + aside * math.cos(heading)) / 2,
        heading + swing,
    )
    return Piece(start, swing / curvature, curvature), Piece(middle, swing / curvature, -curvature)

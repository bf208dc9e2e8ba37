"""Verdicts of the rules of crosswalks against a second evaluator, on random motions of a vehicle and two pedestrians.

The evaluator knows the poses of bodies and the layout of lanes, and neither stations nor stretches of the junction. It measures
the places where the two meet by distances between points, and goes from state to state. The package samples lines every 0.1 m
(painted areas) and every 0.5 m (lanes). So the evaluator judges a motion for the limits of what such sampling can yield. If all
limits give one status, the package must give this status. For at most a fifth of the pedestrians, the sampling decides.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import Crossing, Side
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import InstanceVerdict
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour

from ..strollers import stroll
from ..zebras import zebra

Make = Callable[..., Run]
Floats = NDArray[np.float64]
PLACES = (zebra("right4").walked, zebra("stop4").walked, zebra("yield4").walked, zebra("light4", lit=True).walked)
STEPS, DT, STILL, LENGTH, WIDTH, BODY = 1200, 0.01, 0.1, 4.6, 1.86, 0.6
MEET = (2.6 + 0.6) / 2
"""The ways of a vehicle and of a pedestrian meet where they are nearer than half of the sum of their widths [m]."""
LANE, BEHIND, DEEP = 3.5, 1.2, 3.0
"""Width of a lane, distance of the crosswalk behind the entrance vertex, and its width in the direction of the road [m]."""
LATE = 4
"""Ticks in which a vehicle with 1 m/s drives the distance between two points of the evaluator, twice [0.01 s]."""
COMES, CLOSE, SOON, NOTICES, BRAKES = 3.0, 5.0, 4.0, 1.0, 3.4


def motion(drive: Make, seed: int) -> Run:
    """Return a run of a vehicle and two pedestrians, mostly on crosswalks on its way, who may stop and turn back."""
    rng = np.random.default_rng(seed)
    place = PLACES[seed % len(PLACES)]
    entrance, direction = int(rng.integers(4)), int(rng.integers(1, 4))
    fast = float(rng.choice([1.0, 3.0, 6.0]))
    changes = np.sort(rng.integers(50, STEPS, rng.integers(0, 4))).tolist()
    speeds = [(0, fast), *((tick, float(rng.choice([0.0, 1.0, fast]))) for tick in changes)]
    lights = {
        k: [(0, Colour(int(rng.integers(1, 4)))), (int(rng.integers(STEPS)), Colour.YELLOW)] for k in range(len(place.starts))
    }
    lit = lights if place.control == "lights" else None
    run = drive(place, {entrance: (direction, float(rng.uniform(-15.0, 5.0)), speeds)}, STEPS, lit)
    arms = entrance, (entrance + direction) % 4
    for number in range(2):
        pace = float(rng.choice([0.8, 1.2, 1.4, 2.5]))
        changes = np.sort(rng.integers(0, STEPS, rng.integers(0, 3))).tolist()
        paces = [(0, pace), *((tick, float(rng.choice([0.0, pace, -pace]))) for tick in changes)]
        arm = int(rng.choice([*arms, *arms, *arms, int(rng.integers(4))]))
        start = float(rng.uniform(-8.0, 4.0))
        run = stroll(run, arm, Side.NEAR if rng.random() < 0.5 else Side.FAR, start, paces, f"p{number}")
    return run


class Car(NamedTuple):
    """How far a vehicle has come on its path, and how fast it is."""

    front: Floats
    speed: Floats


class Walker(NamedTuple):
    """How far a pedestrian has come from its kerb, how fast it is, and whether it stepped onto the road on green."""

    front: Floats
    pace: Floats
    lawful: NDArray[np.bool_]


@dataclass(frozen=True)
class Layout:
    """Where a vehicle and a pedestrian meet, with an entry per choice of the places that sampling can yield."""

    begin: Floats
    """How far along its path the vehicle comes onto the painted area."""
    near: Floats
    """How far along its path the vehicle comes near the line of the pedestrian."""
    far: Floats
    lane: Floats
    """How far from its kerb the pedestrian comes near the path of the vehicle."""
    lane_end: Floats
    half: tuple[float, float]
    """The half of the roadway on which the vehicle drives, in distances from the kerb of the pedestrian."""
    wide: float


@cache
def path_of(place: Junction, key: Key) -> Floats:
    """Return points along the way of a vehicle, every 0.02 m."""
    way = itinerary(place, *key)
    return np.array([way.pose(s)[:2] for s in np.arange(-min(30.0, way.origin), way.length + min(30.0, way.end), 0.02)])


def inside(points: Floats, corners: Floats) -> NDArray[np.bool_]:
    """Return whether points are inside a convex polygon: on the same side of all of its edges."""
    edges, apart = np.roll(corners, -1, axis=0) - corners, points[:, None] - corners[None]
    turns = edges[None, :, 0] * apart[..., 1] - edges[None, :, 1] * apart[..., 0]
    return np.asarray((turns > 0.0).all(axis=1) | (turns < 0.0).all(axis=1))


def lengths(points: Floats) -> Floats:
    """Return how far each point is from the first point, along the polyline."""
    return np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))


@cache
def layout_of(place: Junction, key: Key, arm: int, side: Side) -> tuple[Layout, Floats] | None:
    """Return where a vehicle meets a pedestrian, with the kerb and direction of the pedestrian; None if they can't meet."""
    path = path_of(place, key)
    (entrance,), (exit,) = place.arms[arm]
    (x, y, heading), (u, v, _) = place.way_in(entrance).pose(place.way_in(entrance).length), place.way_out(exit).pose(0.0)
    ahead, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    apart = float(np.dot((u - x, v - y), left))
    wide = apart + LANE
    kerb = np.array([x, y]) + (BEHIND + DEEP / 2) * ahead - LANE / 2 * left
    if side is Side.FAR:
        kerb, left = kerb + wide * left, -left
    over = np.arange(0.0, wide, 0.02)
    line = kerb + over[:, None] * left
    close = np.hypot(*(path[:, None] - line[None]).transpose(2, 0, 1)) < MEET
    if not close.any():
        return None
    along = lengths(path)
    corners = np.array([kerb + side * DEEP / 2 * ahead + far * left for side, far in ((-1, 0), (1, 0), (1, wide), (-1, wide))])
    onto = along[np.flatnonzero(inside(path, corners))[0]]
    mine, yours = along[close.any(axis=1)], over[close.any(axis=0)]
    choices = np.array(list(product((0.0, 0.12), (0.0, 0.52), (0.0, 0.52), (0.0, 0.52), (0.0, 0.52)))).T
    near_half = (arm == place.entrances[key[0]].arm) == (side is Side.NEAR)
    half = (0.0, wide / 2) if near_half else (wide / 2, wide)
    begin, near, lane = (edge + more for edge, more in zip((onto, mine[0], yours[0]), choices[:3], strict=True))
    layout = Layout(begin, near, mine[-1] - choices[3], lane, yours[-1] - choices[4], half, wide)
    return layout, np.array([kerb, left])


def judged(layout: Layout, car: Car, walker: Walker) -> list[tuple[str, int | None, str]]:
    """Return, per choice of places, the status, the tick of the violation, and which of the two is to blame."""
    count = len(layout.begin)
    asked, came, claimed = (np.zeros(count, dtype=bool) for _ in range(3))
    failed, since, began = np.full(count, -1), np.zeros(count, dtype=int), np.zeros(count, dtype=int)
    last, stood = np.nan, False
    moves_of = (values.tolist() for values in (car.front, car.speed, walker.front, walker.pace))
    for tick, (place, speed, front, pace) in enumerate(zip(*moves_of, strict=True)):
        back, moves, returns = front - BODY, abs(pace) > STILL, pace < -STILL
        road = front > 0.0 and back < layout.wide
        past = front < layout.lane if returns else back > layout.lane_end
        to_lane = back - layout.lane_end if returns else layout.lane - front
        on_half = front > layout.half[0] and back < layout.half[1]
        there = road & ~past
        claims = there & (on_half or moves)
        owed = there & (on_half | (moves & (to_lane <= COMES * abs(pace))))
        since = np.where(claims & ~claimed, tick, since)
        claimed = claims
        goes = (last < layout.begin) & (place >= layout.begin)
        goes |= (stood and speed > STILL) & (place >= layout.begin) & (place < layout.far)
        came = np.where(goes, claims, came)
        in_lane = road & (front >= layout.lane) & (back <= layout.lane_end)
        takes = goes | (came & in_lane & (place >= layout.near) & (place - LENGTH <= layout.far))
        close = (layout.begin - place <= max(CLOSE, SOON * speed)) & (place < layout.far)
        premise = owed & (close | takes) & bool(walker.lawful[tick])
        asked |= premise
        now = premise & takes & (failed < 0)
        failed, began = np.where(now, tick, failed), np.where(now, since, began)
        last, stood = place, speed <= STILL
    found: list[tuple[str, int | None, str]] = []
    for k in range(count):
        if failed[k] < 0:
            found.append(("PASS" if asked[k] and (car.speed > STILL).any() else "NA", None, ""))
        else:
            guilty = "a" if stops(car, float(layout.begin[k]), int(began[k]), int(failed[k])) else "p"
            found.append(("FAIL", int(failed[k]), guilty))
    return found


def stops(car: Car, place: float, since: int, until: int) -> bool:
    """Return whether a driver who notices a pedestrian late and then brakes stops before a place, or stood there anyway."""
    if any(car.speed[t] <= STILL and car.front[t] < place for t in range(since, until + 1)):
        return True
    noticed = since + round(NOTICES / DT)
    if noticed >= until:
        return False
    at, speed = float(car.front[noticed]), float(car.speed[noticed])
    while speed > 0.0:
        at, speed = at + speed * 1e-3 - BRAKES * 5e-7, speed - BRAKES * 1e-3
    return at < place


def contact(run: Run, column: int) -> int | None:
    """Return the first tick in which the circle of a pedestrian reaches into the rectangle of the vehicle."""
    pose = run.need("pose")
    for tick in range(run.steps):
        (x, y, heading), (u, v, facing) = pose[tick, 0], pose[tick, column]
        ahead, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
        middle = np.array([u, v]) - BODY / 2 * np.array([np.cos(facing), np.sin(facing)])
        if np.hypot(*(middle - (x, y))) > LENGTH + WIDTH:
            continue
        corners = [
            np.array([x, y]) - back * ahead + side * WIDTH / 2 * left
            for back, side in ((0, 1), (LENGTH, 1), (LENGTH, -1), (0, -1))
        ]
        distances = []
        for one, two in zip(corners, [*corners[1:], corners[0]], strict=True):
            share = float(np.clip(np.dot(middle - one, two - one) / np.dot(two - one, two - one), 0.0, 1.0))
            distances.append(float(np.hypot(*(middle - one - share * (two - one)))))
        if min(distances) < BODY / 2 or inside(middle[None], np.array(corners))[0]:
            return tick
    return None


def instance(run: Run, rule: str, name: str) -> InstanceVerdict | None:
    found = [i for i in check(run, rule).instances if {"a0", "a1", "a2", "a3", name} >= {who for _, who in i.binding} >= {name}]
    return found[0] if found else None


def compared(drive: Make, seed: int) -> tuple[int, int]:
    """Compare the verdicts on a motion, and return for how many pedestrians places mattered not, and for how many they did."""
    run = motion(drive, seed)
    lit = run.junction.control == "lights"
    rule, path = "crosswalk_turning" if lit else "crosswalk", path_of(run.junction, run.agents[0].way.key)
    pose = run.need("pose")
    first = int(np.argmin(np.hypot(*(path - pose[0, 0, :2]).T)))
    car = Car(lengths(path)[first] + lengths(pose[:, 0, :2]), run.need("speed")[:, 0])
    sure = unsure = 0
    for column in (1, 2):
        name = run.agents[column].name
        touch = instance(run, "no_collision", name)
        assert touch is not None
        assert (touch.failed, str(touch.status)) == ((tick := contact(run, column)), "PASS" if tick is None else "FAIL"), (
            seed,
            name,
        )
        crossing = run.agents[column].way
        assert isinstance(crossing, Crossing)
        meeting = layout_of(run.junction, run.agents[0].way.key, crossing.crosswalk, crossing.side)
        told = instance(run, rule, name)
        if meeting is None or (lit and run.agents[0].turn == "straight"):
            assert told is None, (seed, name)
            continue
        layout, (kerb, over) = meeting
        walked = (pose[:, column, :2] - kerb) @ over
        stepped = np.flatnonzero(walked > 0.0)
        lawful = np.ones(run.steps, dtype=bool)
        if lit:
            green = len(stepped) and run.lights[stepped[0], run.agents[column].entrance] == Colour.GREEN
            lawful = np.arange(run.steps) >= stepped[0] if green else np.zeros(run.steps, dtype=bool)
        verdicts = judged(layout, car, Walker(walked, np.append(np.diff(walked), walked[-1] - walked[-2]) / DT, lawful))
        assert told is not None, (seed, name)
        statuses = {status for status, _, _ in verdicts}
        assert len(statuses) > 1 or {str(told.status)} == statuses, (seed, name)
        ticks = [tick for _, tick, _ in verdicts if tick is not None]
        if statuses == {"FAIL"}:
            assert told.failed is not None
            assert min(ticks) - LATE <= told.failed <= max(ticks) + LATE, (seed, name)
            if run.junction.name in ("right4", "yield4"):  # without stop signs and lights, which the vehicle may pass
                assert told.responsible[0][0] in {guilty for _, _, guilty in verdicts}, (seed, name)
        one = len(statuses) == 1
        sure, unsure = sure + one, unsure + (not one)
    return sure, unsure


@pytest.mark.parametrize(
    "seeds",
    [
        range(3),
        pytest.param(range(100, 200), marks=pytest.mark.extended),
        pytest.param(range(1000, 3000), marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_second_evaluator_gives_the_same_verdicts(drive: Make, seeds: range) -> None:
    sure, unsure = np.sum([compared(drive, seed) for seed in seeds], axis=0)
    assert unsure <= 0.2 * (sure + unsure)

"""Who broke which rule in traffic of SUMO, counted from the texts of the rules alone, in plain Python.

Nothing of the package is used here: where a vehicle is comes from the lane that SUMO says it is on, lights from SUMO's own
protocol, and every rule is one loop over hundredths of a second.
"""

import math
from collections.abc import Callable, Iterator
from itertools import combinations, permutations

from .traffic import SIZES, Traffic, Vehicle

Found = set[tuple[str, ...]]
APPROACH, ENTRANCE, JUNCTION, EXIT = "approach", "entrance", "junction", "exit"
TIE = 50
"""Ticks; who arrives within half a second of each other has arrived at about the same time."""


class Ride:
    """One vehicle, tick by tick; ticks are hundredths of a second since the recording began."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle, self.name = vehicle, vehicle.name
        self.begin = round(float(vehicle.rows[0, 0]) * 100)
        self.rows = vehicle.rows.tolist()
        self.end = self.begin + len(self.rows)
        self.zones = [
            EXIT if p != p else JUNCTION if p > 0 else ENTRANCE if p >= -1 else APPROACH for p in vehicle.place.tolist()
        ]
        self.waited, waited = [], 0
        for tick, zone in enumerate(self.zones):
            waited = waited + 1 if zone == ENTRANCE and tick else 0
            self.waited.append(waited)

    def zone(self, tick: int) -> str:
        return self.zones[tick - self.begin] if self.begin <= tick < self.end else "absent"

    def first(self, zone: str) -> float:
        """Return the first tick in a zone, infinity if there is none."""
        return self.begin + self.zones.index(zone) if zone in self.zones else math.inf

    def ticks(self, zone: str) -> range:
        """Return the ticks in a zone: every vehicle goes through each once, without a break."""
        first = self.first(zone)
        return range(0) if math.isinf(first) else range(int(first), int(first) + self.zones.count(zone))


def rides(traffic: Traffic) -> list[Ride]:
    return [Ride(vehicle) for vehicle in traffic.vehicles]


def both(one: Ride, two: Ride, zone: str) -> range:
    """Return the ticks in which two vehicles are in a zone."""
    first, second = one.ticks(zone), two.ticks(zone)
    return range(max(first.start, second.start), min(first.stop, second.stop))


def p1(traffic: Traffic) -> Found:
    """No two vehicles in the junction."""
    return {pair(one, two) for one, two in combinations(rides(traffic), 2) if both(one, two, JUNCTION)}


def p3(traffic: Traffic) -> Found:
    """Of two at entrances, who has waited shorter enters after the other one."""
    return in_order(traffic, 0)


def first_come(traffic: Traffic) -> Found:
    """The same where it has waited clearly shorter, comes from another arm, and their ways cross or join."""
    ways = {vehicle.name: (vehicle.origin, vehicle.goal) for vehicle in traffic.vehicles}
    return {found for found in in_order(traffic, TIE) if meet(*(ways[name] for name in found))}


def meet(one: tuple[str, str], two: tuple[str, str]) -> bool:
    """Return whether the ways from arm to arm of two vehicles from different arms cross or join.

    Counter-clockwise around the junction each arm has its exit, then its entrance: ways cross where these points alternate.
    """
    if one[0] == two[0] or one[1] == two[1]:
        return one[0] != two[0]
    (a, b), (c, d) = ((2 * "NWSE".index(origin) + 1, 2 * "NWSE".index(goal)) for origin, goal in (one, two))
    low, high = sorted((a, b))
    return (low < c < high) != (low < d < high)


def in_order(traffic: Traffic, tie: int) -> Found:
    found: Found = set()
    for late, early in permutations(rides(traffic), 2):
        for tick in both(late, early, ENTRANCE):
            if early.waited[tick - early.begin] - late.waited[tick - late.begin] > tie:
                left = late.ticks(ENTRANCE).stop
                # It has to stay up to the step in which the other one enters, that one included; nothing is owed to who is not
                # there any more, or by who is not.
                if left < min(late.end, early.end) and left <= early.first(JUNCTION):
                    found.add((late.name, early.name))
                break
    return found


def red(traffic: Traffic) -> Found:
    """Who stands at a red light and does not turn right waits for green."""
    found: Found = set()
    for ride in rides(traffic):
        colours = colours_of(traffic, ride.vehicle.origin)
        right = "ESWN".index(ride.vehicle.goal) == ("ESWN".index(ride.vehicle.origin) - 1) % 4
        at = ride.ticks(ENTRANCE)
        faced = [colours(tick) for tick in (*at, at.stop)]
        reds = [k for k, colour in enumerate(faced[:-1]) if colour == "RED"]
        if not right and at.stop < ride.end and reds and "GREEN" not in faced[reds[-1] :]:
            found.add((ride.name,))
    return found


def colours_of(traffic: Traffic, arm: str) -> Callable[[int], str]:
    """Return a function from a tick to the colour at an arm."""
    changes = [(round(time * 100), colour.name) for time, side, colour in traffic.lights if side == arm]

    def colour(tick: int) -> str:
        return [name for since, name in changes if since <= tick][-1]

    return colour


def full_stop(traffic: Traffic) -> Found:
    """Who enters past a stop sign has stood still within five metres before it, with nobody ahead in its lane."""
    everybody = rides(traffic)
    found: Found = set()
    for ride in everybody:
        if traffic.kind == "yield" and ride.vehicle.origin in "EW":
            continue  # they have priority
        entered = ride.first(JUNCTION)
        ahead = [r for r in everybody if r.vehicle.origin == ride.vehicle.origin and r is not ride]
        stopped = False
        for place, row, tick in zip(ride.vehicle.place.tolist(), ride.rows, range(ride.begin, ride.end), strict=True):
            if -5.0 <= place <= 0.0 and abs(row[4]) <= 0.1:
                stopped = stopped or not any(before(r, tick) > place for r in ahead)
        if ride.ticks(ENTRANCE) and entered < math.inf and not stopped:
            found.add((ride.name,))
    return found


def before(ride: Ride, tick: int) -> float:
    """Return how far a vehicle is behind the end of its approach, minus infinity where it is not on it."""
    place = float(ride.vehicle.place[tick - ride.begin]) if ride.begin <= tick < ride.end else 1.0
    return place if place <= 0.0 else -math.inf


def no_collision(traffic: Traffic) -> Found:
    """No two bodies touch: no corner or edge of one is in the other."""
    found: Found = set()
    for one, two in combinations(rides(traffic), 2):
        tick, until = max(one.begin, two.begin), min(one.end, two.end)
        while tick < until:
            first, second = (r.rows[tick - r.begin] for r in (one, two))
            apart = math.hypot(first[1] - second[1], first[2] - second[2])
            if apart > 22.0:  # fronts this far apart, of bodies of ten metres: for so long they can't touch, at 20 m/s each
                tick += max(int((apart - 21.0) / 40.0 * 100), 1)
                continue
            if touch(box(one.vehicle, first), box(two.vehicle, second)):
                found.add(pair(one, two))
                break
            tick += 1
    return found


Points = list[tuple[float, float]]


def box(vehicle: Vehicle, row: list[float]) -> Points:
    """Return the corners of a body, in order around it."""
    length, width = SIZES[vehicle.kind]
    _, x, y, heading, _ = row
    cos, sin = math.cos(heading), math.sin(heading)
    corners = [(0, -width / 2), (0, width / 2), (-length, width / 2), (-length, -width / 2)]
    return [(x + a * cos - b * sin, y + a * sin + b * cos) for a, b in corners]


def touch(one: Points, two: Points) -> bool:
    """Return whether the edges of two boxes cross, or one lies in the other."""
    if any(cross(*first, *second) for first in edges(one) for second in edges(two)):
        return True
    return inside(one[0], two) or inside(two[0], one)


def edges(points: Points) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    return zip(points, [*points[1:], points[0]], strict=True)


def side(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def cross(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], d: tuple[float, float]) -> bool:
    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def inside(point: tuple[float, float], points: Points) -> bool:
    return all(side(a, b, point) > 0 for a, b in edges(points)) or all(side(a, b, point) < 0 for a, b in edges(points))


def pair(one: Ride, two: Ride) -> tuple[str, ...]:
    return tuple(sorted((one.name, two.name)))


COUNTS: dict[str, dict[str, Callable[[Traffic], Found]]] = {
    "stop": {"p1": p1, "p3": p3, "first_come": first_come, "full_stop": full_stop, "no_collision": no_collision},
    "lights": {"p4": red, "red": red, "no_collision": no_collision},
    "yield": {"full_stop": full_stop, "no_collision": no_collision},
}
"""By kind of junction and rule."""

"""Concrete scenarios: an abstract scenario with distances, speeds, the cycle of the lights and all other parameters of a run."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import lru_cache
from typing import Any

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.states import SLOT, Agent, SignalPlan, Vehicle
from pytest_rvads.scenarios.classes import OCCUPANCIES, Directions, Orbits, label, parse, rotate
from pytest_rvads.scenarios.configurations import explicit_label, per_entrance, placed
from pytest_rvads.scenarios.pedestrians import Pedestrian, Setting, cast_of, settings
from pytest_rvads.scenarios.senses import IDEAL, Senses
from pytest_rvads.support.errors import ScenarioError, require
from pytest_rvads.support.wording import shown

MOST_FOLLOWERS = 9
"""Greatest number of vehicles that queue behind each vehicle."""
UNSAID: dict[str, Any] = {"followers": 0, "elapsed": 0, "pedestrians": ()}
"""Values of fields that `Scenario.record` leaves out."""
_IN_IDS = re.compile(r"[A-Za-z0-9_.-]+")


def cycle(place: Junction) -> float:
    """Return the duration of a cycle of the lights [s]; 0 at a junction without lights."""
    return len(place.phase_groups) * SLOT


def first_green(place: Junction, rotation: int) -> int:
    """Return the number of the phase group with green at t = 0: the group of the entrance to which the rotation moves entrance 0.

    With one lane per arm, a rotation by an odd number of arms swaps the two groups, as in the paper, even if the map
    has other groups.
    """
    groups, count = place.phase_groups, len(place.entrances)
    if place.one_lane_each:
        return rotation % 2 if len(groups) > 1 else 0
    moved = [frozenset((entrance + rotation) % count for entrance in group) for group in groups[:1]]
    return next((groups.index(group) for group in moved if group in groups), 0)


def usual_duration(place: Junction) -> float:
    """Return the default duration of runs at a junction [s].

    The duration is 60 s, or, with more than two phase groups, a cycle of the lights and 30 s. So every vehicle has green once,
    and half a minute to leave after that.
    """
    return 60.0 if len(place.phase_groups) <= 2 else cycle(place) + 30.0


@dataclass(frozen=True, slots=True, init=False)
class Scenario:
    """A concrete scenario: a vehicle at each occupied entrance of a junction, with a direction, a distance and a speed.

    Directions, distances and speeds are given per entrance before rotation. The rotation moves directions, distances, speeds and
    the order of creation on by `rotation` entrances, and changes the light phase, see `signals`.

    Example:
        >>> Scenario(find("stop4"), "1133", distance=20, speed=10).name
        'stop4-class07-as1133-cfgd20.00v10.00'
    """

    place: Junction
    """The junction; with pedestrians, the junction with its crossings, see `Junction.walked`."""
    directions: tuple[int, ...]
    """Symbolic directions per entrance before rotation, see `Junction.by_direction`; 0 for an empty entrance."""
    distances: tuple[float, ...]
    """Distances from the reference point to the stopping line at the start, per entrance before rotation [m]."""
    speeds: tuple[float, ...]
    """Speeds at the start, per entrance before rotation [m/s]."""
    rotation: int
    """Number of entrances, counter-clockwise, by which the scenario is rotated."""
    configuration: str
    """Label of the distances and speeds in the ids of tests."""
    duration: float
    """Longest run [s]."""
    aggression: int
    """Braking level of the vehicles: 1, 2 or 3."""
    wait: float
    """Random waiting time, for drivers that use it [s]."""
    subject: int | None
    """Entrance whose first vehicle is the vehicle under test; None if every vehicle is under test."""
    order: tuple[int, ...]
    """Entrances before rotation, in the order in which their vehicles are created."""
    senses: Senses
    """Senses of the vehicle under test, or of all vehicles."""
    followers: int
    """Number of vehicles that queue behind each vehicle, on the same itinerary."""
    elapsed: int
    """Time of the cycle of the lights that has passed at the start [s]; 0 at a junction without lights."""
    pedestrians: tuple[Pedestrian, ...]
    """The pedestrians, as they stand on the map."""

    def __init__(  # noqa: PLR0913 - the parameters of a scenario, by keyword
        self,
        place: Junction,
        directions: str | Sequence[int],
        *,
        distance: float | Sequence[float] = 20.0,
        speed: float | Sequence[float] = 0.0,
        rotation: int = 0,
        configuration: str | None = None,
        duration: float | None = None,
        aggression: int = 1,
        wait: float = 1.5,
        subject: int | None = None,
        order: Sequence[int] | None = None,
        senses: Senses = IDEAL,
        followers: int = 0,
        elapsed: int = 0,
        pedestrians: Sequence[Pedestrian] = (),
    ) -> None:
        """Describe a scenario; a single number applies to all entrances, and the duration is `usual_duration` by default.

        Raises:
            ScenarioError: the junction lacks a direction at an entrance, a number is out of range, a sequence has a wrong length,
                or `place` is no junction.
        """
        require(place, Junction, "a scenario needs a junction, such as rvads.find('stop4')", ScenarioError)
        if not (isinstance(pedestrians, Sequence) and all(isinstance(walker, Pedestrian) for walker in pedestrians)):
            raise ScenarioError(f"pedestrians must be a list of rvads.Pedestrian(crossing, side, ...), got {pedestrians!r:.100}")
        walkers = tuple(pedestrians)
        place = place.walked if walkers else place.unwalked
        cast_of(place, walkers)
        code = parse(directions)
        count = len(code)
        if count != len(place.entrances):
            raise ScenarioError(
                f"directions {label(code)!r} describe {count} entrances, junction {place.name!r} has {len(place.entrances)}"
            )
        check_followers(followers)
        seconds = round(cycle(place))
        if not within(elapsed, max(seconds, 1)):
            raise ScenarioError(
                f"elapsed must be a whole number of seconds below the cycle of the lights, {seconds} s, got {elapsed!r}"
            )
        distances = per_entrance("distance", distance, count)
        speeds = per_entrance("speed", speed, count)
        check_rotation(place, rotation)
        check_directions(place, rotate(code, rotation))
        duration = usual_duration(place) if duration is None else duration
        check_numbers(duration, aggression, wait)
        if subject is not None and not (within(subject, count) and code[subject - rotation]):
            raise ScenarioError(
                f"subject must be an occupied entrance of {label(rotate(code, rotation), place.lanes)}, got {subject!r}"
            )
        creation = tuple(range(count)) if order is None else order
        if not (
            isinstance(creation, Sequence) and all(within(e, count) for e in creation) and sorted(creation) == [*range(count)]
        ):
            raise ScenarioError(f"order must name each of the entrances 0..{count - 1} once, got {order!r}")
        if configuration is None:
            configuration = explicit_label(distances, speeds)
        elif not (isinstance(configuration, str) and _IN_IDS.fullmatch(configuration)):
            raise ScenarioError(f"configuration must be a label of letters, digits, '_', '.' and '-', got {configuration!r}")
        require(senses, Senses, "senses must be rvads.Senses(...)", ScenarioError)
        values = (
            *(place, code, distances, speeds, rotation, configuration),
            *(float(duration), aggression, float(wait), subject, tuple(creation), senses, followers, elapsed, walkers),
        )
        for name, value in zip(self.__slots__, values, strict=True):
            object.__setattr__(self, name, value)

    def _repr_html_(self) -> str:
        return shown(self)

    def but(self, **changes: Any) -> Scenario:
        """Return the scenario with some arguments of its constructor changed."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        values["distance"], values["speed"] = values.pop("distances"), values.pop("speeds")
        if {"distance", "speed"} & set(changes):
            values["configuration"] = None
        return Scenario(**(values | changes))

    @property
    def ways(self) -> int:
        """Number of arms of the junction."""
        return self.place.ways

    @property
    def placed(self) -> tuple[int, ...]:
        """Directions as they stand on the map, after rotation (digit i = entrance i)."""
        return rotate(self.directions, self.rotation)

    @property
    def label(self) -> str:
        """The directions on the map as a string; if an arm has several entrances, ``_`` separates the arms."""
        return label(self.placed, self.place.lanes)

    @property
    def number(self) -> int:
        """Number of the structural equivalence class; 0 unless every arm, or every lane, has one vehicle."""
        return _orbit(self.place, self.directions)[1]

    @property
    def orbit(self) -> str:
        """Label of the lexicographically least scenario in the class of this scenario.

        The label is empty for a scenario with one vehicle on each arm, because the number of its class identifies the class.
        """
        orbits, number = _orbit(self.place, self.directions)
        if number and orbits == Orbits.at(self.place):
            return ""
        return label(orbits.representative(self.directions), self.place.lanes)

    @property
    def creation(self) -> tuple[int, ...]:
        """Occupied entrances in the order in which their vehicles are created."""
        order = ((i + self.rotation) % len(self.order) for i in self.order)
        return tuple(e for e in order if self.placed[e])

    @property
    def name(self) -> str:
        """The id of a test of this scenario, without the rule: junction, class, abstract scenario, pedestrians, configuration."""
        turned = f".r{self.rotation}" if self.rotation else ""
        if self.order != tuple(range(len(self.order))):
            turned += f".o{label(self.order)}"
        seat = "" if self.subject is None else f"-s{self.subject}"
        orbits, number = _orbit(self.place, self.directions)
        cls = (orbits if number else Orbits.at(self.place)).label(number)
        walkers = f"-w{self.walking}" if self.pedestrians else ""
        return f"{self.place.name}-{cls}-as{self.label}{seat}{walkers}-cfg{self.point}{turned}"

    @property
    def walking(self) -> str:
        """The pedestrians as in the ids of tests, see `Pedestrian.label`; empty if nobody walks."""
        return "_".join(walker.label for walker in self.pedestrians)

    @property
    def point(self) -> str:
        """Label of how the vehicles start: configuration, number of followers, elapsed cycle of the lights, imperfect senses."""
        queue = f"f{self.followers}" if self.followers else ""
        elapsed = f"e{self.elapsed}" if self.elapsed else ""
        return ".".join(filter(None, (self.configuration, queue, elapsed, self.senses.label)))

    @property
    def under_test(self) -> str | None:
        """Name of the vehicle under test in a scenario with traffic; None if every vehicle is under test."""
        return None if self.subject is None else self.place.vehicle_at(self.subject)

    def start(self, entrance: int) -> tuple[float, float]:
        """Return distance to the stopping line [m] and speed [m/s] of the vehicle at `entrance` of the map."""
        before = (entrance - self.rotation) % len(self.directions)
        return self.distances[before], self.speeds[before]

    def starts(self, body: Callable[[str], Vehicle] | None = None) -> tuple[tuple[float, float], ...]:
        """Return per agent its distance to the stopping line [m] and its speed [m/s], in the order of `agents`.

        A follower starts at the speed of the vehicle ahead. The gap between the two is 2 m and the distance driven in 1 s. Two
        vehicles from different entrances in a common lane need at least the same gap. Vehicles on converging approaches must
        not touch.

        Args:
            body: returns the vehicle of an agent, given by name; passenger cars by default.

        Raises:
            ScenarioError: a vehicle would start before the beginning of its approach, two vehicles in one lane would start too
                close to each other, or two vehicles would start inside each other.
        """
        agents = self.agents()
        bodies = [body(agent.name) if body else Vehicle() for agent in agents]
        return placed(self.place, agents, bodies, [self.start(agent.entrance) for agent in agents])

    def walkers(self, body: Callable[[str], Vehicle] | None = None) -> tuple[Setting, ...]:
        """Return where and when the pedestrians, and the vehicles parked for them, start.

        Args:
            body: returns the vehicle of an agent, given by name; passenger cars by default.

        Raises:
            ScenarioError: no vehicle crosses the way of a pedestrian, a pedestrian would start behind the crossing, or a vehicle
                has no room at its start, see `starts`.
        """
        if not self.pedestrians:
            return ()
        rows = zip(self.agents(), self.itineraries(), self.starts(body), strict=True)
        vehicles = [(agent, way.start(distance), speed) for agent, way, (distance, speed) in rows]
        vehicles.sort(key=lambda row: row[0].entrance != self.subject)
        return settings(self.place, self.pedestrians, vehicles, self.signals().colours(0.0, len(self.place.starts)))

    def agents(self) -> tuple[Agent, ...]:
        """Return the vehicles in the order of their entrances, at each entrance the first vehicle before its followers."""
        place = self.place
        return tuple(
            Agent(place.vehicle_at(e) + (f"+{k}" if k else ""), place.leads(e, d))
            for e, d in enumerate(self.placed)
            if d
            for k in range(self.followers + 1)
        )

    def itineraries(self) -> tuple[Itinerary, ...]:
        """Return the itineraries of `agents`, in the same order."""
        return tuple(itinerary(self.place, *a.way.key) for a in self.agents())

    def signals(self) -> SignalPlan:
        """Return the signal plan; `first_green` gives the group of entrances that is green first."""
        place = self.place
        walks = ((way.entrance, start.phase, way.length) for way, start, _ in place.further if start.phase is not None)
        return SignalPlan(place.phase_groups, first_green(place, self.rotation), self.elapsed, tuple(walks))

    def describe(self) -> str:
        """Return the start in one line: name, movements, distances and speeds of the first vehicles, number of followers."""
        occupied = [(entrance, direction) for entrance, direction in enumerate(self.placed) if direction]
        starts = [self.start(entrance) for entrance, _ in occupied]
        movements = " ".join(f"{e}->{self.place.leads(e, d).exit}" for e, d in occupied)
        distances = " ".join(f"{d:g}" for d, _ in starts)
        speeds = " ".join(f"{v:g}" for _, v in starts)
        queue = f"  {self.followers} behind each" if self.followers else ""
        walkers = "".join(
            f"  p{number} {walker.behaviour} from the {walker.side} side of crosswalk {walker.crossing}, "
            f"{abs(walker.difference):g} s {'early' if walker.difference < 0 else 'late'}"
            for number, walker in enumerate(self.pedestrians)
        )
        return f"{self.name} ({movements})  d=({distances}) m  v=({speeds}) m/s{queue}{walkers}"

    def record(self) -> dict[str, Any]:
        """Return the fields as builtins, for records and run files; the junction is given by its name and its map file."""
        values = {item.name: getattr(self, item.name) for item in fields(self)[1:]}
        for name in UNSAID:
            if not values[name]:
                del values[name]
        if self.pedestrians:
            values["pedestrians"] = [asdict(walker) | {"side": f"{walker.side}"} for walker in self.pedestrians]
        return {"junction": self.place.name, "map": self.place.map, **values, "senses": self.senses.record()}


@lru_cache(maxsize=4096)
def _orbit(place: Junction, code: Directions) -> tuple[Orbits, int]:
    """Return the scenarios of a junction that include `code`, and the number of its class; 0 if arms or lanes are empty."""
    for orbits in (Orbits.at(place, occupancy) for occupancy in OCCUPANCIES):
        if number := orbits.number(code):
            return orbits, number
    return Orbits.at(place, partial=True), 0


def within(value: object, count: int) -> bool:
    """Return whether `value` is a whole number of 0 or more below `count`."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < count


def check_rotation(place: Junction, rotation: int) -> None:
    """Check that a rotation keeps lanes, movements and signs of the junction."""
    count, rows = len(place.entrances), Orbits.at(place).rows
    if not within(rotation, count):
        raise ScenarioError(f"rotation must be one of 0..{count - 1} for {count} entrances, got {rotation!r}")
    if rotation not in rows:
        raise ScenarioError(
            f"rotation must be one of {', '.join(map(str, rows))}, by so many entrances junction {place.name!r} keeps its lanes, "
            f"movements and signs, got {rotation}: give the directions as they stand on the map"
        )


def check_directions(place: Junction, placed: Directions) -> None:
    """Check that every vehicle has a movement."""
    for entrance, direction in enumerate(placed):
        if direction and (entrance, direction) not in place.by_direction:
            try:
                place.leads(entrance, direction)
            except ScenarioError as refused:
                raise ScenarioError(f"{refused}, and 0 is nobody, got {label(placed, place.lanes)!r}") from None


def check_followers(followers: int) -> None:
    """Check that a number of followers is 0 to `MOST_FOLLOWERS`."""
    if not within(followers, MOST_FOLLOWERS + 1):
        raise ScenarioError(f"followers must be a whole number from 0 to {MOST_FOLLOWERS}, got {followers!r}")


def check_numbers(duration: float | None, aggression: int, wait: float) -> None:
    """Check a duration [s], an aggression and a wait [s]; a duration of None is the default."""
    duration = 60.0 if duration is None else duration
    if not (within(aggression, 4) and aggression):
        raise ScenarioError(f"aggression must be 1, 2 or 3, got {aggression!r}")
    for name, seconds in (("duration", duration), ("wait", wait)):
        if isinstance(seconds, bool) or not isinstance(seconds, int | float):
            raise ScenarioError(f"{name} must be a number of seconds, got {seconds!r}")
    if not (math.isfinite(duration) and 0 < duration <= 3600):
        raise ScenarioError(f"duration must lie above 0 and up to 3600 s, got {duration!r}")
    if not (math.isfinite(wait) and wait >= 0):
        raise ScenarioError(f"wait must be 0 s or more, got {wait!r}")

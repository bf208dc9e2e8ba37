"""Pedestrians of a scenario, and the walks that a test asks for: crosswalk, side, behaviour and time of arrival.

The start of a pedestrian is given by a difference of arrivals: the arrival of the pedestrian at the way of a vehicle minus the
arrival of this vehicle at the way of the pedestrian, if nobody reacts to anybody. So a grid of differences combines with every
start of the vehicles.

The vehicle is the vehicle under test if its way leads over the crosswalk, and else the first vehicle whose way does. It is taken
to accelerate by `PULL` up to `CRUISE` if it starts more slowly, and to keep its speed otherwise.

Two scenarios with a pedestrian are equal up to rotation if a rotation of the junction maps the vehicles of one scenario onto
those of the other, and the crosswalk of its pedestrian onto the other crosswalk. Only rotations that keep the crosswalks count.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

from pytest_rvads.drivers.walking import KERB, STRIDE, behaviour
from pytest_rvads.geometry.crosswalks import PERSON, SIDEWALK, Parking, Side
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.runs.states import Agent, Colour, Kind, Vehicle
from pytest_rvads.scenarios.classes import Directions, Orbits, rotate
from pytest_rvads.scenarios.configurations import plain
from pytest_rvads.support.errors import ScenarioError, suggest

PULL, CRUISE = 2.0, 8.0
"""Acceleration [m/s^2] and final speed [m/s] of a vehicle that starts slowly, to compute when it would arrive."""
_APART = 0.8
"""Distance between the pedestrians of a group [m]."""
_PARKED = -1.0
"""Station of the front of a parked vehicle: this far before the crosswalk [m]."""


@dataclass(frozen=True, slots=True)
class Pedestrian:
    """A pedestrian, or a group, who crosses a crosswalk.

    Raises:
        ScenarioError: the number of the crosswalk is negative, the side or the behaviour is unknown, or the difference is not a
            finite number.
    """

    crossing: int
    """Number of the crosswalk in `Junction.crossings`, as it stands on the map."""
    side: str = Side.NEAR
    """Side from which the pedestrian comes, a `Side`; ``near`` is the side of the entrances."""
    behaviour: str = "steady"
    """Name of the behaviour, one of `pytest_rvads.drivers.walking.BEHAVIOURS`."""
    difference: float = 0.0
    """Arrival of the pedestrian minus arrival of the vehicle [s]; negative if the pedestrian is early."""

    def __post_init__(self) -> None:
        if not (isinstance(self.crossing, int) and not isinstance(self.crossing, bool) and self.crossing >= 0):
            raise ScenarioError(f"crossing must be the number of a crosswalk, 0 or more, got {self.crossing!r}")
        if self.side not in tuple(Side):
            raise ScenarioError(f"side must be one of {', '.join(Side)}, got {self.side!r}")
        behaviour(self.behaviour)
        number = isinstance(self.difference, int | float) and not isinstance(self.difference, bool)
        if not (number and abs(self.difference) <= sys.float_info.max):
            raise ScenarioError(f"difference must be a finite number of seconds, got {self.difference!r:.60}")
        object.__setattr__(self, "side", Side(self.side))
        object.__setattr__(self, "difference", round(float(self.difference), 2) + 0.0)
        if behaviour(self.behaviour).parked and self.side is Side.FAR:
            raise ScenarioError(
                f"a pedestrian with the behaviour {self.behaviour!r} comes from the near side, where a vehicle can be parked "
                "before the crosswalk: say side='near'"
            )

    @property
    def course(self) -> str:
        """The crosswalk, the side and the behaviour as in the ids of tests, such as ``1n.steady``."""
        return f"{self.crossing}{self.side[0]}.{self.behaviour}"

    @property
    def label(self) -> str:
        """The pedestrian as in the ids of tests: ``1n.steady.e0.50`` is early by 0.5 s, from the near side of crosswalk 1."""
        late = "e" if self.difference < 0 else "l"
        return f"{self.course}.{late}{abs(self.difference):.2f}"


class Crossed(ScenarioError):
    """A pedestrian would have crossed before the run begins.

    Cause: the pedestrian is earlier than the vehicle by more time than the vehicle needs.
    Remedy: a greater difference of arrivals, or a vehicle that starts farther away.
    """


class Setting(NamedTuple):
    """Where and when a pedestrian, or a parked vehicle, starts."""

    agent: Agent
    station: float
    """Station at the start of the run [m]."""
    speed: float
    """Speed at the start of the run [m/s]; 0 for a pedestrian who sets out later."""
    delay: float
    """Time at which the pedestrian sets out [s]; inf for a parked vehicle."""
    behaviour: str
    """Name of the behaviour; ``parked`` for a parked vehicle."""
    behind: float = 0.0
    """Distance to the first pedestrian of the group [m]; 0 for the first pedestrian."""
    crossed: float = -math.inf
    """Greatest difference of arrivals with which the pedestrian has crossed when the run begins [s].

    The difference is -inf for a parked vehicle, and for a pedestrian who starts before the kerb even if the pedestrian is early.
    """


def cast_of(place: Junction, pedestrians: Sequence[Pedestrian]) -> tuple[Agent, ...]:
    """Return the agents of pedestrians in their order, each parked vehicle after the first pedestrian whom it hides."""
    return tuple(agent for number in range(len(pedestrians)) for agent in _agents(place, pedestrians, number))


def _agents(place: Junction, pedestrians: Sequence[Pedestrian], number: int) -> Iterator[Agent]:
    walker = pedestrians[number]
    count = len(place.crossings)
    if walker.crossing >= count:
        had = f"its crosswalks are 0 to {count - 1}" if count else "it has no crosswalk"
        raise ScenarioError(f"junction {place.name!r} has no crosswalk {walker.crossing}: {had}")
    way = place.further[2 * walker.crossing + (walker.side is Side.FAR)].way
    manner = behaviour(walker.behaviour)
    for k in range(manner.people):
        yield Agent(f"p{number}" + (f"+{k}" if k else ""), way, Kind.PEDESTRIAN, (PERSON, PERSON))
    if manner.parked and not any(behaviour(p.behaviour).parked and p.crossing == walker.crossing for p in pedestrians[:number]):
        yield Agent(f"parked{number}", place.further[2 * count + walker.crossing].way, size=(Vehicle().length, Vehicle().width))


def arrival(distance: float, speed: float) -> float:
    """Return the time [s] in which a vehicle that starts at a speed [m/s] drives a distance [m], negative for a passed place."""
    pace = max(speed, CRUISE)
    rising = (pace * pace - speed * speed) / (2.0 * PULL)
    if distance <= 0.0 or rising <= 0.0:
        return distance / pace
    if distance < rising:
        return (math.sqrt(speed * speed + 2.0 * PULL * distance) - speed) / PULL
    return (pace - speed) / PULL + (distance - rising) / pace


def settings(
    place: Junction,
    pedestrians: Sequence[Pedestrian],
    vehicles: Sequence[tuple[Agent, float, float]],
    lights: Sequence[Colour] = (),
) -> tuple[Setting, ...]:
    """Return where and when the agents of `cast_of` start, in the same order.

    A pedestrian who looks at the kerb before going, or whose light forbids to go when the run begins, starts before the kerb.
    The vehicles come with their stations [m] and speeds [m/s] at the start, the vehicle under test first.
    """
    rows = []
    for number, walker in enumerate(pedestrians):
        agents, manner = tuple(_agents(place, pedestrians, number)), behaviour(walker.behaviour)
        # The first vehicle that crosses the way of the pedestrian, and the time of its arrival there [s].
        for vehicle, start, pace_at_start in vehicles:
            shared = (place.stretches or {}).get((vehicle.way.key, agents[0].way.key))
            if shared:
                reached = arrival(shared.mine.start - start, pace_at_start)
                break
        else:
            raise ScenarioError(
                f"no vehicle of the scenario drives over crosswalk {walker.crossing} of junction {place.name!r}, so nobody can "
                "meet a pedestrian there: choose another crosswalk or other directions"
            )
        speed, length = manner.speed, agents[0].way.length
        station = shared.yours.start - speed * (reached + walker.difference)
        crossed = (shared.yours.start - length) / speed - reached
        if manner.kerb or (lights and manner.obeys(lights[agents[0].entrance])):
            station, crossed = min(station, -KERB), -math.inf
        if station >= length:
            raise Crossed(
                f"p{number} would have crossed before the run begins, {-walker.difference:g} s before the vehicle: choose a "
                "greater difference"
            )
        wait = (-SIDEWALK - station) / speed  # for a pedestrian who starts at full speed at the end of the sidewalk
        rising = speed / (2.0 * STRIDE)  # time that setting out costs
        delay, pace = max(wait - rising, 0.0), speed if wait <= 0.0 else 0.0
        begin = station if wait <= 0.0 else -SIDEWALK + speed * max(rising - wait, 0.0)
        for k, agent in enumerate(agents):
            if isinstance(agent.way, Parking):
                rows.append(Setting(agent, _PARKED, 0.0, math.inf, "parked"))
            else:
                rows.append(Setting(agent, begin - k * _APART, pace, delay, walker.behaviour, k * _APART, crossed))
    return tuple(rows)


DIFFERENCES = tuple(half / 2 for half in range(-8, 9))
"""Differences of arrivals unless a test names others [s]: every half second from 4 s early to 4 s late."""
_FIELDS: dict[str, tuple[Any, ...]] = {
    "crossing": (None,),
    "side": tuple(Side),
    "behaviour": ("steady",),
    "difference": DIFFERENCES,
}
"""Default values per field of a pedestrian; a crosswalk of None stands for every crosswalk that a vehicle drives over."""


class Walk(NamedTuple):
    """A pedestrian that a test asks for."""

    pedestrian: Pedestrian
    everywhere: bool = False
    """Whether the pedestrian walks at every crosswalk in turn, whatever the number of its crosswalk."""


def walks_of(value: object) -> tuple[Walk, ...]:
    """Return the walks of the argument ``pedestrians=`` of a mark.

    It is the name of a behaviour, a `Pedestrian`, a dict of the fields of a `Pedestrian` with a value or several values each, or
    several of these; None for no pedestrians.
    """
    if value is None:
        return ()
    entries = [value] if isinstance(value, str | Mapping) or not isinstance(value, Iterable) else list(value)
    if not entries:
        raise ScenarioError("pedestrians is empty: name a behaviour, such as 'steady', or leave it out")
    walks: dict[Walk, None] = {}
    for entry in entries:
        if isinstance(entry, Pedestrian):
            walks[Walk(entry)] = None
            continue
        if not isinstance(entry, str | Mapping):
            raise ScenarioError(
                "pedestrians takes names of behaviours, rvads.Pedestrian(...) or dicts of its fields, one or several, got "
                f"{entry!r:.100}"
            )
        given: Mapping[str, Any] = {"behaviour": entry} if isinstance(entry, str) else entry
        for name in given:
            if name not in _FIELDS:
                raise ScenarioError(f"pedestrians have {', '.join(_FIELDS)}, got {name!r}{suggest(str(name), _FIELDS)}")
        lists = [plain(given.get(name, default)) for name, default in _FIELDS.items()]
        lists = [list(values) if isinstance(values, list | tuple) else [values] for values in lists]
        if not all(lists):
            raise ScenarioError(f"pedestrians are given by values or lists of at least one value, got {dict(given)!r}")
        for crossing, side, manner, difference in product(*lists):
            # Behind parked vehicles pedestrians walk from the near side alone.
            if not (behaviour(manner).parked and side == Side.FAR and Side.NEAR in lists[1]):
                pedestrian = Pedestrian(0 if crossing is None else crossing, side, manner, difference)
                walks[Walk(pedestrian, crossing is None)] = None
    return tuple(walks)


def choices(place: Junction, ways: Collection[Key], walks: Iterable[Walk]) -> Iterator[Pedestrian]:
    """Yield the pedestrians among `walks` who can meet a vehicle, crosswalk by crosswalk."""
    for number in sorted({number for number, key in place.covers if key in ways}):
        for pedestrian, everywhere in walks:
            if everywhere:
                yield replace(pedestrian, crossing=number)
            elif pedestrian.crossing == number:
                yield pedestrian


def least(place: Junction, placed: Directions, seat: int | None, crossing: int) -> tuple[Directions, int, int]:
    """Return the least image of a scenario with a pedestrian, equal for scenarios that differ by rotation."""
    count = len(placed)
    return min(
        (rotate(placed, row), -1 if seat is None else (seat + row) % count, images[crossing]) for row, images in turns(place)
    )


@lru_cache(maxsize=256)
def turns(place: Junction) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """Return the rotations of a junction that keep lanes, movements, signs and crosswalks, the identity first.

    A rotation comes with the numbers of the crosswalks onto which it moves the crosswalks.
    """
    below = [{key for number, key in place.covers if number == k} for k in range(len(place.crossings))]
    groups, rotations = place.phase_groups, []
    for arms, row in zip(place.rotations, Orbits.at(place).rows, strict=True):
        lanes = place.image(arms)
        if lanes is None:
            continue
        entrances, exits = lanes
        images: list[int] = []
        for crosswalk, keys in zip(place.crossings, below, strict=True):
            moved = {(entrances[start], exits[end]) for start, end in keys}
            green = None if crosswalk.phase is None else frozenset(entrances[entrance] for entrance in groups[crosswalk.phase])
            for number, other in enumerate(place.crossings):
                same_green = green is None if other.phase is None else green == groups[other.phase]
                same_arm = other.arm == (crosswalk.arm + arms) % place.ways
                if number not in images and same_arm and same_green and below[number] == moved:
                    images.append(number)
                    break
        if len(images) == len(place.crossings):
            rotations.append((row, tuple(images)))
    return tuple(rotations)

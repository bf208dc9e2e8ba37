"""Turns the request of a test into scenarios: classes, members, rows or pairs of movements, and configurations.

The function `extended` gives the numbers of classes and pairs at junctions whose number of ways does not determine these numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from zlib import crc32

from msgspec.structs import replace

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.report.session_report import Extent, Move
from pytest_rvads.scenarios.configurations import Configuration
from pytest_rvads.scenarios.forks import near
from pytest_rvads.scenarios.orbits import WAYS, Directions, Orbits, rotate
from pytest_rvads.scenarios.pairs import PAIRED, covering, pairs_at
from pytest_rvads.scenarios.scenario import Scenario, started
from pytest_rvads.scenarios.senses import IDEAL, Senses
from pytest_rvads.support.errors import ScenarioError

__all__ = ["CHOOSING", "COVERS", "TOO_SHORT", "TOO_TIGHT", "Selection", "alone", "extended"]

CHOOSING = ("partial", *PAIRED)
"""Covers that choose scenarios themselves.

The cover ``partial`` has one row per class of scenarios that may leave entrances empty. The other covers have enough scenarios
for every pair of movements, or for every pair that conflicts.
"""
TOO_TIGHT = "no car can keep its lane in a bend so narrow (cover 'class' takes them all the same)"
"""The reason for movements that the covers of `PAIRED` leave out."""
TOO_SHORT = "with an approach too short for a staggered start, where vehicles start as far out as they can"
"""The message on junctions for which `Selection.too_short` holds."""
COVERS = ("class", "scenario", "rotation", *CHOOSING)
"""One row per class; every distinct member; all rows, as in the paper's tables; and the covers of `CHOOSING`."""


@dataclass(frozen=True)
class Selection:
    """The product of abstract scenarios of a junction and configurations.

    Raises:
        ScenarioError: the junction does not have a selected class, scenario or subject.
    """

    place: Junction
    configurations: tuple[Configuration, ...]
    cover: str = "class"
    """One of `COVERS`."""
    occupancy: str = "arms"
    """One of `pytest_rvads.scenarios.orbits.OCCUPANCIES`."""
    classes: tuple[int, ...] | None = None
    """Class numbers; None for all classes."""
    scenarios: tuple[Directions, ...] | None = None
    """Scenarios at row 0 of their class; None for the representatives."""
    subject: int | str | None = None
    """Entrance of the vehicle under test among traffic, or ``"all"`` for every seat in turn."""
    followers: tuple[int, ...] = (0,)
    """Lengths of the queue behind each vehicle; each length is combined with every configuration."""
    senses: tuple[Senses, ...] = (IDEAL,)
    """Senses of the vehicle under test; each value is combined with every configuration."""
    duration: float | None = None
    """Longest run [s]; `usual_duration` if None."""
    aggression: int = 1
    wait: float = 1.5
    alternating: bool = False
    """Whether every scenario and seat runs at one point only, in turn, instead of at all points."""
    left_out: int = 0
    """Number of further requested configurations, left out because no vehicle could stop."""

    def __post_init__(self) -> None:
        entrances, total = self.entrances, self.orbits.count
        for number in self.classes or ():
            if not 1 <= number <= total:
                occupancy = "" if self.place.one_lane_each else f" of occupancy={self.occupancy!r}"
                raise ScenarioError(f"a {self.place.ways}-way junction has classes 1..{total}{occupancy}, got {number!r}")
        if (self.classes is not None or self.scenarios is not None) and self.cover in CHOOSING:
            raise ScenarioError(f"cover={self.cover!r} chooses scenarios itself: leave classes= and scenarios= out, or the cover")
        if self.subject not in (None, "all", *range(entrances)):
            raise ScenarioError(f"subject must be an entrance, 0 to {entrances - 1}, or 'all', got {self.subject!r}")

    @property
    def entrances(self) -> int:
        """Number of entrances."""
        return len(self.place.entrances)

    @property
    def points(self) -> int:
        """Number of runs per abstract scenario."""
        return 1 if self.alternating else len(self.configurations) * len(self.followers) * len(self.senses)

    @property
    def too_tight(self) -> tuple[str, ...]:
        """The movements that the cover leaves out because no car can keep its lane there, each named by junction and lanes."""
        keys = sorted(self.place.tight) if self.cover in PAIRED else ()
        return tuple(f"{self.place.name} from entrance {entrance} to exit {exit}" for entrance, exit in keys)

    @property
    def too_short(self) -> bool:
        """Whether an approach is shorter than a staggered configuration requires, so that a vehicle starts nearer to its line."""
        distances = [max(point.distances) for point in self.configurations if point.staggered]
        return max(distances, default=0.0) > self._reach

    @property
    def _reach(self) -> float:
        """Length of the shortest approach [m]."""
        return min(map(self.place.approach, range(self.entrances)))

    @cached_property
    def orbits(self) -> Orbits:
        """The scenarios to choose from, and their classes."""
        return Orbits.at(self.place, self.occupancy, partial=self.cover == "partial")

    def count(self) -> int:
        """Return the number of selected abstract scenarios (rows and seats), without listing all classes."""
        if self.classes is not None or self.scenarios is not None or self.cover in PAIRED:
            return sum(len(self._seated(first)) for first in self._firsts())
        orbits = self.orbits
        once = self.cover in ("class", "partial")
        if self.subject is None:
            whole = orbits.scenarios if self.cover == "scenario" else orbits.count
            return whole * orbits.blocks if self.cover == "rotation" else whole
        seats = range(self.entrances) if self.subject == "all" else [int(self.subject)]
        if self.cover == "rotation":
            return sum(map(orbits.turned, seats))
        # Only the rotation by 0 keeps a seat, so every class of (scenario, seat) has as many members as rotations exist.
        seated = sum(map(orbits.seated, seats))
        return seated // orbits.blocks if once and self.subject == "all" else seated

    def __iter__(self) -> Iterator[Scenario]:
        """Yield the scenarios, class by class, row by row, configuration by configuration."""
        points = list(product(self.configurations, self.followers, self.senses))
        turn = crc32(self.place.name.encode()) if self.alternating else 0  # junctions of one shape start at different points
        for first in self._firsts():
            for row, subject in self._seated(first):
                turn += 1
                for configuration, followers, senses in [points[turn % len(points)]] if self.alternating else points:
                    yield Scenario(
                        self.place,
                        first,
                        **started(configuration, self.place, row, subject, followers),
                        rotation=row,
                        duration=self.duration,
                        aggression=self.aggression,
                        wait=self.wait,
                        subject=subject,
                        senses=senses,
                        followers=followers,
                    )

    @cached_property
    def roomy(self) -> bool:
        """Whether every vehicle certainly has room at its start, so that no scenario has to be checked."""
        longest = max(configuration.room for configuration in self.configurations)
        return not any(self.followers) and longest <= self._reach and not near(self.place)

    def fitting(self, unfit: Callable[[ScenarioError], object]) -> Iterator[Scenario]:
        """Yield the scenarios in which every vehicle has room at its start.

        Args:
            unfit: called with the reason for every scenario that is left out.
        """
        for scenario in self:
            if not self.roomy:
                try:
                    scenario.starts()
                except ScenarioError as error:
                    unfit(error)
                    continue
            yield scenario

    def _firsts(self) -> Iterator[Directions]:
        """Yield the scenario at row 0 of every selected class."""
        if self.scenarios is not None:
            yield from self.scenarios
            return
        if self.cover in PAIRED:
            yield from self._paired
            return
        numbers = None if self.classes is None else frozenset(self.classes)
        for number, code in enumerate(self.orbits, start=1):
            if numbers is None or number in numbers:
                yield code
            if numbers is not None and number >= max(numbers):
                return

    @cached_property
    def _paired(self) -> tuple[Directions, ...]:
        seat = self.subject if isinstance(self.subject, int) else None
        return covering(self.place, self.orbits, seat, conflicting=self.cover == "conflicts")

    def _seated(self, first: Directions) -> list[tuple[int, int | None]]:
        """Return pairs of a row and the entrance of the subject in this row.

        With a subject, a class runs once for every (scenario, seat). If the seat is fixed, the scenario is rotated through the
        seat, else the seat moves.
        """
        once = self.cover in ("class", "partial") and self.scenarios is None
        if self.subject is None:
            return [(row, None) for row in self._rows(first)]
        if self.subject == "all":
            if self.cover in ("class", "partial"):
                return [(0, seat) for seat in self.orbits.seats(first)]
            return [(row, seat) for row in self._rows(first) for seat, d in enumerate(rotate(first, row)) if d]
        seat = int(self.subject)
        rows = self.orbits.rows[: len(self.orbits.members(first))] if once else self._rows(first)
        # A named scenario is kept even if its seat is empty, so that the error says so.
        return [(row, seat) for row in rows if self.scenarios is not None or rotate(first, row)[seat]]

    def _rows(self, first: Directions) -> Sequence[int]:
        rows = self.orbits.rows
        if self.cover == "rotation":
            return rows
        return rows[: len(self.orbits.members(first))] if self.cover == "scenario" else rows[:1]


def alone(place: Junction) -> tuple[Directions, ...]:
    """Return the scenarios with a single vehicle, one per movement of a junction on which a car can keep its lane."""
    entrances = range(len(place.entrances))
    return tuple(
        tuple(direction if entrance == occupied else 0 for entrance in entrances)
        for occupied in entrances
        for direction in place.directions(occupied)
        if place.leads(occupied, direction).key not in place.tight
    )


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
        conflicts = () if place.conflicts is None else _moves(place, conflicting=True)
        after = replace(after, pairs=_moves(place, conflicting=False), conflicts=conflicts)
    return {**extents, place.name: after}


def _moves(place: Junction, *, conflicting: bool) -> tuple[tuple[Move, Move], ...]:
    def move(key: tuple[int, int]) -> Move:
        entrance, exit = place.entrances[key[0]], place.exits[key[1]]
        return (entrance.arm, entrance.lane), (exit.arm, exit.lane)

    return tuple((move(first), move(second)) for first, second in pairs_at(place, conflicting=conflicting))

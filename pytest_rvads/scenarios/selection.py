"""Turns what a test selects (classes, their scenarios or rotations, pairs of movements, configurations) into scenarios.

Each scenario with vehicles is combined with each pedestrian that the test asks for and that a vehicle can meet.

The function `extended` gives the numbers of classes and pairs at junctions whose number of arms does not determine these numbers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any
from zlib import crc32

from msgspec import structs

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.report.session_report import Extent
from pytest_rvads.scenarios.classes import PAIRED, WAYS, Directions, Orbits, covering, pairs_at, rotate
from pytest_rvads.scenarios.configurations import Configuration, near, started
from pytest_rvads.scenarios.pedestrians import Pedestrian, Walk, cast_of, choices, least, turns
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.senses import IDEAL, Senses
from pytest_rvads.support.errors import ScenarioError

CHOOSING = ("partial", *PAIRED)
"""Covers that choose scenarios; a test with such a cover can't name classes or scenarios itself.

The cover ``partial`` has one scenario per class of scenarios, including those with empty entrances. The cover ``pairs`` has
enough scenarios for every pair of movements, and ``conflicts`` for every pair of conflicting movements.
"""
_ONCE = ("class", "partial")
"""Covers with one scenario per class."""
TOO_TIGHT = "no car can keep its lane in a bend so narrow (cover 'class' takes them all the same)"
"""The reason why the covers of `PAIRED` leave out movements, in messages."""
TOO_SHORT = "with an approach too short for a staggered start, where vehicles start as far out as they can"
"""The message on junctions for which `Selection.too_short` holds."""
COVERS = ("class", "scenario", "rotation", *CHOOSING)
"""Names of covers, which say what a test runs of every class: one scenario (``class``), every distinct scenario (``scenario``),
or all rotations of a scenario, as in the paper's tables (``rotation``); and the covers of `CHOOSING`."""


@dataclass(frozen=True)
class Selection:
    """The product of abstract scenarios of a junction and configurations, as a test selects it.

    Raises:
        ScenarioError: the junction does not have a selected class, scenario or subject.
    """

    place: Junction
    configurations: tuple[Configuration, ...]
    cover: str = "class"
    """One of `COVERS`."""
    occupancy: str = "arms"
    """One of `pytest_rvads.scenarios.classes.OCCUPANCIES`."""
    classes: tuple[int, ...] | None = None
    """Class numbers; None for all classes."""
    scenarios: tuple[Directions, ...] | None = None
    """Scenarios before rotation, one per selected class; None for the lexicographically least scenario of every class."""
    subject: int | str | None = None
    """Entrance of the vehicle under test among traffic, or ``"all"`` for every occupied entrance in turn."""
    followers: tuple[int, ...] = (0,)
    """Lengths of the queue behind each vehicle; each length is combined with every configuration."""
    senses: tuple[Senses, ...] = (IDEAL,)
    """Senses of the vehicle under test; each value is combined with every configuration."""
    pedestrians: tuple[Walk, ...] = ()
    """Pedestrians; each is combined with every scenario in which the vehicle under test, or any vehicle without a subject, drives
    over the crosswalk. A junction with pedestrians is a walked junction, see `Junction.walked`."""
    further: Mapping[str, Any] = field(default_factory=dict)
    """Arguments that every `Scenario` of the selection gets, by name, such as ``duration``."""
    alternating: bool = False
    """Whether a scenario runs with only one combination of configuration, queue and senses, in turn, instead of with all."""
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
        if self.pedestrians and not self.place.crossings:
            raise ScenarioError(
                f"junction {self.place.name!r} has no crosswalk for pedestrians: choose a junction with crosswalks, or leave "
                "pedestrians= out"
            )
        cast_of(self.place, [walk.pedestrian for walk in self.pedestrians])

    @property
    def entrances(self) -> int:
        """Number of entrances."""
        return len(self.place.entrances)

    @property
    def points(self) -> int:
        """Number of runs per abstract scenario: one, or one per combination of configuration, queue and senses."""
        return 1 if self.alternating else len(self.configurations) * len(self.followers) * len(self.senses)

    @property
    def too_tight(self) -> tuple[str, ...]:
        """The movements that the selection leaves out because no car can keep its lane on them, named by junction and lanes."""
        keys = sorted(self.place.tight) if self.cover in PAIRED else ()
        return tuple(f"{self.place.name} from entrance {entrance} to exit {exit}" for entrance, exit in keys)

    @property
    def too_short(self) -> bool:
        """Whether an approach is shorter than a staggered configuration requires, so that a vehicle starts nearer to its line."""
        distances = [max(point.distances) for point in self.configurations if point.staggered]
        return max(distances, default=0.0) > min(map(self.place.approach, range(self.entrances)))

    @cached_property
    def orbits(self) -> Orbits:
        """The abstract scenarios of the junction to choose from, and their classes."""
        return Orbits.at(self.place, self.occupancy, partial=self.cover == "partial")

    @property
    def walks(self) -> int:
        """Greatest number of pedestrians with which the vehicles of a scenario are combined in turn; 1 without pedestrians."""
        if not self.pedestrians:
            return 1
        place, counts = self.place, Counter(key for _, key in self.place.covers)
        met = len({number for number, _ in place.covers}) if self.subject is None else max(counts.values(), default=0)
        return len(self.pedestrians) * met * (len(self.orbits.rows) // len(turns(place)))

    def count(self) -> int:
        """Return the number of selected abstract scenarios, counted per rotation and subject, without listing all classes.

        With pedestrians, the number is the greatest possible number: `walks` for every scenario with vehicles.
        """
        orbits, walks = self.orbits, self.walks
        if self.classes is not None or self.scenarios is not None or self.cover in PAIRED:
            return walks * sum(len(self._seated(first)) for first in self._firsts())
        if self.subject is None:
            whole = orbits.scenarios if self.cover == "scenario" else orbits.count
            return walks * whole * (orbits.blocks if self.cover == "rotation" else 1)
        seats = range(self.entrances) if self.subject == "all" else [int(self.subject)]
        if self.cover == "rotation":
            return walks * sum(map(orbits.turned, seats))
        seated = walks * sum(map(orbits.seated, seats))
        # Only the rotation by 0 keeps the subject's entrance, so every class of pairs (scenario, subject's entrance) has as many
        # members as the junction has rotations.
        return seated // orbits.blocks if self.cover in _ONCE and self.subject == "all" else seated

    def __iter__(self) -> Iterator[Scenario]:
        """Yield the selected scenarios, class by class, rotation by rotation, configuration by configuration."""
        points = list(product(self.configurations, self.followers, self.senses))
        # Junctions of one shape begin with different combinations.
        turn = crc32(self.place.name.encode()) if self.alternating else 0
        for first in self._firsts():
            seen: set[object] = set()
            for row, subject in self._seated(first):
                turn += 1
                walkers = [(walker,) for walker in self._walkers(rotate(first, row), subject, seen)] if self.pedestrians else [()]
                for configuration, followers, senses in [points[turn % len(points)]] if self.alternating else points:
                    for pedestrians in walkers:
                        yield Scenario(
                            self.place,
                            first,
                            **started(configuration, self.place, row, subject, followers),
                            rotation=row,
                            subject=subject,
                            senses=senses,
                            followers=followers,
                            pedestrians=pedestrians,
                            **self.further,
                        )

    def _walkers(self, placed: Directions, subject: int | None, seen: set[object]) -> Iterator[Pedestrian]:
        """Yield the pedestrians for the vehicles of a scenario; per class, only the first of those equal up to rotation."""
        rows = [(entrance, direction) for entrance, direction in enumerate(placed) if direction and subject in (None, entrance)]
        ways = {self.place.leads(entrance, direction).key for entrance, direction in rows}
        for walker in choices(self.place, ways, self.pedestrians):
            image = least(self.place, placed, subject, walker.crossing), replace(walker, crossing=0)
            if self.cover not in _ONCE or image not in seen:
                seen.add(image)
                yield walker

    @cached_property
    def roomy(self) -> bool:
        """Whether every vehicle certainly has room at its start, so that no scenario has to be checked."""
        longest = max(configuration.room for configuration in self.configurations)
        shortest = min(map(self.place.approach, range(self.entrances)))
        return not any(self.followers) and longest <= shortest and not near(self.place)

    def fitting(self, unfit: Callable[[ScenarioError], object]) -> Iterator[Scenario]:
        """Yield the scenarios in which every vehicle has room at its start, and no pedestrian would have crossed before."""
        for scenario in self:
            if self.pedestrians or not self.roomy:
                try:
                    scenario.walkers() if self.pedestrians else scenario.starts()
                except ScenarioError as error:
                    unfit(error)
                    continue
            yield scenario

    def _firsts(self) -> Iterator[Directions]:
        """Yield, for every selected class, its abstract scenario before rotation."""
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
        walked = bool(self.pedestrians)
        return covering(self.place, self.orbits, seat, conflicting=self.cover == "conflicts", walked=walked)

    def _seated(self, first: Directions) -> list[tuple[int, int | None]]:
        """Return pairs of a rotation and the entrance of the subject in the rotated scenario.

        With a subject, a class runs once for every vehicle of its scenario, up to symmetry. If the test fixes the entrance of the
        subject, the scenario is rotated, so that each of its vehicles in turn comes to this entrance. If the subject is
        ``"all"``, the scenario is not rotated, and each of its vehicles in turn is the subject. With pedestrians, all rotations
        and vehicles are candidates, the least directions first, because a symmetry of the vehicles can move the pedestrian.
        """
        once = self.cover in _ONCE and self.scenarios is None
        if self.pedestrians and self.cover in _ONCE and not isinstance(self.subject, int):
            placed = sorted((rotate(first, row), row) for row in (self.orbits.rows if once else [0]))
            seats = range(self.entrances) if self.subject == "all" else [None]
            return [(row, seat) for code, row in placed for seat in seats if seat is None or code[seat]]
        if self.subject is None:
            return [(row, None) for row in self._rows(first)]
        if self.subject == "all":
            if self.cover in _ONCE:
                return [(0, seat) for seat in self.orbits.seats(first)]
            return [(row, seat) for row in self._rows(first) for seat, d in enumerate(rotate(first, row)) if d]
        seat = int(self.subject)
        rows = self.orbits.rows[: len(self.orbits.members(first))] if once else self._rows(first)
        # A scenario that the test names is kept even if no vehicle is at the subject's entrance, so that the user gets an error.
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
    """Return the extents (numbers of classes and pairs by junction) with the extent of a selection's junction added.

    Nothing is added for a junction of the paper, because its number of arms determines these numbers.
    """
    place = selection.place
    full, usual = Orbits.at(place, selection.occupancy), Orbits.at(place)
    occupancy = "arms" if full == usual else selection.occupancy
    if selection.cover in ("class", "scenario", "rotation") and place.ways in WAYS and full == Orbits.plain(place.ways):
        return dict(extents)
    before = extents.get(place.name, Extent(turns=full.blocks))
    partial = {occupancy: selection.orbits.count} if selection.cover == "partial" else {}
    seated = sum(map(full.seated, range(full.size))) // full.blocks
    classes = before.classes | {occupancy: (full.count, full.scenarios, seated)}
    after = structs.replace(before, classes=classes, partial=before.partial | partial)
    if selection.cover in PAIRED or not place.one_lane_each:
        lanes = [(entrance.arm, entrance.lane) for entrance in place.entrances]
        ends = [(exit.arm, exit.lane) for exit in place.exits]
        pairs, conflicts = (
            tuple(((lanes[a], ends[b]), (lanes[c], ends[d])) for (a, b), (c, d) in found)
            for found in (pairs_at(place), () if place.conflicts is None else pairs_at(place, conflicting=True))
        )
        after = structs.replace(after, pairs=pairs, conflicts=conflicts)
    return {**extents, place.name: after}

"""From what a test asks for to the scenarios to run: classes or members, rows, configurations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from pytest_rvads.errors import ScenarioError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.scenarios.classes import Directions, classes, count_classes, count_scenarios, members, rotate, rotations, seats
from pytest_rvads.scenarios.configurations import Configuration
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.senses import IDEAL, Senses

__all__ = ["COVERS", "Selection"]

COVERS = ("class", "scenario", "rotation")
"""One row per class; every distinct member; all n rows, as in the paper's tables."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Abstract scenarios of one junction times configurations.

    Raises:
        ScenarioError: a class, scenario or subject that the junction does not have.
    """

    place: Junction
    configurations: tuple[Configuration, ...]
    cover: str = "class"
    """One of `COVERS`."""
    classes: tuple[int, ...] | None = None
    """Class numbers, or None for all."""
    scenarios: tuple[Directions, ...] | None = None
    """Scenarios that stand at row 0 of their class, or None for the representatives."""
    subject: int | str | None = None
    """Entrance of the vehicle under test among traffic, or ``"all"`` for every seat in turn."""
    senses: tuple[Senses, ...] = (IDEAL,)
    """One after the other, for every configuration."""
    duration: float = 60.0
    aggression: int = 1
    wait: float = 1.5
    left_out: int = 0
    """How many more configurations were asked for, in which nobody could stop."""

    def __post_init__(self) -> None:
        entrances, total = self.entrances, count_classes(self.entrances)
        for number in self.classes or ():
            if not 1 <= number <= total:
                raise ScenarioError(f"a {self.place.ways}-way junction has classes 1..{total}, got {number!r}")
        if self.subject not in (None, "all", *range(entrances)):
            raise ScenarioError(f"subject must be an entrance, 0 to {entrances - 1}, or 'all', got {self.subject!r}")

    @property
    def entrances(self) -> int:
        """Number of entrances."""
        return len(self.place.entrances)

    def count(self) -> int:
        """Return how many abstract scenarios (rows and seats) are selected, without listing a whole arity."""
        if self.classes is None and self.scenarios is None:
            seats_each = self.entrances if self.subject == "all" else 1
            if self.cover == "rotation":
                return count_classes(self.entrances) * self.entrances * seats_each
            if self.cover == "scenario":
                return count_scenarios(self.entrances) * seats_each
            # By symmetry there are as many classes of (scenario, seat) as scenarios.
            return count_classes(self.entrances) if self.subject is None else count_scenarios(self.entrances)
        return sum(len(self._seated(first)) for first in self._firsts())

    def __iter__(self) -> Iterator[Scenario]:
        """Yield the scenarios, class by class, row by row, configuration by configuration."""
        for first in self._firsts():
            for row, subject in self._seated(first):
                for configuration, senses in product(self.configurations, self.senses):
                    yield Scenario(
                        self.place,
                        first,
                        distance=configuration.distances,
                        speed=configuration.speeds,
                        rotation=row,
                        configuration=configuration.label,
                        duration=self.duration,
                        aggression=self.aggression,
                        wait=self.wait,
                        subject=subject,
                        senses=senses,
                    )

    def _firsts(self) -> Iterator[Directions]:
        """Yield the scenario at row 0 of every selected class."""
        if self.scenarios is not None:
            yield from self.scenarios
            return
        wanted = None if self.classes is None else frozenset(self.classes)
        for number, code in enumerate(classes(self.entrances), start=1):
            if wanted is None or number in wanted:
                yield code
            if wanted is not None and number >= max(wanted):
                return

    def _seated(self, first: Directions) -> list[tuple[int, int | None]]:
        """Return rows and the entrance of the subject there.

        With a subject, ``cover="class"`` runs every class of (scenario, seat) once: where the seat is fixed the scenario is
        rotated through it, else the seat moves.
        """
        if self.subject is None:
            return [(row, None) for row in self._rows(first)]
        if self.subject == "all":
            if self.cover == "class":
                return [(0, seat) for seat in seats(first)]
            return [(row, seat) for row in self._rows(first) for seat, d in enumerate(rotate(first, row)) if d]
        seat = int(self.subject)
        rows = range(len(members(first))) if self.cover == "class" and self.scenarios is None else self._rows(first)
        return [(row, seat) for row in rows]

    def _rows(self, first: Directions) -> Sequence[int]:
        if self.cover == "class":
            return (0,)
        rows = rotations(first)
        if self.cover == "rotation":
            return range(len(rows))
        return [rows.index(member) for member in members(first)]

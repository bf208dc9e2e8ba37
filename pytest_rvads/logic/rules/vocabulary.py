"""Words: what a predicate or an attribute of the rule language is, in one value; and vocabularies of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.blame import Cause
from pytest_rvads.conduct.blocks import Signal
from pytest_rvads.errors import FormulaError, suggest
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.current import PACKAGE, here
from pytest_rvads.logic.rules.sameness import same
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.runs.run import Run

__all__ = ["MEASURED", "Attribute", "Follower", "FromZones", "Measured", "Names", "Vocabulary", "Word", "sorts_in"]

Follower = Callable[[Run], bool]
"""Reads a run of one state, the next one, and returns whether something holds there."""

_RESERVED = ("G", "F", "N", "X", "U", "W", "R", "true", "false")
"""What formulas read as an operator or a constant."""
T = TypeVar("T")


class Measured(StrEnum):
    """What the truth of a word turns on and is known only within an accuracy, in words that follow "hangs on"."""

    SIZES = "how near bodies came"
    SIDES = "how far beside its way it was"
    PACE = "how fast it was"
    ALONG = "how far it had come"
    ALONE = "how far it had come on its way"
    """Takes the place of `ALONG` in instances about one vehicle."""
    BEFORE = "what it did before it was seen"


MEASURED = (Measured.SIZES, Measured.SIDES, Measured.PACE, Measured.ALONG)
"""What users' words turn on, as far as anybody knows."""


class FromZones(Enum):
    """Whether a truth or a value follows from the zones of vehicles alone."""

    NEVER = "never"
    BLIND = "in runs without positions or speeds"
    ALWAYS = "always"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Word:
    """A predicate of the rule language.

    Raises:
        FormulaError: a name that formulas can't spell, an unknown sort, or words that ask for more arguments.
    """

    name: str
    sorts: tuple[str, ...]
    """Of every argument the sort, or several: ``"entrance or vertex"``."""
    holds: Callable[..., NDArray[np.bool_]] | None = None
    """On a whole run: takes the run and per argument its number (the column of an agent, the number of an entrance, exit or
    light), or the element itself where it may be of several sorts, and returns the truth per state, shape ``(steps,)``. None
    where no run is ever asked."""
    says: str = ""
    """In words, with the arguments by number: ``"{0} has stopped at the line"``. Empty: as it is written."""
    denies: str = ""
    """The same of its negation."""
    follow: Callable[..., Follower] | None = None
    """State by state, where states before count: takes a run of the first state and the same numbers as `holds`."""
    decide: Callable[..., bool | None] | None = None
    """By the static model: takes it and the arguments, and returns the truth, or None where that changes during a run."""
    static: str = ""
    """Sorts of the first argument for which it is the same in every state."""
    means: Callable[..., f.Formula] | None = None
    """Takes the arguments, and whether itineraries are known, and returns the formula that it stands for."""
    apart: bool = False
    """Whether nothing is in this relation to itself."""
    symmetric: bool = False
    """Whether both orders of its two arguments say the same."""
    turns_on: tuple[Measured, ...] = MEASURED
    """What its truth turns on, of what is known only within an accuracy."""
    from_zones: FromZones = FromZones.NEVER
    """Whether its truth follows from zones alone."""
    present: bool = False
    """Whether it holds of no vehicle that is absent."""
    debt: bool = False
    """Whether it is about the way that its first argument owes to its second argument."""
    cause: Callable[[Run, int, int, int], Cause | None] | None = None
    """Who is to blame where it breaks a rule about two vehicles: takes the run, the columns of the two, and the tick."""
    pending: Callable[..., NDArray[np.bool_]] | None = None
    """Where it may become true soon after, so that a run that ends there leaves it open; takes what `holds` takes."""
    beyond: Callable[[Run, int], bool] | None = None
    """Whether no driver could have kept it false; takes the run and the column of its vehicle."""
    bends: bool = False
    """Whether a bend through which no path keeps a vehicle in its lane may be why it holds."""
    place: str = ""
    """Where it was registered; by default the line that makes it."""

    def __post_init__(self) -> None:
        if self.place == PACKAGE:
            return
        if not self.place:
            object.__setattr__(self, "place", here())
        if not isinstance(self.name, str) or not self.name.isidentifier() or self.name in _RESERVED:
            raise FormulaError(f"a predicate needs a free identifier as its name, got {self.name!r}")
        for sort in (sort for sorts in self.sorts for sort in sorts_in(sorts)):
            if sort not in set(Sort):
                raise FormulaError(f"predicate {self.name!r}: unknown sort {sort!r}{suggest(sort, [s.value for s in Sort])}")
        for text in (self.says, self.denies):
            try:
                text.format(*self.sorts)
            except (AttributeError, LookupError, TypeError, ValueError) as error:
                raise FormulaError(
                    f"predicate {self.name!r}: words name its {len(self.sorts)} arguments by number, {{0}} the first, "
                    f"got {text!r}"
                ) from error

    def __eq__(self, other: object) -> bool:
        return self is other or (
            isinstance(other, Word) and self._told() == other._told() and same(self._functions(), other._functions())
        )

    def __hash__(self) -> int:
        return hash(self.name)

    def __repr__(self) -> str:
        return f"<Word {self.name}>"

    def _told(self) -> tuple[object, ...]:
        told = self.name, self.sorts, self.says, self.denies, self.static, self.apart, self.symmetric
        return *told, self.turns_on, self.from_zones, self.present, self.debt, self.bends

    def _functions(self) -> tuple[object, ...]:
        return self.holds, self.follow, self.decide, self.means, self.cause, self.pending, self.beyond

    def on(self, run: Run, *arguments: int | f.Element) -> NDArray[np.bool_]:
        """Return its truth on a run, shape ``(steps,)``.

        Raises:
            FormulaError: the word has no function, or its function returns another shape or type.
        """
        if self.holds is None:
            raise FormulaError(f"nothing tells the value of {self.name} on a run")
        truths = np.asarray(self.holds(run, *arguments))
        if truths.shape != (run.steps,) or truths.dtype != np.bool_:
            raise FormulaError(
                f"predicate {self.name!r} must return one bool per state, shape ({run.steps},), "
                f"got {truths.dtype} of shape {truths.shape}"
            )
        return truths

    def arguments(self, atom: f.Atom) -> tuple[int | f.Element, ...]:
        """Return the arguments of a ground atom as the functions of the word take them."""
        pairs = zip(atom.terms, self.sorts, strict=True)
        return tuple(t if " " in sorts else t.index for t, sorts in pairs if isinstance(t, f.Element))


@dataclass(frozen=True, slots=True)
class Attribute:
    """What comparisons ask of an element: its waiting time, its speed, its colour."""

    name: str
    owner: str
    """The sort that has it."""
    kind: str
    """What its values are: ``"number"``, or a kind of named values."""
    read: Signal[NDArray[Any]]
    """The values of all vehicles, or of the lights at all entrances."""
    codes: Callable[[str], int] | None = None
    """Of named values: the number that stands for a name in what `read` returns."""
    waited: bool = False
    """Whether it counts ticks, and a difference within the tie window of a rule is none."""
    from_zones: FromZones = FromZones.NEVER
    """Whether its values follow from zones alone."""
    standing: Callable[[Run, int], NDArray[Any]] | None = None
    """Takes the place of `read` where waiting times count from standstill, see `check`."""
    says: tuple[tuple[str, str, str], ...] = ()
    """Comparisons in words, and denied: ``"="`` with the same attribute of another element, ``"= value"`` with a value."""


class Names(Mapping[str, T]):
    """What names stand for; nobody adds to it."""

    __slots__ = ("_known",)

    def __init__(self, known: Mapping[str, T]) -> None:
        self._known = dict(known)

    def __getitem__(self, name: str) -> T:
        return self._known[name]

    def __contains__(self, name: object) -> bool:
        return name in self._known

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)

    def __hash__(self) -> int:
        return hash(frozenset(self._known))

    def __repr__(self) -> str:
        return f"<Names: {', '.join(self)}>"


class Vocabulary(Names[Word]):
    """The predicates that rules may use, by name."""

    __slots__ = ()

    @classmethod
    def of(cls, *words: Word) -> Vocabulary:
        """Return a vocabulary of the given words."""
        return cls({word.name: word for word in words})

    def __repr__(self) -> str:
        return f"<Vocabulary of {len(self)} words>"

    def add(self, word: Word) -> Vocabulary:
        """Return a vocabulary with another word.

        Raises:
            FormulaError: its name means something else already.
        """
        known = self.get(word.name)
        if known is None:
            return Vocabulary({**self, word.name: word})
        if known.place == PACKAGE:
            raise FormulaError(f"{word.name!r} is a shipped word, not to be changed at {word.place}: choose another name")
        if known != word:
            raise FormulaError(
                f"{word.name!r} is registered at {known.place} and says something else at {word.place}: "
                "give each a name of its own"
            )
        return self


def sorts_in(sorts: str) -> list[str]:
    """Return the sorts that ``"entrance or vertex"`` names."""
    return sorts.split(" or ")

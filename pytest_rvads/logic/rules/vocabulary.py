"""Words, the definitions of predicates and attributes of the rule language, and vocabularies of words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blame import Cause
from pytest_rvads.logic.conduct.blocks import Signal
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.current import PACKAGE, here
from pytest_rvads.logic.rules.sameness import same
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import FormulaError, suggest

__all__ = ["MEASURED", "Attribute", "Follower", "FromZones", "Measured", "Names", "Vocabulary", "Word", "sorts_in"]

Follower = Callable[[Run], bool]
"""Reads the next state, given as a run of one state, and returns the truth value of the predicate there."""

_RESERVED = ("G", "F", "N", "X", "U", "W", "R", "true", "false")
"""Names that formulas read as an operator or a constant."""
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
"""The kinds of measurement on which a user's word depends unless the word states its kinds: all of them."""


class FromZones(Enum):
    """Whether a truth or a value follows from the zones of vehicles alone."""

    NEVER = "never"
    BLIND = "in runs without positions or speeds"
    ALWAYS = "always"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Word:
    """A predicate of the rule language.

    Raises:
        FormulaError: formulas can't spell the name, a sort is unknown, or `says` or `denies` refer to more arguments than exist.
    """

    name: str
    sorts: tuple[str, ...]
    """Sort of every argument, or several sorts: ``"entrance or vertex"``."""
    holds: Callable[..., NDArray[np.bool_]] | None = None
    """The predicate on a whole run; None if the predicate is never evaluated on a run.

    The function takes the run and, per argument, its number (the column of an agent, the number of an entrance, exit or light).
    An argument of several sorts is given as its element. The function returns the truth per state, shape ``(steps,)``.
    """
    says: str = ""
    """The predicate in words, with the arguments by number: ``"{0} has stopped at the line"``. Empty: as formulas spell it."""
    denies: str = ""
    """The negated predicate in words."""
    follow: Callable[..., Follower] | None = None
    """For predicates that depend on earlier states: makes a `Follower` from a run of the first state and the arguments."""
    decide: Callable[..., bool | None] | None = None
    """The predicate on the static model: takes the model and the arguments, returns the truth, or None if it changes in a run."""
    static: str = ""
    """Sorts of the first argument for which the predicate has the same value in every state."""
    means: Callable[..., f.Formula] | None = None
    """The definition: takes the arguments, and whether itineraries are known, and returns the defining formula."""
    apart: bool = False
    """Whether the predicate is false for two equal arguments."""
    symmetric: bool = False
    """Whether the predicate has the same value for both orders of its two arguments."""
    turns_on: tuple[Measured, ...] = MEASURED
    """The kinds of measurement on which the truth depends."""
    from_zones: FromZones = FromZones.NEVER
    """Whether the truth follows from zones alone."""
    present: bool = False
    """Whether the predicate is false for absent vehicles."""
    debt: bool = False
    """Whether the predicate is about the way that the first argument owes to the second argument."""
    cause: Callable[[Run, int, int, int], Cause | None] | None = None
    """The vehicle to blame if the predicate breaks a rule about two vehicles; takes run, both columns, and tick."""
    pending: Callable[..., NDArray[np.bool_]] | None = None
    """The states in which the predicate may still become true, so that a run that ends there is unsure; arguments as `holds`."""
    beyond: Callable[[Run, int], bool] | None = None
    """Whether no driver could have kept the predicate false; takes the run and the column of the vehicle."""
    bends: bool = False
    """Whether a bend without a path that keeps a vehicle in its lane may make the predicate true."""
    any_way: bool = False
    """Whether the predicate is about agents on any way; variables of other predicates stand for agents on movements only."""
    place: str = ""
    """File and line of the registration; by default the line that makes the word."""

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
            isinstance(other, Word) and self._properties() == other._properties() and same(self._functions(), other._functions())
        )

    def __hash__(self) -> int:
        return hash(self.name)

    def __repr__(self) -> str:
        return f"<Word {self.name}>"

    def _properties(self) -> tuple[object, ...]:
        wording = self.name, self.sorts, self.says, self.denies, self.static, self.apart, self.symmetric
        return *wording, self.turns_on, self.from_zones, self.present, self.debt, self.bends, self.any_way

    def _functions(self) -> tuple[object, ...]:
        return self.holds, self.follow, self.decide, self.means, self.cause, self.pending, self.beyond

    def on(self, run: Run, *arguments: int | f.Element) -> NDArray[np.bool_]:
        """Return the truth values of the predicate on a run, shape ``(steps,)``.

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
        """Return the arguments of a ground atom in the form that the functions of the word take."""
        pairs = zip(atom.terms, self.sorts, strict=True)
        return tuple(t if " " in sorts else t.index for t, sorts in pairs if isinstance(t, f.Element))


@dataclass(frozen=True, slots=True)
class Attribute:
    """An attribute of an element that comparisons use: its waiting time, its speed, its colour."""

    name: str
    owner: str
    """The sort of the elements with this attribute."""
    kind: str
    """The kind of its values: ``"number"``, or a kind of named values."""
    read: Signal[NDArray[Any]]
    """The signal with the values of all vehicles, or of the lights at all entrances."""
    codes: Callable[[str], int] | None = None
    """For named values: maps a name to the number that stands for it in the values of `read`."""
    waited: bool = False
    """Whether the attribute counts ticks, so that values within the tie window of a rule are equal."""
    from_zones: FromZones = FromZones.NEVER
    """Whether the values follow from zones alone."""
    standing: Callable[[Run, int], NDArray[Any]] | None = None
    """Used instead of `read` where waiting times count from standstill, see `check`."""
    says: tuple[tuple[str, str, str], ...] = ()
    """Comparisons in words, affirmed and denied: ``"="`` with the attribute of another element, ``"= value"`` with a value."""


class Names(Mapping[str, T]):
    """An immutable mapping from names to values."""

    __slots__ = ("_values",)

    def __init__(self, values: Mapping[str, T]) -> None:
        self._values = dict(values)

    def __getitem__(self, name: str) -> T:
        return self._values[name]

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __hash__(self) -> int:
        return hash(frozenset(self._values))

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
        """Return a vocabulary with a further word.

        Raises:
            FormulaError: the name of the word has another meaning already.
        """
        registered = self.get(word.name)
        if registered is None:
            return Vocabulary({**self, word.name: word})
        if registered.place == PACKAGE:
            raise FormulaError(f"{word.name!r} is a shipped word, not to be changed at {word.place}: choose another name")
        if registered != word:
            raise FormulaError(
                f"{word.name!r} is registered at {registered.place} and says something else at {word.place}: "
                "give each a name of its own"
            )
        return self


def sorts_in(sorts: str) -> list[str]:
    """Return the list of sorts in a text such as ``"entrance or vertex"``."""
    return sorts.split(" or ")

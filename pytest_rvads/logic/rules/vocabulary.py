"""The language of rules: the sorts of variables with the paper's letters, the names of values, and vocabularies.

A vocabulary maps names to words. A word is the definition of a predicate. Two words are equal if `same` finds their functions the
same. Therefore a module that is loaded twice may register a predicate twice. Atoms compare words by identity, because atoms are
keys of caches.
"""

from __future__ import annotations

import dis
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, StrEnum
from operator import attrgetter
from types import CellType, CodeType, FunctionType, MethodType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blame import Cause
from pytest_rvads.logic.conduct.blocks import Signal
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.parser import Language
from pytest_rvads.logic.rules.current import PACKAGE, here
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import FormulaError, suggest

Follower = Callable[[Run], bool]
"""A function that is called with every state in turn, as a run of a single state, and returns the truth of a predicate."""

_RESERVED = ("G", "F", "N", "X", "U", "W", "R", "true", "false")
"""Names that can't be names of predicates, because formulas read them as operators or constants."""
T = TypeVar("T")


class Sort(StrEnum):
    """The sorts of variables; a variable stands for the elements of its sort (agents, entrances, ...) at the junction."""

    AGENT = "agent"
    LIGHT = "light"
    OBJECT = "object"
    ROAD = "road"
    JUNCTION = "junction"
    ENTRANCE = "entrance"
    EXIT = "exit"
    VERTEX = "vertex"


DIRECTIONS = ("left", "straight", "right", "near", "far")
COLOURS = ("green", "yellow", "red")

LANGUAGE = Language(
    sorts=tuple(Sort),
    letters={
        "a": Sort.AGENT,
        "lt": Sort.LIGHT,
        "o": Sort.OBJECT,
        "r": Sort.ROAD,
        "j": Sort.JUNCTION,
        "v": Sort.VERTEX,
        "j.en": Sort.ENTRANCE,
        "j.ex": Sort.EXIT,
        "r.en": Sort.VERTEX,
        "r.ex": Sort.VERTEX,
    },
    values=(*DIRECTIONS, *COLOURS),
    relations=("right-of", "opposite", "entex"),
    keywords=("take", "turn"),
)
"""The language of rules, with the letters of the paper (section 5.1)."""


class Measured(StrEnum):
    """Kinds of measurement with limited accuracy on which the truth of a predicate depends.

    The value of a kind is a phrase that reports show after the words "it depends on".
    """

    SIZES = "how near bodies came"
    SIDES = "how far beside its way it was"
    PACE = "how fast it was"
    ALONG = "how far it had come"
    ALONE = "how far it had come on its way"
    """The kind that replaces `ALONG` in instances about a single vehicle."""
    BEFORE = "what it did before it was seen"
    COLOURS = "a colour of a light that was not recorded"


MEASURED = (Measured.SIZES, Measured.SIDES, Measured.PACE, Measured.ALONG)
"""The kinds of measurement on which a user's predicate depends, if the user does not state the kinds."""


class RightOfWay(Enum):
    """What a predicate says about the right of way of its second argument over its first argument."""

    OWED = "the first has to give way to the second"
    TAKEN = "the first gets in the way of the second; as long as it owes the way in the junction, it still can"


class TightBend(Enum):
    """What a bend in which no path keeps a vehicle in its lane does to a predicate about the vehicle."""

    CAN_CAUSE = "it can make the predicate true"
    EXCUSES = "it can make the predicate true, and then no driver could have kept the predicate false"


class FromZones(Enum):
    """In which runs the truth of a predicate, or the value of an attribute, follows from the zones of vehicles alone."""

    NEVER = "never"
    BLIND = "in runs without positions or speeds"
    ALWAYS = "always"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Word:
    """A word: the definition of a predicate of the rule language.

    Raises:
        FormulaError: the name is no identifier or is reserved, a sort is unknown, or `says` or `denies` contains the number of an
            argument that does not exist.
    """

    name: str
    """The name of the predicate in formulas."""
    sorts: tuple[str, ...]
    """Per argument, its sort or the sorts that it can have: ``"entrance or vertex"``."""
    holds: Callable[..., NDArray[np.bool_]] | None = None
    """The predicate on a whole run; None if the predicate is never evaluated on a run.

    The function takes the run and, per argument, its number (the column of an agent, the number of an entrance, exit or light).
    An argument of several sorts is given as its element. The function returns the truth per state, shape ``(steps,)``.
    """
    says: str = ""
    """The predicate in words, with its arguments by number: ``"{0} has stopped at the line"``. Empty: texts show the formula."""
    denies: str = ""
    """The negated predicate in words, in the same form."""
    follow: Callable[..., Follower] | None = None
    """A function that makes a `Follower` from a run of the first state and the arguments; for live monitors of predicates that
    depend on earlier states."""
    decide: Callable[..., bool | None] | None = None
    """A function that takes the static model (junction and agents, without states) and the arguments. The function returns the
    truth of the predicate in all states, or None if the static model does not decide the predicate."""
    static: str = ""
    """Sorts of the first argument for which the predicate has the same value in every state."""
    means: Callable[..., f.Formula] | None = None
    """A function that returns the formula by which the predicate is defined, given the arguments and whether itineraries are
    known."""
    symmetric: bool = False
    """Whether the predicate has the same value for both orders of its two arguments, and is false for two equal arguments."""
    turns_on: tuple[Measured, ...] = MEASURED
    """The kinds of measurement on which the truth depends."""
    from_zones: FromZones = FromZones.NEVER
    """In which runs the truth follows from the zones of vehicles alone."""
    present: bool = False
    """Whether the predicate is false for absent vehicles."""
    debt: RightOfWay | None = None
    """What the predicate says about the right of way between its two arguments; None if it says nothing about it."""
    cause: Callable[[Run, int, int, int], Cause | None] | None = None
    """A function that takes a run, the columns of two vehicles and a tick, and returns the vehicle to blame if the predicate
    about the two vehicles breaks a rule at the tick."""
    bend: TightBend | None = None
    """What a bend in which no path keeps a vehicle in its lane does to the predicate; None if nothing."""
    any_way: bool = False
    """Whether the predicate allows agents on any way, such as a crossing; other predicates allow agents on movements only."""
    place: str = ""
    """File and line of the registration; by default the line that creates the word."""

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
        if self is other or not isinstance(other, Word):
            return self is other
        alike = _WORDING(self) == _WORDING(other) and _TRAITS(self) == _TRAITS(other)
        return alike and same(_FUNCTIONS(self), _FUNCTIONS(other))

    def __hash__(self) -> int:
        return hash(self.name)

    def __repr__(self) -> str:
        return f"<Word {self.name}>"

    def on(self, run: Run, *arguments: int | f.Element) -> NDArray[np.bool_]:
        """Return the truth values of the predicate on a run, shape ``(steps,)``.

        Raises:
            FormulaError: the predicate has no function, or its function returns another shape or type.
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
        """Return the arguments of an atom without variables in the form that `holds` takes."""
        pairs = zip(atom.terms, self.sorts, strict=True)
        return tuple(t if " " in sorts else t.index for t, sorts in pairs if isinstance(t, f.Element))


_WORDING = attrgetter("name", "sorts", "says", "denies", "static", "symmetric")
_TRAITS = attrgetter("turns_on", "from_zones", "present", "debt", "bend", "any_way")
_FUNCTIONS = attrgetter("holds", "follow", "decide", "means", "cause")


@dataclass(frozen=True, slots=True)
class Attribute:
    """An attribute of a vehicle or light, such as a waiting time, a speed or a colour, that rules compare with other values."""

    name: str
    owner: str
    """The sort of the elements with this attribute."""
    kind: str
    """The kind of the values of the attribute: ``"number"``, or a kind of named values."""
    read: Signal[NDArray[Any]]
    """The signal with the values of all vehicles, or of the lights at all entrances."""
    codes: Callable[[str], int] | None = None
    """A function that returns the number that stands for a named value in the values of `read`; None for numbers."""
    waited: bool = False
    """Whether the attribute counts ticks, so that values within the tie window of a rule are equal."""
    from_zones: FromZones = FromZones.NEVER
    """In which runs the values follow from the zones of vehicles alone."""
    standing: Callable[[Run, int], NDArray[Any]] | None = None
    """The function that replaces `read` if waiting times count from standstill, see `check`; takes a run and a column."""
    says: tuple[tuple[str, str, str], ...] = ()
    """Triples of a comparison, its words, and the words of its negation. The comparison ``"="`` compares the attribute with the
    attribute of another element, ``"= value"`` compares the attribute with a named value."""


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
        """Return a vocabulary of the given words (definitions of predicates)."""
        return cls({word.name: word for word in words})

    def __repr__(self) -> str:
        return f"<Vocabulary of {len(self)} words>"

    def add(self, word: Word) -> Vocabulary:
        """Return a vocabulary with a further word (definition of a predicate)."""
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


_PLAIN = (bool, int, float, complex, str, bytes)
_UNBOUND = object()
_UNSEEN = {"globals", "eval", "exec", "locals", "vars", "__import__"}
"""Builtins by which a function reaches values that its code does not name."""
_IMPORT = dis.opmap["IMPORT_NAME"]


def same(value: object, other: object) -> bool:
    """Return whether two functions, or two values that functions work with, are the same.

    Two functions are the same if their code (apart from line numbers), their defaults, attributes, closures and globals are the
    same. Two functions with import statements must belong to the same package as well. Two different objects are not the same,
    apart from numbers, strings, tuples and methods, because their contents can change later.
    """
    try:
        return _same(value, other, set())
    except RecursionError:  # the functions call functions that call functions, too deeply to compare
        return False


def _same(value: object, other: object, assumed: set[tuple[int, int]]) -> bool:
    if value is other:
        return True
    match value, other:
        case FunctionType(), FunctionType():
            if (id(value), id(other)) in assumed:  # their comparison has begun: functions can be recursive
                return True
            assumed.add((id(value), id(other)))
            return _bare(value.__code__) == _bare(other.__code__) and _same(_works_with(value), _works_with(other), assumed)
        case MethodType(), MethodType():
            return value.__self__ is other.__self__ and _same(value.__func__, other.__func__, assumed)
        case tuple(), tuple() if type(value) is type(other) is tuple:
            return len(value) == len(other) and all(_same(a, b, assumed) for a, b in zip(value, other, strict=True))
    return type(value) is type(other) and type(value) in _PLAIN and value == other


def _works_with(function: FunctionType) -> tuple[object, ...]:
    """Return the values that a function uses besides its arguments, in an order that its code determines."""
    named = (function.__kwdefaults__ or {}, vars(function))
    cells = tuple(content(cell) for cell in function.__closure__ or ())
    inner = tuple(codes(function.__code__))
    used = dict.fromkeys(name for code in inner for name in code.co_names)
    values = tuple(function.__globals__.get(name, _UNBOUND) for name in used)
    unseen = None if _UNSEEN.isdisjoint(used) else object()  # an object that equals no other object
    package = function.__globals__.get("__package__") if any(_IMPORT in code.co_code[::2] for code in inner) else None
    return function.__defaults__, tuple(tuple(sorted(values.items())) for values in named), cells, values, unseen, package


def content(cell: CellType) -> object:
    """Return the value in a cell of a function's closure; for an empty cell, the cell itself."""
    try:
        return cell.cell_contents
    except ValueError:  # the cell is empty
        return cell


def codes(code: CodeType) -> Iterator[CodeType]:
    """Yield a code object and the code objects of its inner functions."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from codes(constant)


def _bare(code: CodeType) -> CodeType:
    """Return a code object without its file and line numbers."""
    constants = tuple(_bare(constant) if isinstance(constant, CodeType) else constant for constant in code.co_consts)
    return code.replace(co_filename="", co_firstlineno=1, co_linetable=b"", co_consts=constants)

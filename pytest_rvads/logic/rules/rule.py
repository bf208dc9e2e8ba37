"""A rule: a formula of first-order temporal logic with its title, meaning, source and scope."""

from __future__ import annotations

from dataclasses import dataclass, field

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.current import PACKAGE, desk, here
from pytest_rvads.logic.rules.lexicon import BUILT_IN
from pytest_rvads.logic.rules.shape import outermost, untimed
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.logic.rules.vocabulary import Vocabulary, Word
from pytest_rvads.support.errors import FormulaError
from pytest_rvads.support.wording import one_line

__all__ = ["LONGEST_TIE", "Rule"]

LONGEST_TIE = 3600
"""Longest tie window [s]; a window of an hour makes all waiting times at a junction equal."""
_LONGEST_NAME = 100


@dataclass(frozen=True, slots=True, repr=False)
class Rule:
    """A traffic rule.

    A rule holds its formula and the words of the formula, so later registrations do not change its verdicts.

    Raises:
        FormulaError: the text is not a formula, the name does not fit into a test id, or a word has the name of a shipped word or
            of another word.
    """

    name: str
    text: str
    """The formula."""
    title: str = ""
    """The title of the rule, such as ``right-of-way``."""
    meaning: str = ""
    """The meaning of the rule, one sentence of English."""
    source: str = ""
    """The source: paper, convention or statute, with the article."""
    responsible: str = ""
    """The role that is bound to act, in words."""
    bound: tuple[str, ...] = ()
    """The variables of that role; by default those of the agents that have to wait, else of the agents of the obligation."""
    about: JunctionControl | tuple[JunctionControl, ...] | None = None
    """The kind or kinds of junction that the rule is about; None for all."""
    lanes: bool = False
    """Whether the rule is only about junctions where an arm has several entrances."""
    joining: bool = False
    """Whether the rule is only about junctions where, according to the map, a lane joins another lane."""
    tie: float = 0.0
    """Largest difference of waiting times that count as equal [s]."""
    companions: tuple[str, ...] = ()
    """Names of rules of the same rulebook whose obligations can contradict the obligations of this rule."""
    requirement: str | None = None
    """Identifier of the requirement that the rule traces to."""
    words: tuple[Word, ...] = ()
    """The users' predicates in the formula; by default those of the open book."""
    place: str = field(default="", compare=False)
    """File and line of the registration; by default the line that makes the rule."""
    _formula: f.Formula | None = field(default=None, init=False, compare=False)

    def __post_init__(self) -> None:
        if not (0 < len(self.name) <= _LONGEST_NAME and all(c.isascii() and (c.isalnum() or c in "_.-") for c in self.name)):
            raise FormulaError(
                f"the name of a rule goes into test ids, so it must consist of A-Z a-z 0-9 _ . -, at most {_LONGEST_NAME} of "
                f"them, got {self.name!r:.60}"
            )
        if not (isinstance(self.tie, int | float) and 0 <= self.tie <= LONGEST_TIE):
            raise FormulaError(
                f"rule {self.name!r}: the tie window must be a number of seconds from 0 to {LONGEST_TIE:,}, got {self.tie!r:.60}"
            )
        if not self.place:
            object.__setattr__(self, "place", here())
        if self.place != PACKAGE:  # shipped rules are parsed at their first use; most of them are never used
            self._read()

    @property
    def formula(self) -> f.Formula:
        """The parsed formula."""
        return self._formula or self._read()

    @property
    def kinds(self) -> tuple[JunctionControl, ...]:
        """The kinds of junction that the rule is about."""
        if self.about is None:
            return tuple(JunctionControl)
        return (self.about,) if isinstance(self.about, JunctionControl) else self.about

    def concerns(self, place: Junction | JunctionControl) -> bool:
        """Return whether the rule is about a junction, or about junctions with one lane per arm and a kind of control."""
        if isinstance(place, JunctionControl):
            return place in self.kinds and not (self.lanes or self.joining)
        fits = (not self.lanes or max(place.lanes) > 1) and (not self.joining or bool(place.joining))
        return place.control in self.kinds and fits

    def _read(self) -> f.Formula:
        """Parse the text, store the formula and its words, and return the formula."""
        from pytest_rvads.logic.rules.reading import parse  # takes a parser generator, which collecting tests does not need

        try:
            formula = parse(self.text, self._vocabulary())
        except FormulaError as error:
            raise FormulaError(f"rule {self.name!r}: {error}") from None
        object.__setattr__(self, "_formula", formula)
        object.__setattr__(self, "words", tuple({a.word: None for a in f.atoms(formula) if isinstance(a.word, Word)}))
        agents = [v.name for v in outermost(formula) if v.sort == Sort.AGENT]
        for name in self.bound:
            if name not in agents:
                raise FormulaError(
                    f"rule {self.name!r}: bound must name agents that its outermost quantifiers bind "
                    f"({', '.join(agents) or 'none'}), got {name!r}"
                )
        momentary = untimed(formula)
        if momentary is not None:
            raise FormulaError(
                f"rule {self.name!r} asks for {momentary} in the first state only, outside every temporal operator: "
                "write G(...) around what always has to hold"
            )
        return formula

    def _vocabulary(self) -> Vocabulary:
        known = BUILT_IN if desk().book is None else desk().book.vocabulary
        given = BUILT_IN
        for word in self.words:
            given = given.add(word)
        return Vocabulary({**known, **given}) if self.words else known

    def __repr__(self) -> str:
        return f"<Rule {self.name}: {one_line(self.title or self.text)}>"

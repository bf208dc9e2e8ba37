"""Rules: formulas of first-order temporal logic with title, meaning, source and scope, and the parts of these formulas.

The text of a rule is parsed and checked: every variable is bound, every predicate is known, every term has the right sort. The
formula is taken apart into the premise, the obligation, the vehicles that wait, and the event that the vehicles await. An example
is ``G(premise -> waits U goes)``: the obligation ``waits U goes`` holds while a vehicle waits, until the event comes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.crosswalks import Crossing
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import conj, replaced
from pytest_rvads.logic.ltl.parser import caret, parse_rule
from pytest_rvads.logic.rules.current import PACKAGE, desk, here
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, BUILT_IN, word_of
from pytest_rvads.logic.rules.vocabulary import DIRECTIONS, LANGUAGE, Sort, Vocabulary, Word, sorts_in
from pytest_rvads.support.errors import FormulaError, suggest
from pytest_rvads.support.wording import one_line

LONGEST_TIE = 3600
"""Longest tie window [s]; a window of an hour makes all waiting times at a junction equal."""
_LONGEST_NAME = 100
"""Greatest length of the name of a rule [characters]."""
_COMPARISONS = ("=", "!=", "<", "<=", ">", ">=")
_VERTICES = {Sort.ENTRANCE, Sort.EXIT, Sort.VERTEX}


class Form(StrEnum):
    """The forms that the formula of a rule can have."""

    YIELD = "yield"
    """``G(t -> (N w) U g)``: whenever t holds, w must hold from the next state on, up to and including the state in which g comes
    to hold."""
    HOLD = "hold"
    """``G(t -> w U g)`` or ``G(t -> w W g)``: whenever t holds, w must hold in all states before the state in which g comes to
    hold."""
    STATE = "state"
    """``G c`` or ``G(t -> c)`` with no temporal operator inside: a condition on every single state."""
    OTHER = "other"
    """Any other form."""


@dataclass(frozen=True, slots=True)
class Shape:
    """The parts of an instance of a rule (the rule for certain vehicles and entrances)."""

    form: Form
    premise: f.Formula | None
    """The condition of the obligation; None if the instance does not have the form ``G(premise -> obligation)``."""
    obligation: f.Formula
    waits: f.Formula | None = None
    """The formula w of the forms YIELD and HOLD, which holds while a vehicle waits."""
    goes: f.Formula | None = None
    """The formula g of the forms YIELD and HOLD, the awaited event."""


def shape_of(formula: f.Formula) -> Shape:
    """Return the premise, obligation and further parts of a rule's formula; outermost universal quantifiers are skipped."""
    while isinstance(formula, f.Forall):
        formula = formula.body
    if not isinstance(formula, f.Always):
        return Shape(Form.OTHER, None, formula)
    premise, obligation = None, formula.body
    if isinstance(formula.body, f.Implies):
        premise, obligation = formula.body.left, formula.body.right
    match obligation:
        case f.Until(f.Next(waits), goes) if f.is_boolean(waits) and f.is_boolean(goes):
            return Shape(Form.YIELD, premise, obligation, waits, goes)
        case f.Until(waits, goes) | f.WeakUntil(waits, goes) if f.is_boolean(waits) and f.is_boolean(goes):
            return Shape(Form.HOLD, premise, obligation, waits, goes)
    return Shape(Form.STATE if f.is_boolean(formula.body) else Form.OTHER, premise, obligation)


def split(formula: f.Formula) -> tuple[f.Formula, ...]:
    """Return the formulas whose conjunction is a formula ``G(t -> ...)``; other formulas are not split.

    ``G(t -> (p & (q -> r)))`` is split into ``G(t -> p)`` and ``G(t & q -> r)``, which get separate verdicts.
    """
    if not (isinstance(formula, f.Always) and isinstance(formula.body, f.Implies)):
        return (formula,)
    premise, obligation = formula.body.left, formula.body.right
    if isinstance(obligation, f.And):
        parts = obligation.parts
        return tuple(g for part in parts for g in split(f.Always(f.Implies(premise, part))))
    if isinstance(obligation, f.Implies):
        return split(f.Always(f.Implies(conj((premise, obligation.left)), obligation.right)))
    return (formula,)


def conjuncts(formula: f.Formula) -> tuple[f.Formula, ...]:
    """Return the parts of a conjunction; of any other formula, the formula itself."""
    return formula.parts if isinstance(formula, f.And) else (formula,)


def agents_of(formula: f.Formula) -> tuple[f.Element, ...]:
    """Return the agents in a formula without variables, in the order of their first occurrence."""
    agents: dict[f.Element, None] = {}
    for atom in f.atoms(formula):
        for term in atom.terms:
            element = term.of if isinstance(term, f.Attr) else term
            if isinstance(element, f.Element) and element.sort == Sort.AGENT:
                agents[element] = None
    return tuple(agents)


def outermost(formula: f.Formula) -> tuple[f.Binder, ...]:
    """Return the variables of the outermost universal quantifiers of a formula."""
    variables: list[f.Binder] = []
    while isinstance(formula, f.Forall):
        variables += formula.variables
        formula = formula.body
    return tuple(variables)


def untimed(formula: f.Formula, sorts: Mapping[str, str] | None = None) -> f.Atom | None:
    """Return an atom that can change in a run but is outside every temporal operator; None if there is no such atom.

    Such an atom is a mistake, because only its value in the first state counts.
    """
    sorts = sorts or {}
    match formula:
        case f.Atom():
            if formula.name in ("=", "!="):
                static = all(isinstance(term, f.Var) for term in formula.terms)
            else:
                word, first = word_of(formula), formula.terms[0] if formula.terms else None
                static = word is not None and isinstance(first, f.Var) and sorts.get(first.name) in sorts_in(word.static)
            return None if static else formula
        case f.Forall(variables, body) | f.Exists(variables, body):
            return untimed(body, {**sorts, **{v.name: v.sort for v in variables}})
        case f.Next() | f.Always() | f.Eventually() | f.Until() | f.WeakUntil() | f.Release():
            return None
    return next((atom for child in f.children(formula) if (atom := untimed(child, sorts))), None)


def parse(text: str, vocabulary: Vocabulary = BUILT_IN) -> f.Formula:
    """Return the formula of a rule's text, after a check that all variables are bound, predicates known and sorts right.

    The variable ``j``, the junction, is always bound.
    """
    formula = parse_rule(text, LANGUAGE)
    _Check(text, vocabulary).formula(formula, {"j": Sort.JUNCTION})
    own_names = vocabulary.keys() - BUILT_IN.keys()

    def filled(atom: f.Atom) -> f.Atom:
        return replace(atom, word=vocabulary[atom.name]) if atom.name in own_names else atom

    return replaced(formula, filled) if own_names else formula


@dataclass(frozen=True, slots=True)
class _Check:
    """Checks that all variables of a formula are bound, its predicates known and the sorts of its terms right."""

    text: str
    vocabulary: Vocabulary

    def formula(self, formula: f.Formula, scope: Mapping[str, str]) -> None:
        if isinstance(formula, f.Atom):
            self.atom(formula, scope)
        elif isinstance(formula, f.Forall | f.Exists):
            names = [v.name for v in formula.variables]
            if len(set(names)) < len(names):
                raise FormulaError(f"a quantifier binds a variable twice: {', '.join(names)}")
            self.formula(formula.body, {**scope, **{v.name: v.sort for v in formula.variables}})
        else:
            for child in f.children(formula):
                self.formula(child, scope)

    def atom(self, atom: f.Atom, scope: Mapping[str, str]) -> None:
        kinds = [self.term(t, scope, atom.at) for t in atom.terms]
        name = atom.name
        if name in _COMPARISONS:
            self.comparison(atom, kinds)
            return
        if name not in self.vocabulary:
            what = f"unknown predicate {name!r}" if atom.terms else f"{name!r} is neither a formula nor a known predicate"
            near = suggest(name, self.vocabulary) or ": register it before the rule, or give the rule its Word by words="
            raise FormulaError(caret(what + near, self.text, atom.at))
        expected = self.vocabulary[name].sorts
        if len(kinds) != len(expected):
            message = f"{name} takes {len(expected)} arguments ({', '.join(expected)}), got {len(kinds)}"
            raise FormulaError(caret(message, self.text, atom.at))
        for term, kind, sorts in zip(atom.terms, kinds, expected, strict=True):
            if kind not in sorts_in(sorts):
                raise FormulaError(caret(f"{atom}: expected {sorts}, got {term}, of sort {kind}", self.text, atom.at))

    def comparison(self, atom: f.Atom, kinds: list[str]) -> None:
        left, right = kinds
        alike = left == right or {left, right} <= _VERTICES
        ordered = atom.name not in ("=", "!=")
        if not alike or (ordered and left != "number"):
            rule = "only numbers have an order" if alike else "both sides must have the same sort"
            raise FormulaError(caret(f"{atom}: can't compare {left} with {right}, {rule}", self.text, atom.at))
        if not any(isinstance(t, f.Attr | f.Var) for t in atom.terms):
            raise FormulaError(caret(f"{atom}: a comparison needs an attribute or a variable", self.text, atom.at))
        mixed = {t.name for t in atom.terms if isinstance(t, f.Attr)}
        if len(mixed) == 2:
            raise FormulaError(caret(f"{atom}: can't compare {' with '.join(sorted(mixed))}", self.text, atom.at))

    def term(self, term: f.Term, scope: Mapping[str, str], at: int) -> str:
        match term:
            case f.Var(name):
                if name not in scope:
                    near = suggest(name, scope) or f": quantify it, `forall {name}.`"
                    raise FormulaError(caret(f"unbound variable {name}{near}", self.text, term.at))
                return scope[name]
            case f.Attr(of, name):
                return self.attribute(term, self.term(of, scope, at), of.at if isinstance(of, f.Var) else 0)
            case f.Value(name):
                return "direction" if name in DIRECTIONS else "colour"
            case f.Number():
                return "number"
            case f.Element(sort):
                return sort

    def attribute(self, term: f.Attr, sort: str, at: int) -> str:
        attribute = ATTRIBUTES.get(term.name)
        if attribute is None:
            raise FormulaError(caret(f"unknown attribute {term.name!r}{suggest(term.name, ATTRIBUTES)}", self.text, at))
        if sort != attribute.owner:
            message = f"{term}: {term.name} belongs to {attribute.owner}s, {term.of} is of sort {sort}"
            raise FormulaError(caret(message, self.text, at))
        return attribute.kind


class Crosswalks(StrEnum):
    """The crosswalks that a rule is about; the value is a phrase for messages."""

    ANY = "pedestrians on crosswalks"
    LIT = "pedestrians on crosswalks with lights"
    UNLIT = "pedestrians on crosswalks without lights"


@dataclass(frozen=True, slots=True, repr=False)
class Rule:
    """A traffic rule.

    A rule holds its formula and the predicates of the formula. Therefore predicates that are registered later do not change its
    verdicts.

    Raises:
        FormulaError: the text is not a formula, the name does not fit into a test id, or a shipped predicate or another predicate
            has the name of a predicate in `words`.
    """

    name: str
    """The name, as in test ids and in ``rules=``."""
    text: str
    """The formula as text."""
    title: str = ""
    """The title of the rule, such as ``right-of-way``."""
    meaning: str = ""
    """The meaning of the rule, one sentence of English."""
    source: str = ""
    """The source: paper, convention or statute, with the article."""
    responsible: str = ""
    """The vehicle that is bound to act, in words."""
    bound: tuple[str, ...] = ()
    """The variables of the agents bound to act. By default the agents that have to wait; in a rule that makes no agent wait, the
    agents of the obligation."""
    about: JunctionControl | tuple[JunctionControl, ...] | None = None
    """The kind or kinds of junction that the rule is about; None for all."""
    lanes: bool = False
    """Whether the rule is only about junctions where an arm has several entrances."""
    joining: bool = False
    """Whether the rule is only about junctions where, according to the map, a lane joins another lane."""
    crosswalks: Crosswalks | None = None
    """The crosswalks that the rule is about, so that it is only about junctions where pedestrians walk on such crosswalks; None
    for a rule that is not about crosswalks."""
    tie: float = 0.0
    """Largest difference of waiting times that count as equal [s]."""
    companions: tuple[str, ...] = ()
    """Names of rules of the same rulebook whose obligations can contradict the obligations of this rule."""
    requirement: str | None = None
    """Identifier of the requirement that the rule traces to."""
    words: tuple[Word, ...] = ()
    """The predicates in the formula that users added; by default the predicates that are registered when the rule is created."""
    place: str = field(default="", compare=False)
    """File and line of the registration; by default the line that creates the rule."""
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
        """The parsed formula of the rule."""
        return self._formula or self._read()

    @property
    def kinds(self) -> tuple[JunctionControl, ...]:
        """The kinds of junction that the rule is about, all kinds if `about` is None."""
        if self.about is None:
            return tuple(JunctionControl)
        return (self.about,) if isinstance(self.about, JunctionControl) else self.about

    def concerns(self, place: Junction | JunctionControl) -> bool:
        """Return whether the rule is about a junction.

        Args:
            place: the junction, or a kind of control, which stands for junctions with this control and one lane per arm.
        """
        if isinstance(place, JunctionControl):
            return place in self.kinds and not (self.lanes or self.joining or self.crosswalks)
        fits = (not self.lanes or max(place.lanes) > 1) and (not self.joining or bool(place.joining))
        return place.control in self.kinds and fits and self.walked_at(place)

    def walked_at(self, place: Junction) -> bool:
        """Return whether pedestrians walk on crosswalks that the rule is about; True for a rule that is not about crosswalks."""
        lights = [start.sign is Sign.LIGHTS for way, start, _ in place.further if isinstance(way, Crossing)]
        match self.crosswalks:
            case Crosswalks.LIT:
                return any(lights)
            case Crosswalks.UNLIT:
                return not all(lights)
        return self.crosswalks is None or bool(lights)

    def _read(self) -> f.Formula:
        """Parse the text of the rule, store the formula and the predicates in it, and return the formula."""
        vocabulary = BUILT_IN if desk().book is None else desk().book.vocabulary
        try:
            if self.words:
                own_words = BUILT_IN
                for word in self.words:
                    own_words = own_words.add(word)
                vocabulary = Vocabulary({**vocabulary, **own_words})
            formula = parse(self.text, vocabulary)
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

    def __repr__(self) -> str:
        return f"<Rule {self.name}: {one_line(self.title or self.text)}>"

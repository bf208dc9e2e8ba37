"""Books of rules: the paper's p1..p6, the rules of the road, and the rules that users add."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.rules.current import Desk, desk, desks
from pytest_rvads.logic.rules.lexicon import BUILT_IN
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.rulebooks import PAPER, ROAD, VARIANTS
from pytest_rvads.logic.rules.vocabulary import Follower, Names, Vocabulary, Word
from pytest_rvads.support.errors import FormulaError, require, suggest

__all__ = [
    "SHIPPED",
    "RuleBook",
    "claim",
    "current_book",
    "get_rule",
    "is_rulebook",
    "joined",
    "predicate",
    "rule",
    "rulebook",
    "rules_for",
]

_SHELF: Mapping[str, tuple[Rule, ...]] = {"paper": PAPER, "road": ROAD, "variants": VARIANTS}
_Function = Callable[..., NDArray[np.bool_]]


@dataclass(frozen=True, slots=True, repr=False)
class RuleBook:
    """Rules by name, and the predicates of their language; adding a rule or predicate returns another book."""

    rules: Mapping[str, Rule] = field(default_factory=lambda: {rule.name: rule for rules in _SHELF.values() for rule in rules})
    """Rules by name; the shipped rules by default."""
    vocabulary: Vocabulary = BUILT_IN

    def __post_init__(self) -> None:
        require(self.rules, Mapping, "rules= takes rules by their names", FormulaError)
        for rule in self.rules.values():
            require(rule, Rule, "rules= takes rules by their names", FormulaError)
        require(self.vocabulary, Vocabulary, "vocabulary= takes a Vocabulary", FormulaError)
        object.__setattr__(self, "rules", Names(self.rules))

    def add(self, rule: Rule) -> RuleBook:
        """Return a book with a further rule.

        Raises:
            FormulaError: the name of the rule is that of a shipped rule or rulebook, or of a different rule.
        """
        if rule.name in SHIPPED.rules or rule.name in _SHELF:
            raise FormulaError(f"{rule.name!r} is a shipped rule or rulebook: choose another name for yours")
        registered = self.rules.get(rule.name, rule)
        if registered != rule:
            raise FormulaError(
                f"{rule.name!r} is registered at {registered.place} and says something else at {rule.place}: "
                "give each a name of its own"
            )
        return replace(self, rules={**self.rules, rule.name: registered})

    def define(self, word: Word) -> RuleBook:
        """Return a book with a further predicate.

        Raises:
            FormulaError: the name of the predicate has another meaning already.
        """
        return replace(self, vocabulary=self.vocabulary.add(word))

    @property
    def own(self) -> tuple[Rule, ...]:
        """The rules that users added, in order."""
        return tuple(rule for name, rule in self.rules.items() if name not in SHIPPED.rules)

    def __repr__(self) -> str:
        return f"<RuleBook of {len(self.rules)} rules>"

    def __getitem__(self, name: str) -> Rule:
        if name not in self.rules:
            raise FormulaError(f"unknown rule {name!r}, there are {', '.join(self.rules)}{suggest(name, self.rules)}")
        return self.rules[name]


SHIPPED = RuleBook()
"""The shipped rules."""


def current_book(book: RuleBook | None = None) -> RuleBook:
    """Return the given book, by default the open book: of the pytest session, or of the process if no session runs.

    Raises:
        FormulaError: `book` is not a RuleBook.
    """
    require(book, RuleBook | None, "book= takes a RuleBook, or nothing for the one that is open", FormulaError)
    return _on(desk()) if book is None else book


def _on(where: Desk) -> RuleBook:
    book: RuleBook | None = where.book
    return SHIPPED if book is None else book


def _register(change: Callable[[RuleBook], RuleBook]) -> None:
    """Put a changed book on every desk that the change concerns, or on none if a book refuses the change."""
    changed = [(where, change(_on(where))) for where in desks()]
    for where, book in changed:
        where.book = book


def joined(book: RuleBook, other: RuleBook) -> RuleBook:
    """Return a book with the rules and predicates of two books that give no name two meanings."""
    return RuleBook({**book.rules, **other.rules}, Vocabulary({**book.vocabulary, **other.vocabulary}))


def claim(rule: Rule) -> None:
    """Register in the index of the session a rule that judges a test, also a rule that no book holds.

    Raises:
        FormulaError: a different rule of the session has the same name, so that reports would mix up the two rules.
    """
    index = desk().index
    if index is not None and rule.name not in SHIPPED.rules:
        index.book = _on(index).add(rule)


def rule(  # noqa: PLR0913 - all properties of a rule, by keyword
    name: str,
    text: str,
    *,
    title: str = "",
    meaning: str = "",
    source: str = "",
    responsible: str = "",
    bound: str | Sequence[str] = (),
    about: JunctionControl | str | None = None,
    tie: float = 0.0,
    requirement: str | None = None,
    place: str = "",
) -> Rule:
    """Register a rule under a name, in the open book: of the test file or test that registers the rule, else of all tests.

    The same rule may be registered again. A different rule with the same name is refused, because tests that mean the first rule
    would be judged by the second.

    Args:
        name: the name, for ``rules=`` and test ids.
        text: the formula, such as ``forall a, j.en. G(a@j.en -> F a@j)``.
        title: the title, a few words.
        meaning: the meaning, one sentence.
        source: the source of the rule, such as a statute.
        responsible: the role that is bound to act.
        bound: the variables of that role, such as ``"a"``. With a subject among traffic, the rule applies to the instances in
            which the subject is one of these variables. By default the variables of the agents that have to wait, else of the
            agents of the obligation.
        about: the kind of junction that the rule is about, such as ``"stop"`` or ``"lights"``; None for all junctions.
        tie: largest difference of waiting times that count as equal [s].
        requirement: identifier for traceability.
        place: file and line of the rule, for messages; by default the line that registers the rule.

    Raises:
        FormulaError: the formula can't be parsed, the name is that of a shipped or different rule, or the kind of junction is
            unknown.
    """
    kinds = [c.value for c in JunctionControl]
    if about is not None and about not in kinds:
        raise FormulaError(f"rule {name!r}: about must be one of {', '.join(kinds)}, got {about!r}{suggest(about, kinds)}")
    new_rule = Rule(
        name,
        text,
        title,
        meaning,
        source=source,
        responsible=responsible,
        bound=(bound,) if isinstance(bound, str) else tuple(bound),
        about=None if about is None else JunctionControl(about),
        tie=tie,
        requirement=requirement,
        place=place,
    )
    _register(lambda book: book.add(new_rule))
    return new_rule


def predicate(
    name: str, *sorts: str, says: str = "", denies: str = "", follow: Callable[..., Follower] | None = None
) -> Callable[[_Function], _Function]:
    """Register a Python function as a predicate of the rule language, in the same books as `rule`.

    Example:
        >>> @predicate("crawls", "agent", says="{0} crawls", denies="{0} does not crawl")
        ... def crawls(run, a):
        ...     return run.speed[:, a] < 1.0

    Args:
        name: an identifier, as formulas will spell it.
        sorts: the sorts of the arguments, such as ``"agent"``, ``"entrance"``.
        says: the predicate in words, for explanations, with the arguments by number; by default as formulas spell it.
        denies: the negated predicate in words.
        follow: a factory for live monitors of predicates that depend on earlier states. It takes a run of the first state and the
            numbers of the arguments, and returns a function that reads the next state, a run of one state, and returns the truth
            value there. Without `follow` a monitor calls the predicate on a run of one state.

    Raises:
        FormulaError: the name belongs to a shipped predicate or to a different function, or `Word` refuses the arguments.
    """
    word_without_function = Word(name, tuple(map(str, sorts)), None, says, denies, follow)
    BUILT_IN.add(word_without_function)  # refuses the names of shipped predicates

    def register(function: _Function) -> _Function:
        word = replace(word_without_function, holds=function)
        _register(lambda book: book.define(word))
        return function

    return register


def rulebook(name: str) -> tuple[Rule, ...]:
    """Return the rules of a rulebook, ``"paper"`` or ``"road"``.

    Raises:
        FormulaError: no rulebook has this name.
    """
    if name not in _SHELF:
        raise FormulaError(f"unknown rulebook {name!r}, there are {', '.join(_SHELF)}{suggest(name, _SHELF)}")
    return _SHELF[name]


def is_rulebook(name: str) -> bool:
    """Return whether a name is the name of a rulebook."""
    return name in _SHELF


def get_rule(rule: str | Rule, book: RuleBook | None = None) -> Rule:
    """Return a rule, given as a Rule or by its name in a book, by default the open book.

    Raises:
        FormulaError: no rule has this name, or `book` is not a RuleBook.
    """
    book = current_book(book)
    require(rule, str | Rule, "a rule is a Rule or the name of one, such as 'p1'", FormulaError)
    if isinstance(rule, Rule):
        return rule
    try:
        return book[rule]
    except FormulaError as error:
        index = desk().index
        if index is None or book is not current_book() or rule not in _on(index).rules:
            raise
        place = _on(index)[rule].place
        remedy = "move it to a conftest, or into a module that is no test file"
        raise FormulaError(f"{error}; {place} registers it for that file or test alone: {remedy}") from None


def rules_for(
    spec: str | Rule | Sequence[str | Rule], place: Junction | JunctionControl | None = None, book: RuleBook | None = None
) -> tuple[Rule, ...]:
    """Return the rules that `spec` names, each once, in order.

    Args:
        spec: a rulebook, a rule, or a mixture of both.
        place: a junction, or the control of a junction with one lane per arm. Of a rulebook, only the rules about this place are
            returned; a rule that `spec` names itself is always returned.
        book: the book with the rules; the open book by default.

    Raises:
        FormulaError: a name is unknown, or two different rules have the same name, which may be the name of a shipped rule.
    """
    expected = "rules are named one by one, or as a list of names and of Rules"
    require(spec, str | Rule | Iterable, expected, FormulaError)
    rules: dict[str, Rule] = {}
    for part in (spec,) if isinstance(spec, str | Rule) else spec:
        if isinstance(part, str) and part in _SHELF:
            chosen = [r for r in rulebook(part) if place is None or r.concerns(place)]
        else:
            chosen = [get_rule(part, book)]
        for r in chosen:
            if SHIPPED.rules.get(r.name, r) != r:
                raise FormulaError(f"{r.name!r} is a shipped rule and {r!r} says something else: choose another name for yours")
            if rules.setdefault(r.name, r) != r:
                places = f"at {rules[r.name].place} and at {r.place}"
                raise FormulaError(f"two different rules are called {r.name!r}, {places}: choose another name for one of them")
    return tuple(rules.values())

"""Books of rules: the paper's rules p1 to p6, the rules of the road, and the rules that users add in code or in files.

A file of rules is an INI file with one section per rule::

    [gives_way]
    text = forall a, j.en. G(a@j.en -> F a@j)
    requirement = REQ-7
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from configparser import ConfigParser
from configparser import Error as IniError
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.rules.current import desk, desks
from pytest_rvads.logic.rules.lexicon import BUILT_IN
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.rulebooks import PAPER, ROAD, VARIANTS
from pytest_rvads.logic.rules.vocabulary import Follower, Names, Vocabulary, Word
from pytest_rvads.support.errors import FormulaError, require, suggest
from pytest_rvads.support.storage import read_file

_SHELF: Mapping[str, tuple[Rule, ...]] = {"paper": PAPER, "road": ROAD, "variants": VARIANTS}
_Function = Callable[..., NDArray[np.bool_]]
_MOST_BYTES, _MOST_RULES = 2**20, 1000
_KEYS = ("text", "title", "meaning", "source", "responsible", "bound", "about", "tie", "requirement")


@dataclass(frozen=True, slots=True, repr=False)
class RuleBook:
    """Rules by name, and the predicates that the rules may use. A book does not change: `add` and `define` return a new book."""

    rules: Mapping[str, Rule] = field(default_factory=lambda: {rule.name: rule for rules in _SHELF.values() for rule in rules})
    """Rules by name; the shipped rules by default."""
    vocabulary: Vocabulary = BUILT_IN
    """The predicates that the rules may use; the shipped predicates by default."""

    def __post_init__(self) -> None:
        require(self.rules, Mapping, "rules= takes rules by their names", FormulaError)
        for rule in self.rules.values():
            require(rule, Rule, "rules= takes rules by their names", FormulaError)
        require(self.vocabulary, Vocabulary, "vocabulary= takes a Vocabulary", FormulaError)
        object.__setattr__(self, "rules", Names(self.rules))

    def add(self, rule: Rule) -> RuleBook:
        """Return a book with a further rule.

        Raises:
            FormulaError: a shipped rule, a rulebook, or a different rule of the book has the name of the rule.
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
            FormulaError: a different predicate of the book has the same name.
        """
        return replace(self, vocabulary=self.vocabulary.add(word))

    @property
    def own(self) -> tuple[Rule, ...]:
        """The rules of the book that users added, in the order in which they were added."""
        return tuple(rule for name, rule in self.rules.items() if name not in SHIPPED.rules)

    def __repr__(self) -> str:
        return f"<RuleBook of {len(self.rules)} rules>"

    def __getitem__(self, name: str) -> Rule:
        if name not in self.rules:
            raise FormulaError(f"unknown rule {name!r}, there are {', '.join(self.rules)}{suggest(name, self.rules)}")
        return self.rules[name]


SHIPPED = RuleBook()
"""The book with the shipped rules and predicates alone."""


def current_book(book: RuleBook | None = None) -> RuleBook:
    """Return the given book of rules; by default the open book, in which rules are looked up and registered at present.

    Within a pytest session, the running test, its test file, or the session has the open book; outside, the process has it.
    """
    require(book, RuleBook | None, "book= takes a RuleBook, or nothing for the one that is open", FormulaError)
    return book or desk().book or SHIPPED


def _register(change: Callable[[RuleBook], RuleBook]) -> None:
    """Change the book of every test, test file or session that a registration is for; no book, if any book refuses the change."""
    changed = [(where, change(where.book or SHIPPED)) for where in desks()]
    for where, book in changed:
        where.book = book


def joined(book: RuleBook, other: RuleBook) -> RuleBook:
    """Return a book with the rules and predicates of two books; the caller ensures that no name has two meanings."""
    return RuleBook({**book.rules, **other.rules}, Vocabulary({**book.vocabulary, **other.vocabulary}))


def claim(rule: Rule) -> None:
    """Reserve the name of a rule that judges a test, so that no other rule of the pytest session can have this name."""
    index = desk().index
    if index is not None and rule.name not in SHIPPED.rules:
        index.book = (index.book or SHIPPED).add(rule)


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
    """Register a rule under a name, by which tests and `check` can ask for the rule.

    A rule that the code of a test file registers exists for the tests of this file. A rule that a test, or a fixture of this test
    alone, registers exists for this test. Any other registered rule, such as a rule of a conftest, exists for all tests.

    The same rule may be registered again. A different rule with the same name is refused, because the different rule would judge
    tests that mean the registered rule.

    Args:
        name: the name, for ``rules=`` and test ids.
        text: the formula, such as ``forall a, j.en. G(a@j.en -> F a@j)``.
        title: the title, a few words.
        meaning: the meaning, one sentence.
        source: the source of the rule, such as a statute.
        responsible: the vehicle that is bound to act, in words, such as ``"the vehicle that enters"``.
        bound: the variables of the agents that are bound to act, such as ``"a"``. On a run with a vehicle under test, the rule
            asks something of this vehicle only where one of these variables stands for this vehicle. By default the agents that
            have to wait; in a rule that makes no agent wait, the agents of the obligation.
        about: the kind of junction that the rule is about, such as ``"stop"`` or ``"lights"``; None for all junctions.
        tie: largest difference of waiting times that count as equal [s].
        requirement: identifier of the requirement that the rule traces to.
        place: file and line of the rule, for messages; by default the line that registers the rule.

    Raises:
        FormulaError: the formula can't be parsed, a shipped rule or a different rule has the name, or the kind of junction is
            unknown.
    """
    __tracebackhide__ = True  # the traceback in pytest ends at the line that calls
    kinds = [c.value for c in JunctionControl]
    if about is not None and about not in kinds:
        raise FormulaError(f"rule {name!r}: about must be one of {', '.join(kinds)}, got {about!r}{suggest(about, kinds)}")
    try:
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
    except FormulaError as error:
        raise error.with_traceback(None) from None
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
        follow: for live monitors of predicates that depend on earlier states: a function that takes the first state, as a run of
            a single state, and the numbers of the arguments, and returns a function. The returned function is called with the
            first state and every later state, as runs of a single state, and returns the truth value in the state. If `follow` is
            None, a live monitor calls the predicate on a run of the present state alone.

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
    """Return the rules of a rulebook, a named list of rules: ``"paper"`` or ``"road"``."""
    if name not in _SHELF:
        raise FormulaError(f"unknown rulebook {name!r}, there are {', '.join(_SHELF)}{suggest(name, _SHELF)}")
    return _SHELF[name]


def is_rulebook(name: str) -> bool:
    """Return whether a name is the name of a rulebook."""
    return name in _SHELF


def get_rule(rule: str | Rule, book: RuleBook | None = None) -> Rule:
    """Return a rule, given as a Rule or by its name in a book; by default the book is the open book, see `current_book`."""
    book = current_book(book)
    require(rule, str | Rule, "a rule is a Rule or the name of one, such as 'p1'", FormulaError)
    if isinstance(rule, Rule):
        return rule
    try:
        return book[rule]
    except FormulaError as error:
        index = desk().index
        if index is None or book is not current_book() or rule not in (index.book or SHIPPED).rules:
            raise
        place = (index.book or SHIPPED)[rule].place
        remedy = "move it to a conftest, or into a module that is no test file"
        raise FormulaError(f"{error}; {place} registers it for that file or test alone: {remedy}") from None


def rules_for(
    spec: str | Rule | Sequence[str | Rule], place: Junction | JunctionControl | None = None, book: RuleBook | None = None
) -> tuple[Rule, ...]:
    """Return the rules that `spec` names, in order and each rule once."""
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


def load_rules(path: str | Path) -> tuple[Rule, ...]:
    """Register every rule of an INI file, and return the rules in the order of the file.

    Args:
        path: the file. Its keys are the arguments of `rule`; ``text`` is required and may extend over several indented lines.

    Raises:
        FormulaError: the file can't be read or holds too many rules, a key is unknown, or a rule has no text or a wrong text.
    """
    path = Path(path)
    parser = ConfigParser(interpolation=None, comment_prefixes=("#", ";"), default_section="")
    try:
        parser.read_string(read_file(path, _MOST_BYTES).decode(), source=str(path))
    except OSError as error:
        raise FormulaError(f"{path}: can't be read: {error.strerror}") from error
    except (IniError, UnicodeDecodeError) as error:
        raise FormulaError(f"{path}: not a file of rules: {' '.join(str(error).split())}") from error
    if len(parser.sections()) > _MOST_RULES:
        raise FormulaError(f"{path}: {len(parser.sections()):,} rules, at most {_MOST_RULES:,} are read: split it into files")
    rules = []
    for name in parser.sections():
        section = dict(parser.items(name))
        for key in section:
            if key not in _KEYS:
                raise FormulaError(
                    f"{path}: rule {name!r}: unknown key {key!r}{suggest(key, _KEYS)}; known are {', '.join(_KEYS)}"
                )
        if not section.get("text"):
            raise FormulaError(f"{path}: rule {name!r} has no text: add `text = ` and a formula")
        properties: dict[str, Any] = {**section, "bound": section.get("bound", "").replace(",", " ").split()}
        try:
            properties["tie"] = float(section.get("tie", "0"))
        except ValueError:
            raise FormulaError(f"{path}: rule {name!r}: tie must be a number of seconds, got {section['tie']!r}") from None
        try:
            rules.append(rule(name, **properties, place=f"{path}, section [{name}]"))
        except FormulaError as error:
            raise FormulaError(f"{path}: {error}") from None
    return tuple(rules)

"""Rules by name: the paper's p1..p6, those of the road, and the users' own."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from pytest_rvads.errors import FormulaError, suggest
from pytest_rvads.junctions.junction import JunctionControl
from pytest_rvads.logic.ltl.formula import Formula
from pytest_rvads.logic.ltl.sorts import Sort
from pytest_rvads.logic.rules.registry import Registry
from pytest_rvads.logic.rules.shape import outermost, untimed
from pytest_rvads.logic.rules.vocabulary import parse

__all__ = ["Rule", "get_rule", "rule", "rulebook", "rules_for", "user_rules"]


@dataclass(frozen=True, slots=True, repr=False)
class Rule:
    """A traffic rule: a formula of first-order temporal logic with what people need to know about it.

    Raises:
        FormulaError: the text is not a formula, or the name does not fit into a test id.
    """

    name: str
    text: str
    """The formula."""
    title: str = ""
    """What the rule is called, such as ``right-of-way``."""
    meaning: str = ""
    """In one sentence of English."""
    source: str = ""
    """Paper, convention or statute, with the article."""
    responsible: str = ""
    """The role that is bound to act, in words."""
    bound: tuple[str, ...] = ()
    """Its variables; by default those of the agents that have to wait, else of the obligation."""
    about: JunctionControl | None = None
    """The kind of junction the rule is about, None for all."""
    tie: float = 0.0
    """Waiting times that differ by at most this count as equal [s]."""
    companions: tuple[str, ...] = ()
    """Rules of the same rulebook whose obligations can contradict this one's."""
    requirement: str | None = None
    """Identifier of the requirement the rule traces to."""

    def __post_init__(self) -> None:
        if not self.name or not all(c.isascii() and (c.isalnum() or c in "_.-") for c in self.name):
            raise FormulaError(
                f"the name of a rule goes into test ids, so it must consist of A-Z a-z 0-9 _ . -, got {self.name!r}"
            )
        if not self.tie >= 0:
            raise FormulaError(f"rule {self.name!r}: the tie window must be a number of seconds, at least 0, got {self.tie!r}")
        try:
            formula = _formula(self.text)
        except FormulaError as error:
            raise FormulaError(f"rule {self.name!r}: {error}") from None
        agents = [v.name for v in outermost(formula) if v.sort is Sort.AGENT]
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

    def __repr__(self) -> str:
        return f"<Rule {self.name}: {self.title or self.text}>"

    @property
    def formula(self) -> Formula:
        """The parsed formula."""
        return _formula(self.text)


@lru_cache(maxsize=1024)
def _formula(text: str) -> Formula:
    return parse(text)


_USER: Registry[Rule] = Registry(operator.eq)
"""Users' rules."""


def user_rules() -> tuple[Rule, ...]:
    """Return the rules that users registered, in order."""
    return _USER.all()


def rule(
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
    place: str | None = None,
) -> Rule:
    """Register a rule under a name.

    The same rule may be registered again; another one of the same name may not, because tests that mean the first would then
    be judged by the second.

    Args:
        name: to use in ``rules=`` and in test ids.
        text: the formula, such as ``forall a, j.en. G(a@j.en -> F a@j)``.
        title: what it is called, in a few words.
        meaning: the same in one sentence.
        source: where it comes from.
        responsible: the role that is bound to act.
        bound: the variables of that role, such as ``"a"``: with a subject among traffic the rule is asked where the subject
            is one of them; by default those of the agents that have to wait, else of the obligation.
        about: ``"stop"`` or ``"lights"`` when it concerns only such junctions.
        tie: waiting times that differ by at most this count as equal [s].
        requirement: identifier for traceability.
        place: where the rule stands, for messages; by default the line that registers it.

    Raises:
        FormulaError: a formula that can't be understood, a name of a shipped rule or of another one, an unknown kind of
            junction.
    """
    if any(name == r.name for book in _books().values() for r in book) or name in _books():
        raise FormulaError(f"{name!r} is a shipped rule or rulebook: choose another name for yours")
    kinds = [c.value for c in JunctionControl]
    if about is not None and about not in kinds:
        raise FormulaError(f"rule {name!r}: about must be one of {', '.join(kinds)}, got {about!r}{suggest(about, kinds)}")
    control = None if about is None else JunctionControl(about)
    made = Rule(
        name,
        text,
        title,
        meaning,
        source=source,
        responsible=responsible,
        bound=(bound,) if isinstance(bound, str) else tuple(bound),
        about=control,
        tie=tie,
        requirement=requirement,
    )
    _USER.add(name, made, place)
    return made


def _books() -> dict[str, tuple[Rule, ...]]:
    from pytest_rvads.logic.rules.rulebooks import PAPER, ROAD, VARIANTS

    return {"paper": PAPER, "road": ROAD, "variants": VARIANTS}


def rulebook(name: str) -> tuple[Rule, ...]:
    """Return the rules of a rulebook, ``"paper"`` or ``"road"``.

    Raises:
        FormulaError: no such rulebook.
    """
    books = _books()
    if name not in books:
        raise FormulaError(f"unknown rulebook {name!r}, there are {', '.join(books)}{suggest(name, books)}")
    return books[name]


def get_rule(name: str) -> Rule:
    """Return a rule by name, shipped or registered.

    Raises:
        FormulaError: no such rule.
    """
    known = {r.name: r for book in _books().values() for r in book} | {r.name: r for r in user_rules()}
    if name not in known:
        raise FormulaError(f"unknown rule {name!r}, there are {', '.join(known)}{suggest(name, known)}")
    return known[name]


def rules_for(spec: str | Rule | Sequence[str | Rule], control: JunctionControl | None = None) -> tuple[Rule, ...]:
    """Return the rules that `spec` names, each once, in order.

    Args:
        spec: a rulebook, a rule, or a mixture of both.
        control: of a rulebook only the rules about such junctions are taken; a rule named outright always is.

    Raises:
        FormulaError: an unknown name, or different rules of the same name, also that of a shipped one.
    """
    shipped = {r.name: r for book in _books().values() for r in book}
    found: dict[str, Rule] = {}
    for part in (spec,) if isinstance(spec, str | Rule) else spec:
        if isinstance(part, str) and part in _books():
            chosen = [r for r in rulebook(part) if control is None or r.about in (None, control)]
        else:
            chosen = [get_rule(part) if isinstance(part, str) else part]
        for r in chosen:
            if shipped.get(r.name, r) != r:
                raise FormulaError(f"{r.name!r} is a shipped rule and {r!r} says something else: choose another name for yours")
            if found.setdefault(r.name, r) != r:
                raise FormulaError(f"two different rules are called {r.name!r}: choose another name for one of them")
    return tuple(found.values())

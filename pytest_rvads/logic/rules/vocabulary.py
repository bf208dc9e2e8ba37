"""What a rule may speak about: attributes, predicates, and those that users add; and the check of sorts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import FormulaError, suggest
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.parser import caret, parse_rule
from pytest_rvads.logic.ltl.sorts import Sort
from pytest_rvads.logic.rules.registry import Registry
from pytest_rvads.runs.run import Run

__all__ = ["COMPARISONS", "Predicate", "parse", "predicate", "user_predicate"]

COMPARISONS = ("=", "!=", "<", "<=", ">", ">=")
_DIRECTIONS = ("left", "straight", "right", "near", "far")
_COLOURS = ("green", "yellow", "red")
_ATTRIBUTES = {"wt": (Sort.AGENT, "number"), "sp": (Sort.AGENT, "number"), "cl": (Sort.LIGHT, "colour")}
_PLACES = {Sort.JUNCTION, Sort.ENTRANCE, Sort.EXIT, Sort.ROAD, Sort.VERTEX}
_PLACED = {Sort.AGENT, Sort.LIGHT, Sort.OBJECT}
_VERTICES = {Sort.ENTRANCE, Sort.EXIT, Sort.VERTEX}
_BUILT_IN: Mapping[str, tuple[str, ...]] = {
    "turn": ("agent", "direction"),
    "take": ("agent", "entrance", "direction"),
    "conflict": ("agent", "agent"),
    "meet": ("agent", "agent"),
    "collide": ("agent", "agent"),
    "owes": ("agent", "agent"),
    "obstructs": ("agent", "agent"),
    "stopped": ("agent",),
    "inside": ("agent",),
    "blocks": ("agent",),
    "may_go": ("agent",),
    "idles": ("agent",),
    "off_lane": ("agent",),
    "off_route": ("agent",),
    "speeding": ("agent",),
}
_RELATIONS = {
    "right-of": (Sort.ENTRANCE, Sort.ENTRANCE),
    "opposite": (Sort.ENTRANCE, Sort.ENTRANCE),
    "entex": (Sort.ENTRANCE, Sort.EXIT),
}


@dataclass(frozen=True, slots=True)
class Predicate:
    """A predicate that a user adds."""

    name: str
    sorts: tuple[Sort, ...]
    function: Callable[..., NDArray[np.bool_]]
    """Takes the run and one number per argument (the column of an agent, the number of an entrance, exit or light) and
    returns one truth value per state, shape ``(steps,)``."""

    def __call__(self, run: Run, *elements: int) -> NDArray[np.bool_]:
        """Evaluate on a run.

        Raises:
            FormulaError: the function returns something of another shape.
        """
        found = np.asarray(self.function(run, *elements))
        if found.shape != (run.steps,) or found.dtype != np.bool_:
            raise FormulaError(
                f"predicate {self.name!r} must return one bool per state, shape ({run.steps},), "
                f"got {found.dtype} of shape {found.shape}"
            )
        return found

    def same(self, other: Predicate) -> bool:
        """Return whether two predicates mean the same: a module that is loaded again makes its functions anew."""
        codes = [getattr(p.function, "__code__", p.function) for p in (self, other)]
        return self.sorts == other.sorts and codes[0] == codes[1]


_PREDICATES: Registry[Predicate] = Registry(Predicate.same)


def user_predicate(name: str) -> Predicate | None:
    """Return the predicate that a user registered under a name, or None."""
    return _PREDICATES.get(name)


def predicate(name: str, *sorts: str) -> Callable[[Callable[..., NDArray[np.bool_]]], Callable[..., NDArray[np.bool_]]]:
    """Register a Python function as a predicate of the rule language.

    Example:
        >>> @predicate("crawls", "agent")
        ... def crawls(run, a):
        ...     return run.speed[:, a] < 1.0

    Args:
        name: an identifier, as formulas will spell it.
        sorts: of the arguments, such as ``"agent"``, ``"entrance"``.

    Raises:
        FormulaError: a name that formulas can't spell or that is taken, also by another function, or an unknown sort.
    """
    if not name.isidentifier() or name in _BUILT_IN or name in ("G", "F", "N", "X", "U", "W", "R", "true", "false"):
        raise FormulaError(f"a predicate needs a free identifier as its name, got {name!r}")
    for sort in sorts:
        if sort not in set(Sort):
            raise FormulaError(f"predicate {name!r}: unknown sort {sort!r}{suggest(sort, [s.value for s in Sort])}")

    def register(function: Callable[..., NDArray[np.bool_]]) -> Callable[..., NDArray[np.bool_]]:
        _PREDICATES.add(name, Predicate(name, tuple(map(Sort, sorts)), function))
        return function

    return register


def parse(text: str) -> f.Formula:
    """Parse a rule and check it: every variable bound (but ``j``, the junction under test), known predicates, right sorts.

    Raises:
        FormulaError: with the line, a caret and the nearest valid word.
    """
    formula = parse_rule(text)
    _Check(text).formula(formula, {"j": Sort.JUNCTION})
    return formula


@dataclass(frozen=True, slots=True)
class _Check:
    text: str

    def formula(self, formula: f.Formula, scope: Mapping[str, Sort]) -> None:
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

    def atom(self, atom: f.Atom, scope: Mapping[str, Sort]) -> None:
        kinds = [self.term(t, scope, atom.at) for t in atom.terms]
        name = atom.name
        if name == "@":
            self.expect(atom, kinds, _PLACED, _PLACES)
        elif name in _RELATIONS:
            self.expect(atom, kinds, *({s, Sort.VERTEX} for s in _RELATIONS[name]))
        elif name in COMPARISONS:
            self.comparison(atom, kinds)
        else:
            self.predicate(atom, kinds)

    def predicate(self, atom: f.Atom, kinds: list[str]) -> None:
        name = atom.name
        known: dict[str, tuple[str, ...]] = {**_BUILT_IN, **{p.name: p.sorts for p in _PREDICATES.all()}}
        if name not in known:
            what = f"unknown predicate {name!r}" if atom.terms else f"{name!r} is neither a formula nor a known predicate"
            raise FormulaError(caret(what + suggest(name, [*known, *_RELATIONS]), self.text, atom.at))
        if len(kinds) != len(known[name]):
            wanted = ", ".join(known[name])
            raise FormulaError(
                caret(f"{name} takes {len(known[name])} arguments ({wanted}), got {len(kinds)}", self.text, atom.at)
            )
        self.expect(atom, kinds, *({k} for k in known[name]))

    def expect(self, atom: f.Atom, kinds: list[str], *wanted: set[str] | set[Sort]) -> None:
        for term, kind, allowed in zip(atom.terms, kinds, wanted, strict=True):
            if kind not in allowed:
                words = " or ".join(sorted(map(str, allowed)))
                raise FormulaError(caret(f"{atom}: expected {words}, got {term}, of sort {kind}", self.text, atom.at))

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

    def term(self, term: f.Term, scope: Mapping[str, Sort], at: int) -> str:
        match term:
            case f.Var(name):
                if name not in scope:
                    near = suggest(name, scope) or f": quantify it, `forall {name}.`"
                    raise FormulaError(caret(f"unbound variable {name}{near}", self.text, term.at))
                return scope[name]
            case f.Attr(of, name):
                sort = self.term(of, scope, at)
                if name not in _ATTRIBUTES:
                    raise FormulaError(caret(f"unknown attribute {name!r}{suggest(name, _ATTRIBUTES)}", self.text, _place(of)))
                owner, kind = _ATTRIBUTES[name]
                if sort != owner:
                    raise FormulaError(
                        caret(f"{term}: {name} belongs to {owner}s, {of} is of sort {sort}", self.text, _place(of))
                    )
                return kind
            case f.Word(name):
                return "direction" if name in _DIRECTIONS else "colour"
            case f.Number():
                return "number"
            case f.Element(sort):
                return sort


def _place(term: f.Var | f.Element) -> int:
    return term.at if isinstance(term, f.Var) else 0

"""Makes the instances of a rule, with their monitors, for all runs with the same junction and the same ways of the agents.

A rule becomes formulas without quantifiers as in Algorithm 1 of the paper: `unfold`, then `simplify`. `unfold` replaces variables
by vehicles and entrances. `simplify` evaluates the predicates that the static model (the junction and the agents' ways) decides.
`ground` takes both steps at once, variable by variable, and thus never writes out a formula that the static model decides. The
result of `ground` equals ``simplify(unfold(...))``. `prepare` merges instances with the same meaning and builds their monitors.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import prod

import numpy as np

from pytest_rvads.logic.conduct.static_model import Static
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import Budget, conj, disj, plain, rebuild, replaced
from pytest_rvads.logic.ltl.ltl3 import Machine, evaluate, synthesize
from pytest_rvads.logic.rules.lexicon import HERE, word_of
from pytest_rvads.logic.rules.rule import Form, Shape, agents_of, outermost, shape_of, split
from pytest_rvads.logic.rules.vocabulary import Sort

LIMIT = 100_000
"""Largest number of atoms and constants that the unfolding of a formula visits, which takes a second or two.

The shipped rules need at most 2,000 at a junction of four roads, and 30,000 at a junction of eight roads.
"""
_EACH = 10_000
"""Further atoms and constants allowed per agent of a recording, in which agents come and go.

An agent is present together with few other agents. Therefore the number of atoms is proportional to the length of the recording.
"""
Binding = tuple[tuple[str, f.Element], ...]
"""Variables of a rule, each with the element that replaces it."""


def _budget(formula: f.Formula, static: Static) -> Budget:
    most = LIMIT if static.together is None else LIMIT + _EACH * len(static.agents)
    return Budget(most, f.size(formula), what="too many instances, one per choice of elements for its variables")


@dataclass(frozen=True, slots=True)
class Instance:
    """An instance of a rule: vehicles, entrances or other elements replace the rule's outermost universal variables."""

    binding: Binding
    formula: f.Formula

    def __str__(self) -> str:
        names = ", ".join(f"{name}={element}" for name, element in self.binding)
        return f"[{names}] {self.formula}" if names else str(self.formula)


@dataclass(frozen=True, slots=True)
class Grounding:
    """The instances of a rule; the rule without quantifiers is the conjunction of all instances."""

    instances: tuple[Instance, ...]
    collapsed: int = 0
    """Number of instances that are true in every run with the static model (the junction and the agents' ways)."""

    def __str__(self) -> str:
        lines = [str(i) for i in self.instances]
        if self.collapsed:
            lines.append(f"({self.collapsed} more are true by what is static)")
        return "\n".join(lines)


@lru_cache(maxsize=64)
def domain(sort: str, static: Static) -> tuple[f.Element, ...]:
    """Return the agents, entrances or other elements that a variable of a sort can stand for, at the junction under test."""
    match Sort(sort):
        case Sort.AGENT:
            return tuple(f.Element(sort, i, a.name) for i, a in enumerate(static.agents))
        case Sort.LIGHT:
            return tuple(f.Element(sort, i, f"lt{i}") for i in static.lights)
        case Sort.OBJECT:
            lights = tuple(f.Element(Sort.LIGHT, i, f"lt{i}") for i in static.lights)
            return lights + tuple(f.Element(sort, i, f"sign{i}") for i in static.signs)
        case Sort.JUNCTION:
            return (HERE,)
        case Sort.ENTRANCE:
            return tuple(f.Element(sort, i, f"j.en{i}") for i in range(static.entrances))
        case Sort.EXIT:
            return tuple(f.Element(sort, i, f"j.ex{i}") for i in range(static.exits))
        case Sort.VERTEX:
            return domain(Sort.ENTRANCE, static) + domain(Sort.EXIT, static)
        case Sort.ROAD:  # the roads into the junction, then the roads out of the junction
            return tuple(f.Element(sort, i, f"r{i}") for i in range(static.entrances + static.exits))


def _choices(variable: f.Binder, body: f.Formula, bound: Iterable[f.Element], static: Static) -> Iterable[f.Element]:
    """Return the elements that a variable of a formula can stand for.

    An agent on a way that is no movement of vehicles is left out, unless every predicate about the variable allows agents on any
    way. In a recording, an agent is left out as well if it was not present together with all agents in `bound`.
    """
    elements: Iterable[f.Element] = domain(variable.sort, static)
    if static.further and variable.sort == Sort.AGENT:
        agent = f.Var(variable.name)
        about = (a for a in f.atoms(body) if any(agent in (t, t.of if isinstance(t, f.Attr) else t) for t in a.terms))
        words = ((word_of(atom), atom.terms) for atom in about)
        # A comparison of agents is no predicate.
        of_any_way = all(agent in terms if word is None else word.any_way for word, terms in words)
        elements = elements if of_any_way else [e for e in elements if e.index not in static.further]
    if static.together is None:
        return elements
    bound_columns = _columns(bound)
    return [
        e for e in elements if e.sort != Sort.AGENT or all(k == e.index or (k, e.index) in static.together for k in bound_columns)
    ]


def _columns(elements: Iterable[f.Element]) -> tuple[int, ...]:
    """Return the columns of the agents among elements."""
    return tuple(e.index for e in elements if e.sort == Sort.AGENT)


def unfold(formula: f.Formula, static: Static) -> Grounding:
    """Return a rule without quantifiers: an instance per choice of elements for the outermost universal variables."""
    return Grounding(tuple(_unfold(formula, static, (), _budget(formula, static))))


def _unfold(formula: f.Formula, static: Static, binding: Binding, budget: Budget) -> list[Instance]:
    if isinstance(formula, f.Forall):
        variable, further = formula.variables[0], formula.variables[1:]
        body = f.Forall(further, formula.body) if further else formula.body
        chosen = _choices(variable, body, [e for _, e in binding], static)
        return [i for e in chosen for i in _unfold(body, static, (*binding, (variable.name, e)), budget)]
    if not static.judges(_columns(e for _, e in binding)):
        return []
    return [Instance(binding, _reduce(formula, dict(binding), static, budget, decide=False, itinerary=False))]


def simplify(grounding: Grounding, static: Static, *, itinerary: bool = True) -> Grounding:
    """Return the instances of a rule with the predicates evaluated that the static model decides, without true instances.

    Without `itinerary`, ``take`` (turn in a direction) is replaced by its definition in the paper, a formula about later states.
    """
    reduced = [
        Instance(i.binding, _reduce(i.formula, {}, static, _budget(i.formula, static), decide=True, itinerary=itinerary))
        for i in grounding.instances
    ]
    instances = tuple(i for i in reduced if i.formula != f.TRUE)
    return Grounding(instances, grounding.collapsed + len(reduced) - len(instances))


def ground(formula: f.Formula, static: Static, *, itinerary: bool = True) -> Grounding:
    """Return ``simplify(unfold(formula, static), static)``, faster, because true instances are never written out."""
    instances: list[Instance] = []
    collapsed = _ground(formula, static, itinerary, (), instances, _budget(formula, static))
    return Grounding(tuple(instances), collapsed)


def _ground(
    formula: f.Formula, static: Static, itinerary: bool, binding: Binding, instances: list[Instance], budget: Budget
) -> int:
    if not isinstance(formula, f.Forall):
        if not static.judges(_columns(e for _, e in binding)):
            return 0
        reduced = _reduce(formula, dict(binding), static, budget, decide=True, itinerary=itinerary)
        if reduced == f.TRUE:
            return 1
        instances.append(Instance(binding, reduced))
        return 0
    variable, further = formula.variables[0], formula.variables[1:]
    body: f.Formula = f.Forall(further, formula.body) if further else formula.body
    collapsed = 0
    for element in _choices(variable, body, [e for _, e in binding], static):
        if not further and not static.judges(_columns((*(e for _, e in binding), element))):
            continue
        # An inner variable can have the same name as an outer variable; `_reduce` tells them apart.
        bound = (*binding, (variable.name, element))
        values = dict(bound) if static.together is not None else {variable.name: element}
        reduced = _reduce(body, values, static, budget, decide=True, itinerary=itinerary)
        if isinstance(reduced, f.Const) and isinstance(body, f.Forall):
            count = prod(len(domain(v.sort, static)) for v in outermost(body))  # the number of instances
            if reduced.value or not count:
                collapsed += count
                continue
            reduced = body  # false for every choice of the further variables: each choice is an instance of its own
        collapsed += _ground(reduced, static, itinerary, bound, instances, budget)
    return collapsed


def _reduce(
    formula: f.Formula, values: Mapping[str, f.Element], static: Static, budget: Budget, *, decide: bool, itinerary: bool
) -> f.Formula:
    """Return a formula with its variables replaced and its inner quantifiers unfolded.

    With `decide`, the result is simplified. In a recording, inner quantifiers are unfolded only once all outermost variables are
    replaced: an inner variable stands for the agents that were present together with the agents chosen before.
    """
    postpones = static.together is not None and isinstance(formula, f.Forall)

    def go(node: f.Formula, env: Mapping[str, f.Element], prefix: bool) -> f.Formula:
        match node:
            case f.Atom(name, terms, at, word):
                budget.spend(1)
                atom = f.Atom(name, tuple([_bind(t, env) for t in terms]), at, word)
                return _decide(atom, static, itinerary) if decide else atom
            case f.Const():
                budget.spend(1)
                return node
            case f.Forall(variables, body) if prefix:
                inner = {k: v for k, v in env.items() if k not in {b.name for b in variables}}
                reduced = go(body, inner, True)
                return reduced if isinstance(reduced, f.Const) else f.Forall(variables, reduced)
            case f.Forall(variables, body) | f.Exists(variables, body) if postpones:
                inner = {k: v for k, v in env.items() if k not in {b.name for b in variables}}
                return type(node)(variables, go(body, inner, False))
            case f.Forall(variables, body) | f.Exists(variables, body):
                variable, further = variables[0], variables[1:]
                kind = type(node)
                inner_body = kind(further, body) if further else body
                chosen = _choices(variable, inner_body, env.values(), static)
                each = (go(inner_body, {**env, variable.name: e}, False) for e in chosen)
                if decide:
                    return conj(each) if kind is f.Forall else disj(each)
                parts = tuple(each)
                if not parts:
                    return f.TRUE if kind is f.Forall else f.FALSE
                return parts[0] if len(parts) == 1 else f.And(parts) if kind is f.Forall else f.Or(parts)
        below = (go(c, env, False) for c in f.children(node))
        return _fold(node, below) if decide else rebuild(node, tuple(below))

    return go(formula, values, True)


def _bind(term: f.Term, env: Mapping[str, f.Element]) -> f.Term:
    if isinstance(term, f.Var):
        return HERE if term.name == "j" and "j" not in env else env.get(term.name, term)
    if isinstance(term, f.Attr) and isinstance(term.of, f.Var):
        return f.Attr(env.get(term.of.name, term.of), term.name)
    return term


def _fold(node: f.Formula, below: Iterator[f.Formula]) -> f.Formula:
    """Return a formula rebuilt from new direct subformulas without constants, by laws that also hold on finite runs.

    The direct subformulas are computed in order, until a constant decides the value.
    """
    match node:
        case f.And():
            return conj(below)
        case f.Or():
            return disj(below)
        case f.Implies():
            left = next(below)
            if left == f.FALSE:
                return f.TRUE
            right = next(below)
            return right if left == f.TRUE or right == f.TRUE else f.Implies(left, right)
    parts = tuple(below)
    match node:
        case f.Next():  # N true is false in the last state of a run
            return f.FALSE if parts[0] == f.FALSE else f.Next(parts[0])
        case f.Always() | f.Eventually():
            return parts[0] if isinstance(parts[0], f.Const) else type(node)(parts[0])
        case f.Until() | f.WeakUntil() | f.Release():
            left, right = parts
            if isinstance(right, f.Const):
                forever = isinstance(node, f.WeakUntil) and not right.value
                return right if not forever else left if isinstance(left, f.Const) else f.Always(left)
            match node, left:
                case f.Until(), f.Const(value):
                    return f.Eventually(right) if value else right
                case f.WeakUntil(), f.Const(value):
                    return f.TRUE if value else right
                case f.Release(), f.Const(value):
                    return right if value else f.Always(right)
            return rebuild(node, parts)
    return plain(node, parts)


def _decide(atom: f.Atom, static: Static, itinerary: bool) -> f.Formula:
    """Return the value of an atom that the static model decides, or the definition of a defined predicate, or the atom."""
    word = word_of(atom)
    truth: bool | None = None
    if word is None:  # a comparison
        match atom.name, atom.terms:
            case (("=" | "!="), (f.Element() as one, f.Element() as two)):
                truth = (one == two) is (atom.name == "=")
            case (("=" | "!="), (f.Attr(f.Element(_, i)) as left, f.Attr(f.Element(_, k)) as right)) if i > k:
                return f.Atom(atom.name, (right, left))  # both orders of the terms are one atom
            case _, (f.Attr(f.Element()) as left, right) if left == right:
                truth = atom.name in ("=", "<=", ">=")
    elif not any(isinstance(t.of if isinstance(t, f.Attr) else t, f.Var) for t in atom.terms):
        if word.means is not None:
            return _define(word.means(*atom.terms, itinerary), static, itinerary)
        if word.symmetric:
            first, second = (term.index if isinstance(term, f.Element) else 0 for term in atom.terms)
            if first == second:
                return f.FALSE
            if first > second:
                return f.Atom(atom.name, atom.terms[::-1], word=atom.word)  # as above
        truth = None if word.decide is None else word.decide(static, *atom.terms)
    return atom if truth is None else f.TRUE if truth else f.FALSE


def _define(formula: f.Formula, static: Static, itinerary: bool) -> f.Formula:
    if isinstance(formula, f.Atom):
        return _decide(formula, static, itinerary)
    return _fold(formula, (_define(child, static, itinerary) for child in f.children(formula)))


@dataclass(frozen=True, slots=True)
class Member:
    """An instance of a rule among the instances that share a template because they have the same meaning."""

    binding: Binding
    premise: f.Formula | None
    """The premise (condition of the obligation) of the instance; None if the rule has no premise."""
    bound: tuple[f.Element, ...]
    """The agents that are bound to act."""


@dataclass(frozen=True, slots=True)
class Template:
    """An instance of a rule with its monitor; instances with the same meaning share a template."""

    formula: f.Formula
    shape: Shape
    members: tuple[Member, ...]
    """The first instance with this meaning, followed by the instances that were merged into the first instance."""
    machine: Machine
    """Monitor over the propositions p0, p1, ...; instances that differ only in their atoms share a machine."""
    atoms: tuple[f.Atom, ...]
    """The atoms that the propositions stand for."""

    @property
    def binding(self) -> Binding:
        """The elements that the variables of the instance stand for."""
        return self.members[0].binding

    @property
    def premises(self) -> tuple[f.Formula, ...]:
        """The different premises of the members; empty if the rule has no premise."""
        premises = dict.fromkeys(member.premise for member in self.members)
        return () if None in premises else tuple(p for p in premises if p is not None)


def columns(template: Template) -> tuple[int, ...]:
    """Return the columns, in the arrays of a run, of the agents that an instance of a rule is about."""
    return tuple(element.index for _, element in template.binding if element.sort == Sort.AGENT)


_MERGE_LIMIT = 6
"""Largest number of atoms of an instance that is compared with other instances by its truth table, of up to 64 rows."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """The instances of a rule for certain agents at a junction, with their monitors."""

    templates: tuple[Template, ...]
    collapsed: int
    """Number of further instances, which are true because of the junction and the ways alone."""


def prepare(formula: f.Formula, static: Static, bound: tuple[str, ...] = (), *, itinerary: bool = True) -> Prepared:
    """Return the simplified instances of a rule with their monitors; instances with the same meaning are merged."""
    cached = _few if len(static.agents) <= _FEW else _many
    return cached(formula, static, bound, itinerary)


def forget() -> None:
    """Empty the caches of prepared rules."""
    _few.cache_clear()
    _many.cache_clear()


def _prepare(formula: f.Formula, static: Static, bound: tuple[str, ...], itinerary: bool) -> Prepared:
    grounding = ground(formula, static, itinerary=itinerary)
    groups: dict[object, list[Instance]] = {}
    for instance in grounding.instances:
        for part in split(instance.formula):
            atoms = sorted(f.atoms(part), key=str)
            key: object = part
            if isinstance(part, f.Always) and shape_of(part).form is Form.STATE and len(atoms) <= _MERGE_LIMIT:
                # Instances with the same meaning, such as p1 of (a, a') and p1 of (a', a), have the same truth table.
                rows = np.array(list(product((False, True), repeat=len(atoms))))
                truths = evaluate(part.body, dict(zip(atoms, rows.T, strict=True)), (len(rows),))
                key = tuple(atoms), truths.tobytes()
            groups.setdefault(key, []).append(Instance(instance.binding, part))
    templates = []
    for instances in groups.values():
        members = []
        for instance in instances:
            shape, values = shape_of(instance.formula), dict(instance.binding)
            waits = shape.waits if shape.waits is not None else shape.obligation
            actors = tuple(values[name] for name in bound) if bound else agents_of(waits)
            members.append(Member(instance.binding, shape.premise, actors))
        merged = instances[0].formula
        names = {atom: f.Atom(f"p{k}") for k, atom in enumerate(f.atoms(merged))}
        machine = synthesize(replaced(merged, names.__getitem__))
        templates.append(Template(merged, shape_of(merged), tuple(members), machine, tuple(names)))
    return Prepared(tuple(templates), grounding.collapsed)


_FEW = 12
"""Largest number of agents for which a prepared rule goes into the large cache.

A few agents at a junction recur, because scenarios recur; such a prepared rule takes some 5 kB. A crowd of recorded traffic does
not recur, and its prepared rule takes megabytes.
"""
_few = lru_cache(maxsize=8192)(_prepare)
_many = lru_cache(maxsize=64)(_prepare)

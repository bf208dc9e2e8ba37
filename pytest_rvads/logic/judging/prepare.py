"""The preparation of a rule that is the same for all runs of a static model: instances, merged by symmetry, with monitors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from pytest_rvads.logic.conduct.predicates import Static
from pytest_rvads.logic.judging.ground import Binding, Instance, ground
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import evaluate
from pytest_rvads.logic.ltl.ltl3 import Machine, synthesize
from pytest_rvads.logic.ltl.rewrite import replaced
from pytest_rvads.logic.rules.shape import Kind, Shape, agents_of, shape_of, split

__all__ = ["Member", "Prepared", "Template", "forget", "prepare", "template"]

_MERGE_LIMIT = 6
"""Most atoms of an instance that is compared with other instances for symmetry (truth tables of 64 rows)."""


@dataclass(frozen=True, slots=True)
class Member:
    """One of the symmetric instances that a template stands for."""

    binding: Binding
    premise: f.Formula | None
    """The premise of the instance; None if the rule is never vacuous."""
    bound: tuple[f.Element, ...]
    """The agents that are bound to act."""


@dataclass(frozen=True, slots=True)
class Template:
    """An instance ready to be monitored."""

    formula: f.Formula
    shape: Shape
    members: tuple[Member, ...]
    """This instance, and every instance merged into it."""
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
        """Premises of this instance and of the instances merged into it; empty if the rule is never vacuous."""
        premises = dict.fromkeys(member.premise for member in self.members)
        return () if None in premises else tuple(p for p in premises if p is not None)


@dataclass(frozen=True, slots=True)
class Prepared:
    """A rule on a static model."""

    templates: tuple[Template, ...]
    collapsed: int


def template(formula: f.Formula) -> tuple[f.Formula, tuple[f.Atom, ...]]:
    """Replace atoms by propositions p0, p1, ... in the order of their occurrence; return the formula and the atoms."""
    atoms = f.atoms(formula)
    names = {atom: f.Atom(f"p{k}") for k, atom in enumerate(atoms)}
    return replaced(formula, names.__getitem__), atoms


def prepare(formula: f.Formula, static: Static, bound: tuple[str, ...] = (), *, itinerary: bool = True) -> Prepared:
    """Unfold and simplify a rule, merge symmetric instances, and build the monitors.

    Args:
        formula: the formula of the rule.
        static: the model.
        bound: the variables of the agents that are bound to act; by default the agents that have to wait, else the agents of the
            obligation.
        itinerary: use the agents' known itineraries for ``take``.

    Raises:
        FormulaError: a monitor would be too large.
    """
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
            groups.setdefault(_key(part), []).append(Instance(instance.binding, part))
    templates = []
    for instances in groups.values():
        representative = instances[0]
        renamed, atoms = template(representative.formula)
        members = tuple(_member(instance, bound) for instance in instances)
        templates.append(Template(representative.formula, shape_of(representative.formula), members, synthesize(renamed), atoms))
    return Prepared(tuple(templates), grounding.collapsed)


_FEW = 12
"""Most agents of a model whose preparation is cached in the large cache.

Small models recur, because scenarios recur; their instances take some 5 kB each. Crowds of recorded traffic do not recur, and
their instances take megabytes.
"""
_few = lru_cache(maxsize=8192)(_prepare)
_many = lru_cache(maxsize=64)(_prepare)


def _member(instance: Instance, bound: tuple[str, ...]) -> Member:
    shape, values = shape_of(instance.formula), dict(instance.binding)
    waits = shape.waits if shape.waits is not None else shape.obligation
    return Member(instance.binding, shape.premise, tuple(values[name] for name in bound) if bound else agents_of(waits))


def _key(formula: f.Formula) -> object:
    """Return a key that is equal for instances with the same meaning, such as p1 of (a, a') and of (a', a)."""
    shape = shape_of(formula)
    atoms = sorted(f.atoms(formula), key=str)
    if shape.kind is not Kind.STATE or len(atoms) > _MERGE_LIMIT or not isinstance(formula, f.Always):
        return formula
    rows = np.array(list(product((False, True), repeat=len(atoms))))
    return tuple(atoms), evaluate(formula.body, dict(zip(atoms, rows.T, strict=True)), (len(rows),)).tobytes()

"""Makes the instances of a rule, with their monitors, for all runs with the same junction and the same ways of the agents."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from pytest_rvads.logic.conduct.predicates import Static
from pytest_rvads.logic.judging.ground import Instance, ground
from pytest_rvads.logic.judging.judgement import Member, Template
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import evaluate, replaced
from pytest_rvads.logic.ltl.ltl3 import synthesize
from pytest_rvads.logic.rules.parts import Kind, agents_of, shape_of, split

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
            if isinstance(part, f.Always) and shape_of(part).kind is Kind.STATE and len(atoms) <= _MERGE_LIMIT:
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

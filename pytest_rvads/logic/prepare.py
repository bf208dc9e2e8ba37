"""What checking a rule needs and no run changes: its instances, merged and taken apart, with one monitor per template."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

from pytest_rvads.logic import formula as f
from pytest_rvads.logic.boolean import holds
from pytest_rvads.logic.ground import Binding, Instance, ground
from pytest_rvads.logic.ltl3 import Machine, synthesize
from pytest_rvads.logic.rewrite import rebuild
from pytest_rvads.logic.shape import Kind, Shape, shape_of, split
from pytest_rvads.semantics.predicates import Static

__all__ = ["Prepared", "Template", "prepare", "template"]

_MERGE_LIMIT = 6
"""Symmetric instances are looked for up to this many atoms (truth tables of 64 rows)."""


@dataclass(frozen=True, slots=True)
class Template:
    """An instance ready to be monitored."""

    binding: Binding
    formula: f.Formula
    shape: Shape
    premises: tuple[f.Formula, ...]
    """Of this and of every instance merged into it; empty where the rule is never vacuous."""
    machine: Machine
    """Over propositions p0, p1, ...; shared by all instances that differ only in their atoms."""
    atoms: tuple[f.Atom, ...]
    """What the propositions stand for."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """A rule on a static model."""

    templates: tuple[Template, ...]
    collapsed: int


def template(formula: f.Formula) -> tuple[f.Formula, tuple[f.Atom, ...]]:
    """Replace atoms by propositions p0, p1, ... in the order of their occurrence; return the formula and the atoms."""
    found = f.atoms(formula)
    names = {atom: f.Atom(f"p{k}") for k, atom in enumerate(found)}
    return _rename(formula, names), found


def _rename(formula: f.Formula, names: dict[f.Atom, f.Atom]) -> f.Formula:
    if isinstance(formula, f.Atom):
        return names[formula]
    return rebuild(formula, tuple(_rename(c, names) for c in f.children(formula)))


@lru_cache(maxsize=1024)
def prepare(formula: f.Formula, static: Static, *, itinerary: bool = True) -> Prepared:
    """Unfold, simplify, merge symmetric instances, and build the monitors.

    Raises:
        FormulaError: a monitor would be too large.
    """
    grounding = ground(formula, static, itinerary=itinerary)
    groups: dict[object, list[Instance]] = {}
    for instance in grounding.instances:
        for part in split(instance.formula):
            groups.setdefault(_key(part), []).append(Instance(instance.binding, part))
    found = []
    for first, *others in groups.values():
        shape = shape_of(first.formula)
        premises = [shape_of(i.formula).premise for i in (first, *others)]
        renamed, atoms = template(first.formula)
        found.append(
            Template(
                first.binding,
                first.formula,
                shape,
                tuple(dict.fromkeys(p for p in premises if p is not None)) if None not in premises else (),
                synthesize(renamed),
                atoms,
            )
        )
    return Prepared(tuple(found), grounding.collapsed)


def _key(formula: f.Formula) -> object:
    """Return the same key for instances that say the same, such as p1 of (a, a') and of (a', a)."""
    shape = shape_of(formula)
    atoms = sorted(f.atoms(formula), key=str)
    if shape.kind is not Kind.STATE or len(atoms) > _MERGE_LIMIT or not isinstance(formula, f.Always):
        return formula
    rows = (frozenset(a for a, v in zip(atoms, row, strict=True) if v) for row in product((False, True), repeat=len(atoms)))
    return tuple(atoms), tuple(holds(formula.body, row) for row in rows)

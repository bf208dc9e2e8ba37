"""The instances of rules for vehicles that are not known beforehand: per vehicle, and per pair of vehicles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pytest_rvads.geometry.conflicts import Key
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.predicates import Static, extract
from pytest_rvads.logic.judging.ground import unfold
from pytest_rvads.logic.judging.prepare import Template, prepare
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.shape import agents_of, split
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent
from pytest_rvads.support.errors import FormulaError

__all__ = ["Instances"]


class Instances:
    """The instances of rules by the ways of the vehicles, prepared once per combination of ways.

    Args:
        rules: the rules.
        junction: the junction.
        lights: colours of the first state; an entrance with a colour other than none has a light.

    Raises:
        FormulaError: a rule is about more than two vehicles at once, so that vehicles that come later would count.
    """

    def __init__(self, rules: tuple[Rule, ...], junction: Junction, lights: list[int]) -> None:
        self._rules, self._junction, self._lights = rules, junction, lights
        self._known: dict[tuple[Key, ...], tuple[tuple[int, Template], ...]] = {}
        routes = [next(iter(junction.movements))] * 3
        static = replace(self._static(tuple(routes)), entrances=1, exits=1, lights=(0,), signs=())
        for rule in rules:
            _refuse_crowds(rule, static)

    def of(self, *ways: Key) -> tuple[tuple[int, Template], ...]:
        """Return the instances about one vehicle or about two vehicles together, each with the number of its rule.

        The agents of the instances are numbered in the order of the ways.
        """
        found = self._known.get(ways)
        if found is None:
            static = self._static(ways)
            everything = range(len(ways))
            found = self._known[ways] = tuple(
                (number, template)
                for number, rule in enumerate(self._rules)
                for template in prepare(rule.formula, static, rule.bound).templates
                if _about(template) == set(everything)
            )
        return found

    def _static(self, ways: tuple[Key, ...]) -> Static:
        agents = tuple(Agent(f"v{number}", self._junction.every_way[way]) for number, way in enumerate(ways))
        zone = np.zeros((1, len(agents)), dtype=np.int8)
        return extract(Run("live", self._junction, agents, zone, np.array([self._lights], dtype=np.int8)))


def _about(template: Template) -> set[int]:
    """Return the columns of the agents in the variables and in the atoms of an instance."""
    named = {e.index for member in template.members for _, e in member.binding if e.sort == Sort.AGENT}
    return named | {e.index for e in agents_of(template.formula)}


def _refuse_crowds(rule: Rule, static: Static) -> None:
    for instance in unfold(rule.formula, static).instances:
        named = {e for _, e in instance.binding if e.sort == Sort.AGENT}
        if any(len(named | set(agents_of(part))) > 2 for part in split(instance.formula)) or _exists(rule.formula):
            raise FormulaError(
                f"rule {rule.name!r} is about more than two vehicles at once, and who comes later would count: "
                "give the monitor its agents"
            )


def _exists(formula: f.Formula) -> bool:
    """Return whether a formula has an existential quantifier over agents."""
    if isinstance(formula, f.Exists) and any(v.sort == Sort.AGENT for v in formula.variables):
        return True
    return any(_exists(child) for child in f.children(formula))

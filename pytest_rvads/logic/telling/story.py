"""The values from which a verdict is written, and the sentences that several texts share."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from pytest_rvads.logic.judging.cycle import Cycle
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.judging.judge import Judgement, Near, asked
from pytest_rvads.logic.judging.prepare import Template
from pytest_rvads.logic.judging.responsibility import is_about
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.shape import Kind
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.logic.telling.phrase import Naming, element_name, literal, say
from pytest_rvads.runs.run import Run

__all__ = ["Story", "bound_names", "happened"]

_ORDER = (Status.FAIL, Status.OPEN, Status.UNSURE, Status.PASS, Status.NA)
_WORDS = {Status.FAIL: "fail", Status.OPEN: "open", Status.UNSURE: "unsure", Status.PASS: "pass", Status.NA: "not triggered"}


@dataclass(slots=True)
class Story:
    """The judgement of a run by a rule, with everything that the verdict reports."""

    rule: Rule
    run: Run
    status: Status
    found: tuple[Judgement, ...] = ()
    values: Values | None = None
    reason: str = ""
    collapsed: int = 0
    cycle: Cycle | None = None
    near: Near | None = None
    notes: list[str] = field(default_factory=list)
    asked: bool = True
    """Whether an instance bound the subject to act."""
    unavoidable: bool = False
    """Whether no vehicle could have kept the rule."""
    provoked: bool = False
    """Whether the subject caused no part of the violation or open obligation."""

    @property
    def subject(self) -> str | None:
        """The vehicle under test among traffic, or None."""
        return self.run.subject

    @property
    def counts(self) -> dict[str, int]:
        """Number of instances by outcome."""
        numbers = Counter(_WORDS[j.status] for j in self.found)
        return {word: numbers[word] for word in _WORDS.values() if numbers[word]}

    def kept(self) -> tuple[int, int]:
        """Return the number of kept instances and of all instances; with a subject, of the instances that bind the subject."""
        judgements, run = self.found, self.run
        if self.subject is None or self.values is None:
            return sum(j.status is Status.PASS for j in judgements), len(judgements)
        me = next(column for column, agent in enumerate(run.agents) if agent.name == self.subject)
        binding = [j for j in judgements if any(e.index == me for m in j.template.members for e in m.bound)]
        return sum(j.status is Status.PASS and asked(j.template, self.values, me) for j in binding), len(binding)

    def ordered(self) -> list[Judgement]:
        """Return the instances sorted by severity, then time; instances that the subject is to blame for come first."""

        def key(j: Judgement) -> tuple[bool, int, int]:
            tick = j.failed if j.failed is not None else j.trigger
            elsewhere = self.subject is not None and not is_about(j, self.run, self.subject)
            return elsewhere, _ORDER.index(j.status), self.run.steps if tick is None else tick

        return sorted(self.found, key=key)


def bound_names(template: Template) -> tuple[tuple[str, str], ...]:
    """Return the variables of an instance, and the names of the elements that the variables stand for."""
    return tuple((name, element_name(e)) for name, e in template.binding)


def happened(j: Judgement, name: Naming = element_name) -> str:
    """Return the events of the failing tick in words."""
    shape, broken = j.template.shape, dict(j.broken)
    match shape.waits:
        case f.Atom("@", (f.Element() as agent, f.Element() as entrance)) if shape.goes and broken.get(shape.waits) is False:
            goes = say(shape.goes, name, "was")
            if j.together:
                return f"{name(agent)} left {name(entrance)} in the first step in which {goes}, not after it"
            return f"{name(agent)} left {name(entrance)} before {goes}"
        case f.Not(f.Atom("@", (f.Element() as agent, _)) as entered) if shape.goes and broken.get(entered) is True:
            goes = say(shape.goes, lambda e: "it" if e == agent else name(e), "was")
            return f"{name(agent)} entered the junction before {goes}"
    parts = j.template.atoms
    inside = [
        a.terms[0] for a in parts if a.name == "@" and isinstance(a.terms[1], f.Element) and a.terms[1].sort == Sort.JUNCTION
    ]
    if shape.kind is Kind.STATE and len(inside) == len(parts) == 2:
        return f"{', '.join(name(e) for e in inside if isinstance(e, f.Element))} both in junction"
    return ", ".join(literal(a, v, name) for a, v in j.broken)

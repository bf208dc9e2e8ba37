"""What the command line asks of the logic: judging runs, listing rules."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Sequence

from pytest_rvads.conduct.validate import validate
from pytest_rvads.errors import RunError
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.logic.rules.book import current_book, rulebook, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.rulefile import load_rules
from pytest_rvads.runs.run import Run

__all__ = ["check_runs", "doubts", "list_rules", "named_rules"]


def named_rules(names: Sequence[str]) -> tuple[Rule, ...]:
    """Return the rules of names that people give: of a rule, a rulebook, or a file of rules (``.rules``), each rule once.

    Raises:
        FormulaError: an unknown name, or a file of rules with a mistake.
    """
    found: list[Rule] = []
    for name in names:
        found += load_rules(name) if name.endswith(".rules") else rules_for(name)
    return rules_for(found)


def doubts(runs: Sequence[Run]) -> list[str]:
    """Return a warning per thing that breaks the semantic model in runs made elsewhere; to be told before they are judged."""
    return [f"{run.label}: {finding}" for run in runs for finding in validate(run)]


def check_runs(runs: Sequence[Run], spec: str | Rule | Sequence[str | Rule] = "paper") -> dict[str, dict[str, Verdict]]:
    """Judge runs by rules; the result is by the label of the run and the name of the rule.

    Raises:
        FormulaError: an unknown rule.
        RunError: two runs have the same label, so that one verdict would hide the other.
    """
    rules = rules_for(spec)
    for label, count in Counter(run.label for run in runs).items():
        if count > 1:
            raise RunError(f"{count} runs are called {label!r}: give each its own name")
    return {run.label: {rule.name: check(run, rule) for rule in rules} for run in runs}


def list_rules() -> str:
    """Return all rules by rulebook: meaning, formula, source, who is responsible."""
    blocks = []
    for book in ("paper", "variants", "road"):
        blocks.append(f"rulebook {book}")
        blocks += [_entry(r) for r in rulebook(book)]
    if own := current_book().own:
        blocks += ["your own", *map(_entry, own)]
    return "\n".join(blocks)


def _entry(rule: Rule) -> str:
    kind = f" [{', '.join(rule.kinds)}]" if rule.about else ""
    lines = [f"  {rule.name}  {rule.title}{kind}", f"      {rule.meaning}" if rule.meaning else ""]
    lines += [f"      {line}" for line in textwrap.wrap(rule.text, 110, break_on_hyphens=False)]
    facts = [
        f"responsible: {rule.responsible}" if rule.responsible else "",
        f"tie window: {rule.tie:g} s" if rule.tie else "",
        f"source: {rule.source}" if rule.source else "",
        f"requirement: {rule.requirement}" if rule.requirement else "",
    ]
    return "\n".join(filter(None, [*lines, *(f"      {fact}" for fact in facts if fact)]))

"""Answers of the command line to questions about rules."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from pytest_rvads.logic.rules.book import current_book, rulebook, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.rulefile import load_rules

__all__ = ["list_rules", "named_rules"]


def named_rules(names: Sequence[str]) -> tuple[Rule, ...]:
    """Return the rules that names denote: of a rule, a rulebook, or a file of rules (``.rules``), each rule once.

    Raises:
        FormulaError: a name is unknown, or a file of rules has a mistake.
    """
    rules: list[Rule] = []
    for name in names:
        rules += load_rules(name) if name.endswith(".rules") else rules_for(name)
    return rules_for(rules)


def list_rules() -> str:
    """Return a text on all rules by rulebook: meaning, formula, source, responsible role."""
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

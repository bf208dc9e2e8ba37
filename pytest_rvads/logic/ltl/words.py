"""Monitoring words of propositions: one formula, many words, in the format of ``rvads monitor --jsonl``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import Struct

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.finite import settle, settle_empty
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth, synthesize
from pytest_rvads.logic.ltl.monitor import encode, run_machine
from pytest_rvads.logic.ltl.parser import parse_ltl
from pytest_rvads.support.decoding import decode
from pytest_rvads.support.errors import FormulaError
from pytest_rvads.support.wording import printable

__all__ = ["answer", "holds_on", "verdicts_on"]

Word = Sequence[Sequence[str]]
"""Per state, the propositions that hold in the state."""


class _Named(Struct, frozen=True):
    id: str | int | float | None = None


class _Task(Struct, frozen=True):
    formula: str
    words: list[list[list[str]]] = []


def verdicts_on(machine: Machine, word: Word) -> list[Truth]:
    """Return the LTL3 verdict after every non-empty prefix of a word."""
    if not word:
        return []
    letters = encode(machine, _arrays(machine.formula, word), len(word))
    return [Truth(v) for v in machine.output[run_machine(machine, letters[None, :])[0]].tolist()]


def holds_on(formula: f.Formula, word: Word) -> bool:
    """Return the truth of a formula on a finite word, by finite-trace semantics; in an empty word no proposition holds."""
    return bool(settle(formula, _arrays(formula, word), len(word))[0]) if word else settle_empty(formula)


def _arrays(formula: f.Formula, word: Word) -> dict[f.Atom, Any]:
    states = [frozenset(state) for state in word]
    return {a: np.array([a.name in state for state in states], dtype=np.bool_) for a in f.atoms(formula)}


def answer(line: bytes) -> dict[str, Any]:
    """Answer one line of ``rvads monitor --jsonl``.

    Args:
        line: a JSON object ``{"id", "formula", "words"}``.

    Returns:
        ``{"id", "states", "verdicts", "finite"}``, or ``{"id", "error"}`` if the line can't be read or the formula is refused.
        The id, a text or number, is None if the id can't be read.
    """
    name = None
    try:
        name = decode(line, _Named, "task", FormulaError).id
        task = decode(line, _Task, "task", FormulaError)
        formula = parse_ltl(task.formula)
        machine = synthesize(formula)
        verdicts = [[str(v) for v in verdicts_on(machine, word)] for word in task.words]
        finite = [holds_on(formula, word) for word in task.words]
    except FormulaError as error:
        return {"id": name, "error": printable(str(error))}
    return {"id": name, "states": machine.states, "verdicts": verdicts, "finite": finite}

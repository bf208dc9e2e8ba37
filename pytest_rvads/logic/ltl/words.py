"""Monitoring words of propositions: one formula, many words, as ``rvads monitor --jsonl`` reads and writes them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from pytest_rvads.errors import FormulaError
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.finite import settle, settle_empty
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth, synthesize
from pytest_rvads.logic.ltl.monitor import encode, run_machine
from pytest_rvads.logic.ltl.parser import parse_ltl

__all__ = ["answer", "holds_on", "verdicts_on"]

Word = Sequence[Sequence[str]]
"""Per state the propositions that hold in it."""


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


def answer(line: str) -> dict[str, Any]:
    """Answer one line of ``rvads monitor --jsonl``.

    Args:
        line: a JSON object ``{"id", "formula", "words"}``.

    Returns:
        ``{"id", "states", "verdicts", "finite"}``, or ``{"id", "error"}`` for what can't be understood or is refused.
    """
    try:
        task = json.loads(line)
    except (ValueError, RecursionError) as error:
        return {"id": None, "error": f"not a JSON object: {error}"}
    name = task.get("id") if isinstance(task, dict) else None
    try:
        formula, words = _read(task)
        machine = synthesize(formula)
        verdicts = [[str(v) for v in verdicts_on(machine, word)] for word in words]
        finite = [holds_on(formula, word) for word in words]
    except FormulaError as error:
        return {"id": name, "error": str(error)}
    return {"id": name, "states": machine.states, "verdicts": verdicts, "finite": finite}


def _read(task: object) -> tuple[f.Formula, list[list[list[str]]]]:
    if not isinstance(task, dict) or not isinstance(task.get("formula"), str):
        raise FormulaError('expected an object {"id", "formula", "words"} whose formula is a text')
    words = task.get("words", [])
    fine = isinstance(words, list) and all(
        isinstance(word, list) and all(isinstance(s, list) and all(isinstance(p, str) for p in s) for s in word) for word in words
    )
    if not fine:
        raise FormulaError('"words" must be a list of words, a word a list of states, a state a list of propositions')
    return parse_ltl(task["formula"]), words

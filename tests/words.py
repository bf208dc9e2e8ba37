"""The verdicts of monitors on words, and the truth of formulas on whole words.

A word is a sequence of states, each given by its true propositions.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth, encode, run_machine, settle, settle_empty

Word = Sequence[Sequence[str]]


def verdicts_on(machine: Machine, word: Word) -> list[Truth]:
    """Return the LTL3 verdict after every non-empty prefix of a word."""
    if not word:
        return []
    letters = encode(machine, _arrays(machine.formula, word), len(word))
    return [Truth(v) for v in machine.output[run_machine(machine, letters[None, :])[0]].tolist()]


def holds_on(formula: f.Formula, word: Word) -> bool:
    """Return the truth of a formula on a finite word, by finite-trace semantics; in an empty word no proposition is true."""
    return bool(settle(formula, _arrays(formula, word), len(word))[0]) if word else settle_empty(formula)


def _arrays(formula: f.Formula, word: Word) -> dict[f.Atom, Any]:
    states = [frozenset(state) for state in word]
    return {a: np.array([a.name in state for state in states], dtype=np.bool_) for a in f.atoms(formula)}

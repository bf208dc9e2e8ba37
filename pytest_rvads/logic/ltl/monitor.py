"""Running monitors: state by state, and over all instances and states of a run at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import evaluate, holds
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth

__all__ = ["Monitor", "encode", "run_machine"]


_STRETCH = 100
"""A stretch of equal letters costs about as much as stepping through this number of states separately."""


class Monitor:
    """A monitor on one word: `step` takes constant time, whatever states came before."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self._delta: list[list[int]] = machine.delta.tolist()
        self._output: list[Truth] = [Truth(v) for v in machine.output.tolist()]
        self._letters: dict[frozenset[str], int] = {}
        self._state = 0

    @property
    def verdict(self) -> Truth:
        """The present verdict."""
        return self._output[self._state]

    def reset(self) -> None:
        """Return to the initial state."""
        self._state = 0

    def step(self, true: Iterable[str]) -> Truth:
        """Read one state, given by the propositions that hold in the state, spelt as formulas print them."""
        names = true if isinstance(true, frozenset) else frozenset(true)
        letter = self._letters.get(names)
        if letter is None:
            held = frozenset(a for a in self.machine.atoms if str(a) in names)
            code = sum(1 << k for k, g in enumerate(self.machine.guards) if holds(g, held))
            letter = self._letters[names] = self.machine.letter(code)
        self._state = self._delta[self._state][letter]
        return self._output[self._state]


def encode(machine: Machine, values: Mapping[f.Atom, NDArray[np.bool_]], steps: int) -> NDArray[np.int32]:
    """Return the letter of every state, shape ``(steps,)``, from the truth values of the machine's atoms."""
    codes = np.zeros(steps, dtype=np.int64)
    for k, guard in enumerate(machine.guards):
        codes |= evaluate(guard, values, (steps,)).astype(np.int64) << k
    if len(machine.lookup):
        return machine.lookup[codes]
    return np.searchsorted(machine.codes, codes).astype(np.int32)


def run_machine(machine: Machine, letters: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the states of a machine after every state of many words, shape ``(words, steps)``.

    Between two changes of letter the same letters repeat. A monitor of LTL then settles (its language is star-free), so only the
    first few repetitions are computed. If letters change often, every word is walked separately.

    Args:
        machine: the monitor, the same for all words.
        letters: the letters of every word, shape ``(words, steps)``.
    """
    words, steps = letters.shape
    states = np.zeros((words, steps), dtype=np.int32)
    if not words or not steps:
        return states
    changes = np.flatnonzero((letters[:, 1:] != letters[:, :-1]).any(axis=0)) + 1
    if len(changes) * _STRETCH > words * steps:
        table = machine.delta.tolist()
        for row, word in zip(states, letters.tolist(), strict=True):
            row[:] = list(accumulate(word, lambda state, letter: table[state][letter], initial=0))[1:]
        return states
    starts = [0, *changes.tolist()]
    state = np.zeros(words, dtype=np.int32)
    for start, end in zip(starts, [*starts[1:], steps], strict=True):
        letter = letters[:, start]
        for k in range(start, end):
            after = machine.delta[state, letter]
            states[:, k] = after
            if (after == state).all():
                states[:, k + 1 : end] = after[:, None]
                break
            state = after
    return states

"""Evaluates atoms without variables on a run: a truth value per state."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blocks import Block, Signal
from pytest_rvads.logic.conduct.cast import everybody
from pytest_rvads.logic.conduct.predicates import ticks
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, at, word_of
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import FormulaError

OPERATORS: Mapping[str, Callable[[Any, Any], NDArray[np.bool_]]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


class Values(Mapping[f.Atom, NDArray[np.bool_]]):
    """The truth values of atoms on a run, arrays of shape ``(steps,)``, each computed at its first use.

    Waiting times are equal if they differ by at most `tie` [s]. For `standing` see `check`.
    """

    def __init__(self, run: Run, tie: float = 0.0, *, standing: bool = False) -> None:
        self.run = run
        readers = {name: attribute.standing for name, attribute in ATTRIBUTES.items() if attribute.standing and standing}
        self._readers: dict[str, Callable[[Run, int], NDArray[Any]]] = readers
        self.tie = tie
        self._ticks = ticks(run, tie)
        self._truths: dict[f.Atom, NDArray[np.bool_]] = {}

    def __getitem__(self, atom: f.Atom) -> NDArray[np.bool_]:
        truths = self._truths.get(atom)
        if truths is not None:
            return truths
        if atom.name in OPERATORS:
            compare, (left, right) = OPERATORS[atom.name], atom.terms
            if isinstance(left, f.Attr) and isinstance(right, f.Attr) and ATTRIBUTES[left.name].waited:
                longer = self._read(left) - self._read(right)
                truths = compare(np.where(np.abs(longer) <= self._ticks, 0, longer), 0)
            else:
                truths = compare(self._operand(left, right), self._operand(right, left))
        else:
            word = word_of(atom)
            if word is None or word.holds is None:
                raise FormulaError(f"nothing tells the value of {atom} on a run: register the predicate {atom.name!r}")
            truths = word.on(self.run, *word.arguments(atom))
        self._truths[atom] = truths
        return truths

    @property
    def steps(self) -> int:
        """Number of states."""
        return self.run.steps

    def within(self, begin: int, end: int) -> Values | Part:
        """Return the truth values from tick `begin` up to, but not including, tick `end`."""
        return self if (begin, end) == (0, self.run.steps) else Part(self, begin, end)

    def untied(self) -> Values:
        """Return the truth values with a tie window of 0, in which waiting times count as equal only if they are equal."""
        exact = copy(self)
        exact.tie, exact._ticks = 0.0, 0
        exact._truths = {
            atom: values
            for atom, values in self._truths.items()
            if not any(isinstance(term, f.Attr) and ATTRIBUTES[term.name].waited for term in atom.terms)
        }
        return exact

    def __iter__(self) -> Iterator[f.Atom]:
        return iter(self._truths)

    def __len__(self) -> int:
        return len(self._truths)

    def _operand(self, term: f.Term, other: f.Term) -> NDArray[Any] | float:
        """Return the numbers of a side of a comparison; the attribute on the other side gives the number of a named value."""
        match term, other:
            case f.Number(value), _:
                return value
            case f.Value(name), f.Attr(_, asked) if codes := ATTRIBUTES[asked].codes:
                return codes(name)
            case f.Attr(_, asked), _:
                return _seconds(asked, self._read(term), self.run.dt)
        raise FormulaError(f"{term} has no value to compare")

    def _read(self, term: f.Attr) -> NDArray[Any]:
        if not isinstance(term.of, f.Element):
            raise FormulaError(f"{term} has no value as long as {term.of} is a variable")
        read = self._readers.get(term.name) or ATTRIBUTES[term.name].read
        return read(self.run, term.of.index)


def _seconds(attribute: str, values: NDArray[Any], dt: float) -> NDArray[Any]:
    """Return the values of an attribute, with waiting times turned from ticks into seconds."""
    # Rounded, so that a waiting time of 300 ticks of 0.01 s equals exactly 3 s.
    return np.round(values * dt, 9) if ATTRIBUTES[attribute].waited else values


def signal_of(atom: f.Atom, entrances: int, ticks: int) -> Signal[NDArray[np.bool_]] | None:
    """Return the signal (a quantity per state) with the truth values of an atom; None if the atom has no signal."""
    word = word_of(atom)
    if word is not None and isinstance(word.holds, Signal):
        return word.holds
    match atom.name, atom.terms:
        case "@", (f.Element(Sort.AGENT), f.Element() as place):
            return at(place, entrances)
        case _, (f.Attr(f.Element(Sort.AGENT, one), left), f.Attr(f.Element(Sort.AGENT, two), right)) if one != two:
            return _between(atom.name, left, right, ticks)
        case _, (f.Attr(f.Element(), asked), f.Number(value)):
            return _against(atom.name, asked, value)
        case _, (f.Attr(f.Element(), asked), f.Value(name)) if codes := ATTRIBUTES[asked].codes:
            return _against(atom.name, asked, codes(name))
    return None


@lru_cache(maxsize=256)
def _between(sign: str, left: str, right: str, ticks: int) -> Signal[NDArray[np.bool_]]:
    """Return the signal that compares an attribute of a pair's first vehicle with an attribute of its second vehicle."""

    def work(block: Block) -> NDArray[np.bool_]:
        if ATTRIBUTES[left].waited:
            return OPERATORS[sign](_order(left, right, ticks)(block), 0)
        both = block.cast.static(everybody)
        one, two = both.first(ATTRIBUTES[left].read(block)), both.second(ATTRIBUTES[right].read(block))
        return OPERATORS[sign](one, _seconds(right, two, block.dt))

    return Signal(work, pairs=everybody)


@lru_cache(maxsize=256)
def _order(left: str, right: str, ticks: int) -> Signal[NDArray[np.int8]]:
    """Return the signal that is 1 where a pair's first vehicle waited longer, -1 where the second waited longer, 0 for a tie."""

    def work(block: Block) -> NDArray[np.int8]:
        both = block.cast.static(everybody)
        longer = both.first(ATTRIBUTES[left].read(block)) - both.second(ATTRIBUTES[right].read(block))
        order: NDArray[np.int8] = (longer > ticks).view(np.int8) - (longer < -ticks).view(np.int8)
        return order

    return Signal(work, pairs=everybody)


@lru_cache(maxsize=256)
def _against(sign: str, attribute: str, constant: float) -> Signal[NDArray[np.bool_]]:
    """Return the signal (a quantity per state) that compares an attribute with a constant."""

    def work(block: Block) -> NDArray[np.bool_]:
        return OPERATORS[sign](_seconds(attribute, ATTRIBUTES[attribute].read(block), block.dt), constant)

    return Signal(work, of_entrances=ATTRIBUTES[attribute].read.of_entrances)


class Part(Mapping[f.Atom, NDArray[np.bool_]]):
    """The truth values of atoms in the part of a run from tick `begin` up to, but not including, tick `end`, counted from 0."""

    def __init__(self, values: Values, begin: int, end: int) -> None:
        self.run = values.run
        self.steps = end - begin
        self._whole, self._part = values, slice(begin, end)

    def __getitem__(self, atom: f.Atom) -> NDArray[np.bool_]:
        return self._whole[atom][self._part]

    def __iter__(self) -> Iterator[f.Atom]:
        return iter(self._whole)

    def __len__(self) -> int:
        return len(self._whole)

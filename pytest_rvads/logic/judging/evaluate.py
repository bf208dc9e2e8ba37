"""Truth values of ground atoms on a run, one per state."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.bodies import collide
from pytest_rvads.conduct.lane import off_lane, off_route
from pytest_rvads.conduct.predicates import at_entrance, colour, in_junction, on_approach, on_exit, speed, ticks
from pytest_rvads.conduct.priority import obstructs, owes
from pytest_rvads.conduct.progress import blocks, idles, inside, may_go
from pytest_rvads.conduct.standing import speeding, standing_time, stopped
from pytest_rvads.conduct.stretches import meet
from pytest_rvads.errors import FormulaError, RunError
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.sorts import Sort
from pytest_rvads.logic.rules.vocabulary import user_predicate
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour

__all__ = ["Values"]

_OPERATORS: Mapping[str, Callable[[Any, Any], Any]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_CONDUCT: Mapping[str, Callable[..., NDArray[np.bool_]]] = {
    "stopped": stopped,
    "inside": inside,
    "blocks": blocks,
    "may_go": may_go,
    "idles": idles,
    "off_lane": off_lane,
    "off_route": off_route,
    "speeding": speeding,
    "meet": meet,
    "collide": collide,
    "owes": owes,
    "obstructs": obstructs,
}


class Values(Mapping[f.Atom, NDArray[np.bool_]]):
    """The atoms of a run as arrays of shape ``(steps,)``, each computed when first asked for.

    Args:
        run: the run.
        tie: waiting times that differ by at most this count as equal [s].
        standing: count waiting times from standstill, see `check`.
    """

    def __init__(self, run: Run, tie: float = 0.0, *, standing: bool = False) -> None:
        self.run = run
        self._standing = standing
        self._tie = ticks(run, tie)
        self._known: dict[f.Atom, NDArray[np.bool_]] = {}

    def __getitem__(self, atom: f.Atom) -> NDArray[np.bool_]:
        found = self._known.get(atom)
        if found is None:
            found = self._known[atom] = self._evaluate(atom)
        return found

    def __iter__(self) -> Iterator[f.Atom]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)

    def _evaluate(self, atom: f.Atom) -> NDArray[np.bool_]:
        run = self.run
        match atom.name, atom.terms:
            case "@", (f.Element(Sort.AGENT, agent), f.Element(sort, place)):
                if sort is Sort.JUNCTION:
                    return in_junction(run, agent)
                if sort is Sort.ENTRANCE:
                    return at_entrance(run, agent)
                leads_in = sort is Sort.ROAD and place < len(run.junction.entrances)
                return on_approach(run, agent) if leads_in else on_exit(run, agent)
            case (("=" | "!="), (f.Attr(f.Element(_, light), "cl"), f.Word(name))) | (
                ("=" | "!="),
                (f.Word(name), f.Attr(f.Element(_, light), "cl")),
            ):
                wanted = colour(run, light, Colour[name.upper()])
                return wanted if atom.name == "=" else ~wanted
            case (("=" | "!="), (f.Attr(f.Element(_, one), "cl"), f.Attr(f.Element(_, two), "cl"))):
                alike: NDArray[np.bool_] = run.lights[:, one] == run.lights[:, two]
                return alike if atom.name == "=" else ~alike
            case name, (f.Attr(f.Element(_, one), "wt"), f.Attr(f.Element(_, two), "wt")) if name in _OPERATORS:
                return self._waits(name, self._wt(one) - self._wt(two))
            case name, (left, right) if name in _OPERATORS:
                found: NDArray[np.bool_] = _OPERATORS[name](self._number(left), self._number(right))
                return found
        columns = [t.index for t in atom.terms if isinstance(t, f.Element)]
        if atom.name in _CONDUCT:
            return _CONDUCT[atom.name](run, *columns)
        if atom.name == "conflict":  # decided before, wherever the geometry is known
            raise RunError("the run holds no geometry of its junction")
        predicate = user_predicate(atom.name)
        if predicate is None:
            raise FormulaError(f"nothing tells the value of {atom} on a run: register the predicate {atom.name!r}")
        return predicate(run, *columns)

    def _wt(self, agent: int) -> NDArray[np.int32]:
        return standing_time(self.run, agent) if self._standing else self.run.wt[:, agent]

    def _waits(self, name: str, difference: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Compare waiting times up to the tie window, given how much longer the first is [ticks]."""
        tie = self._tie
        match name:
            case "=":
                return np.abs(difference) <= tie
            case "!=":
                return np.abs(difference) > tie
            case "<":
                return difference < -tie
            case "<=":
                return difference <= tie
            case ">":
                return difference > tie
        return difference >= -tie

    def _number(self, term: f.Term) -> NDArray[np.float64] | float:
        match term:
            case f.Number(value):
                return value
            case f.Attr(f.Element(_, agent), "wt"):
                # Rounded, so that a waiting time of 300 ticks of 0.01 s equals 3 s.
                return np.round(self._wt(agent) * self.run.dt, 9)
            case f.Attr(f.Element(_, agent), "sp"):
                return speed(self.run, agent)
        raise FormulaError(f"{term} is not a number")

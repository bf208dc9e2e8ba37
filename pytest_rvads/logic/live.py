"""A rule on a run while it is being produced: one state at a time, constant time per state."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pytest_rvads.errors import RunError
from pytest_rvads.logic import formula as f
from pytest_rvads.logic.evaluate import Values
from pytest_rvads.logic.ltl3 import Truth
from pytest_rvads.logic.monitor import Monitor
from pytest_rvads.logic.prepare import Template, prepare
from pytest_rvads.logic.rules import Rule, get_rule
from pytest_rvads.logic.story import bound_names
from pytest_rvads.maps.junction import Junction
from pytest_rvads.semantics.conduct import BLOCKING_TIME, stands_inside, stopped
from pytest_rvads.semantics.predicates import extract
from pytest_rvads.semantics.run import DT, Collision, Run
from pytest_rvads.semantics.states import Agent, Zone

__all__ = ["RuleMonitor"]


class RuleMonitor:
    """Follows a rule through a run that is not over: `step` says whether it can still be kept.

    What atoms need of the past (waiting times, having stopped, standing in the junction) is carried along, so that a state
    costs the same however long the run is. A predicate of your own sees one state only. How a run ended, and why, is for
    `check` to say once it is over.

    Args:
        rule: a rule or the name of one.
        junction: where the vehicles drive.
        agents: the vehicles, in the order of the columns that `step` gets.
        dt: time between two states [s].
        speed_limit: [m/s], for rules that ask for it.
        vehicle_size: length and width of the vehicles [m], likewise.

    Raises:
        FormulaError: an unknown rule, or one whose monitor would be too large.
        RunError: the rule is about another kind of junction.
    """

    def __init__(
        self,
        rule: str | Rule,
        junction: Junction,
        agents: Sequence[Agent],
        *,
        dt: float = DT,
        speed_limit: float | None = None,
        vehicle_size: tuple[float, float] | None = None,
    ) -> None:
        self.rule = get_rule(rule) if isinstance(rule, str) else rule
        if self.rule.about not in (None, junction.control):
            raise RunError(f"{self.rule.name} is about junctions with {self.rule.about}, this one has {junction.control}")
        self._junction, self._agents, self._dt = junction, tuple(agents), dt
        size = vehicle_size and dict(zip(("length", "width"), vehicle_size, strict=True))
        self._meta = {"speed_limit": speed_limit, "vehicle": size}
        self._monitors: tuple[tuple[Template, Monitor], ...] | None = None
        self._past: tuple[f.Atom, ...] = ()
        self._wt = np.full(len(self._agents), -1, dtype=np.int32)
        self._stopped: dict[int, bool] = {}
        self._standing: dict[int, int] = {}

    @property
    def verdict(self) -> Truth:
        """``F`` when an instance is violated, whatever follows; ``T`` when none can be any more; else ``?``."""
        found = {monitor.verdict for _, monitor in self._monitors or ()}
        if Truth.FALSE in found:
            return Truth.FALSE
        return Truth.TRUE if self._monitors is not None and found <= {Truth.TRUE} else Truth.UNKNOWN

    @property
    def violated(self) -> tuple[dict[str, str], ...]:
        """Of every violated instance, the variables of the rule and what they stand for."""
        return tuple(dict(bound_names(t)) for t, monitor in self._monitors or () if monitor.verdict is Truth.FALSE)

    def step(
        self,
        zone: ArrayLike,
        lights: ArrayLike | None = None,
        *,
        station: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        collisions: Iterable[tuple[str, str]] | None = None,
    ) -> Truth:
        """Read one state and return the verdict so far.

        Args:
            zone: `Zone` of every agent, shape ``(agents,)``.
            lights: `Colour` at every entrance, shape ``(entrances,)``; none by default.
            station: along the itinerary, 0 at the entrance vertex, shape ``(agents,)`` [m].
            speed: forward, shape ``(agents,)`` [m/s].
            collisions: pairs of vehicles that touch for the first time in this state, by name; empty when none do.

        Raises:
            RunError: an array of another shape, or one missing that the rule asks for.
        """
        run = self._state(zone, lights, station, speed, collisions)
        if self._monitors is None:
            templates = prepare(self.rule.formula, extract(run)).templates
            self._monitors = tuple((t, Monitor(t.machine)) for t in templates)
            self._past = tuple(dict.fromkeys(a for t in templates for a in t.atoms if a.name in ("stopped", "blocks")))
        here = run.zone[0] == Zone.ENTRANCE
        self._wt = np.where(here & (self._wt >= 0), self._wt + 1, 0).astype(np.int32)
        run.__dict__["wt"] = self._wt[None]  # of the whole run, not of one state
        past = {a: self._look_back(run, a) for a in self._past}
        values = Values(run, self.rule.tie)
        for template, monitor in self._monitors:
            true = (f"p{k}" for k, a in enumerate(template.atoms) if (past[a] if a in past else values[a][0]))
            monitor.step(frozenset(true))
        return self.verdict

    def _state(
        self,
        zone: ArrayLike,
        lights: ArrayLike | None,
        station: ArrayLike | None,
        speed: ArrayLike | None,
        collisions: Iterable[tuple[str, str]] | None,
    ) -> Run:
        """Return a run of one state."""
        count, ways = len(self._agents), self._junction.ways
        return Run(
            "live",
            self._junction,
            self._agents,
            _row("zone", zone, count).astype(np.int8),
            _row("lights", np.zeros(ways) if lights is None else lights, ways).astype(np.int8),
            self._dt,
            station=None if station is None else _row("station", station, count),
            speed=None if speed is None else _row("speed", speed, count),
            pose=None if collisions is None else np.zeros((1, count, 3)),
            collisions=tuple(Collision(0.0, pair, 0.0) for pair in collisions or ()),
            meta=self._meta,
        )

    def _look_back(self, run: Run, atom: f.Atom) -> bool:
        """Return the value of an atom that depends on earlier states; called once per state and atom."""
        agent = next(t.index for t in atom.terms if isinstance(t, f.Element))
        if atom.name == "stopped":
            here = run.zone[0, agent] == Zone.ENTRANCE
            self._stopped[agent] = bool(here and (self._stopped.get(agent) or stopped(run, agent)[0]))
            return self._stopped[agent]
        self._standing[agent] = self._standing.get(agent, 0) + 1 if stands_inside(run, agent)[0] else 0
        return self._standing[agent] * self._dt > BLOCKING_TIME


def _row(name: str, values: ArrayLike, count: int) -> NDArray[np.float64]:
    row = np.asarray(values, dtype=np.float64)
    if row.shape != (count,) or not np.isfinite(row).all():
        raise RunError(f"{name} of a state must be {count} finite numbers, got {values!r:.60}")
    return row[None]

"""A rule on a run while it is being produced: one state at a time, constant time per state."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pytest_rvads.conduct.following import Past
from pytest_rvads.conduct.predicates import extract
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.judging.prepare import Template, prepare
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.logic.ltl.monitor import Monitor
from pytest_rvads.logic.rules.book import RuleBook, get_rule
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.telling.story import bound_names
from pytest_rvads.runs.run import DT, Collision, Facts, Run
from pytest_rvads.runs.states import Agent

__all__ = ["RuleMonitor"]


class RuleMonitor:
    """Follows a rule through a run that is not over: `step` says whether it can still be kept.

    What atoms need of the past (waiting times, having stopped, time lost, ways taken) is carried along, so that a state costs
    the same however long the run is. A predicate of your own sees one state only, unless it is given with `follow`. How a run
    ended, and why, is for `check` to say once it is over.

    Args:
        rule: a rule or the name of one.
        junction: where the vehicles drive.
        agents: the vehicles, in the order of the columns that `step` gets.
        dt: time between two states [s].
        speed_limit: [m/s], for rules that ask for it.
        vehicle_size: length and width of the vehicles [m], likewise; one pair for all, or one for each.
        book: to look the rule up in; by default the one that is open, with what you registered.

    Raises:
        FormulaError: an unknown rule, or one whose monitor would be too large.
        RunError: the rule is about another kind of junction.
    """

    def __init__(  # noqa: PLR0913 - what a monitor has to know, the rarer part by keyword
        self,
        rule: str | Rule,
        junction: Junction,
        agents: Sequence[Agent],
        *,
        dt: float = DT,
        speed_limit: float | None = None,
        vehicle_size: tuple[float, float] | Sequence[tuple[float, float]] | None = None,
        book: RuleBook | None = None,
    ) -> None:
        self.rule = get_rule(rule, book)
        if not self.rule.concerns(junction):
            kinds = " or ".join(self.rule.kinds) + (" and several lanes on an arm" if self.rule.lanes else "")
            raise RunError(f"{self.rule.name} is about junctions with {kinds}, this one has {junction.control}")
        self._junction, self._agents, self._dt = junction, tuple(agents), dt
        if vehicle_size is not None:
            sizes = _sizes(vehicle_size, len(self._agents))
            self._agents = tuple(replace(a, size=size) for a, size in zip(self._agents, sizes, strict=True))
        self._facts = Facts(speed_limit=speed_limit)
        self._monitors: tuple[tuple[Template, Monitor], ...] | None = None
        self._past = Past(len(self._agents))
        self._followed: dict[f.Atom, Callable[[Run], bool]] = {}

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
        pose: ArrayLike | None = None,
        collisions: Iterable[tuple[str, str]] | None = None,
    ) -> Truth:
        """Read one state and return the verdict so far.

        Args:
            zone: `Zone` of every agent, shape ``(agents,)``.
            lights: `Colour` at every entrance, shape ``(entrances,)``; none by default.
            station: along the itinerary, 0 at the entrance vertex, shape ``(agents,)`` [m].
            speed: forward, shape ``(agents,)`` [m/s].
            pose: x [m], y [m], heading [rad] of the reference points, shape ``(agents, 3)``.
            collisions: pairs of vehicles that touch for the first time in this state, by name; empty when none do. None works
                it out from poses and sizes.

        Raises:
            RunError: an array of another shape, or one missing that the rule asks for.
        """
        count, entrances = len(self._agents), len(self._junction.entrances)
        run = Run(
            "live",
            self._junction,
            self._agents,
            _row("zone", zone, (count,)).astype(np.int8),
            _row("lights", np.zeros(entrances) if lights is None else lights, (entrances,)).astype(np.int8),
            self._dt,
            station=None if station is None else _row("station", station, (count,)),
            speed=None if speed is None else _row("speed", speed, (count,)),
            pose=None if pose is None else _row("pose", pose, (count, 3)),
            collisions=None if collisions is None else tuple(Collision(0.0, pair, 0.0) for pair in collisions),
            facts=self._facts,
        )
        self._past.carry(run)
        if self._monitors is None:
            templates = prepare(self.rule.formula, extract(run), self.rule.bound).templates
            self._monitors = tuple((t, Monitor(t.machine)) for t in templates)
            words = {a: word_of(a) for t in templates for a in t.atoms}
            self._followed = {a: word.follow(run, *word.arguments(a)) for a, word in words.items() if word and word.follow}
        past = {atom: follower(run) for atom, follower in self._followed.items()}
        values = Values(run, self.rule.tie)
        for template, monitor in self._monitors:
            true = (f"p{k}" for k, a in enumerate(template.atoms) if (past[a] if a in past else values[a][0]))
            monitor.step(frozenset(true))
        return self.verdict


def _sizes(given: tuple[float, float] | Sequence[tuple[float, float]], count: int) -> tuple[tuple[float, float], ...]:
    sizes = np.asarray(given, dtype=np.float64)
    if sizes.shape not in ((2,), (count, 2)) or not (np.isfinite(sizes) & (sizes > 0)).all():
        raise RunError(f"vehicle_size must be a length and width [m], for all {count} vehicles or for each, got {given!r:.60}")
    return tuple((float(length), float(width)) for length, width in np.broadcast_to(sizes, (count, 2)))


def _row(name: str, values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    row = np.asarray(values, dtype=np.float64)
    if row.shape != shape or not np.isfinite(row).all():
        what = f"{shape[0]} finite numbers" if len(shape) == 1 else f"finite numbers of shape {shape}"
        raise RunError(f"{name} of a state must be {what}, got {values!r:.60}")
    return row[None]

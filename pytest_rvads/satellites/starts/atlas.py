"""Draws the atlas of a junction: for every line of starts of two vehicles, the leads at which a verdict changes.

A line holds starts (scenarios of two vehicles) by their lead, which says which vehicle is ahead and by how much. Starts are
simulated on a grid. Between two neighbours with different verdicts, bisection locates the change down to two starts that are
`STEP` apart. Verdicts between two simulated starts with equal verdicts are inferred. Random probes show how often an inferred
verdict differs from a simulated verdict.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from random import Random

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.satellites.starts.starts import STEP, Line, lines_at
from pytest_rvads.satellites.starts.trials import Outcomes, Setting, Start, Trial
from pytest_rvads.support.errors import RunError, ScenarioError
from pytest_rvads.support.executors import Progress, spread

LONGEST = 6.0
"""Greatest lead of either vehicle [s]."""
_GRID = round(0.5 / STEP)
"""Distance of the starts that are simulated in any case [steps of `STEP`]."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Neighbouring starts of a line with equal verdicts and an equal order of the vehicles."""

    first: int
    """Least lead of the piece [steps of `STEP`]."""
    last: int
    """Greatest lead of the piece [steps of `STEP`]."""
    start: Start


@dataclass(frozen=True, slots=True)
class Strip:
    """A line of starts, cut into pieces of equal verdicts."""

    line: Line
    pieces: tuple[Piece, ...]
    simulated: tuple[int, ...]
    """Leads of the simulated starts [steps of `STEP`]; the verdicts of all other starts are inferred."""
    unfit: str = ""
    """The reason why the line has no starts; empty for a line with starts."""
    error: str = ""
    """The reason why a run of the line has no verdict, such as a fault of the driver; a strip with an error has no pieces."""

    def at(self, lead: int) -> Piece:
        """Return the piece that contains a lead [steps of `STEP`]."""
        return next(piece for piece in self.pieces if piece.first <= lead <= piece.last)


@dataclass(frozen=True, slots=True)
class Probe:
    """A random start whose simulated verdicts differ from the inferred verdicts, or whose run has no verdict."""

    line: Line
    inferred: Start
    """A simulated start of the piece."""
    lead: int
    """Lead of the random start [steps of `STEP`]."""
    error: str = ""
    """The reason why the run of the random start has no verdict; empty for a run with verdicts."""


@dataclass(frozen=True, slots=True)
class Atlas:
    """The lines of starts of a junction, cut into pieces of equal verdicts, and the random starts with other verdicts."""

    place: Junction
    groups: tuple[tuple[Strip, ...], ...]
    """Strips by group; the lines of a group are equal up to a rotation of the junction."""
    probes: int
    differing: tuple[Probe, ...]

    @property
    def strips(self) -> tuple[Strip, ...]:
        """The strips of all groups (lines of starts, cut into pieces)."""
        return tuple(strip for group in self.groups for strip in group)


def draw_atlas(
    place: Junction,
    setting: Setting,
    *,
    probes: int,
    behaviours: Sequence[str] = (),
    seed: int = 0,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> Atlas:
    """Return the atlas of a junction: on every line of starts, the leads at which a verdict changes."""
    groups = lines_at(place, behaviours=behaviours)
    cut = tuple(spread(partial(_strips, setting), groups, executor, progress, batch=1))
    strips = [strip for group in cut for strip in group if strip.pieces]
    drawn: list[list[int]] = [[] for _ in strips]
    chance = Random(seed)
    for _ in range(probes if strips else 0):
        number = chance.randrange(len(strips))
        low, high = strips[number].pieces[0].first, strips[number].pieces[-1].last
        drawn[number].append(chance.randint(low, high))
    jobs = [(strip, leads) for strip, leads in zip(strips, drawn, strict=True) if leads]
    differing = [probe for found in spread(partial(_probed, setting), jobs, executor, batch=1) for probe in found]
    return Atlas(place, cut, sum(map(len, drawn)), tuple(differing))


def _strips(setting: Setting, group: Sequence[Line]) -> tuple[Strip, ...]:
    """Return the strips (lines cut into pieces) of a group; the changes of its first line guide the search on the other lines."""
    strips: list[Strip] = []
    known: list[int] | None = None
    for line in group:
        trial = Trial(setting, line, LONGEST)
        guesses = known or range(trial.low, trial.high, _GRID)
        leads = sorted({trial.low, trial.high, *(lead for lead in guesses if trial.low <= lead <= trial.high)})
        try:
            for lead in leads:
                trial.start(lead)
            for low, high in pairwise(leads):
                _refine(trial, low, high)
        except ScenarioError as error:
            strips.append(Strip(line, (), (), unfit=str(error)))
            continue
        except RunError as error:
            strips.append(Strip(line, (), tuple(start.lead for start in trial.tried()), error=str(error)))
            continue
        pieces: list[Piece] = []
        for start in trial.tried():
            if pieces and _verdicts(start) == _verdicts(pieces[-1].start):
                pieces[-1] = Piece(pieces[-1].first, start.lead, pieces[-1].start)
            else:
                pieces.append(Piece(start.lead, start.lead, start))
        if known is None:
            known = sorted({lead for p in pieces for lead in (p.first, (p.first + p.last) // 2, p.last)})
        strips.append(Strip(line, tuple(pieces), tuple(start.lead for start in trial.tried())))
    return tuple(strips)


def _refine(trial: Trial, low: int, high: int) -> None:
    """Simulate starts between two leads until simulated neighbours with different verdicts are `STEP` apart."""
    if high - low > 1 and _verdicts(trial.start(low)) != _verdicts(trial.start(high)):
        middle = (low + high) // 2
        trial.start(middle)
        _refine(trial, low, middle)
        _refine(trial, middle, high)


def _verdicts(start: Start) -> tuple[bool, Outcomes]:
    """Return the order of the vehicles and the verdicts at a start, which all starts of a piece have in common."""
    return start.goes, start.outcomes


def _probed(setting: Setting, job: tuple[Strip, Sequence[int]]) -> list[Probe]:
    """Return the random starts of a line whose simulated verdicts differ from the inferred verdicts, or that have no verdict."""
    strip, leads = job
    trial = Trial(setting, strip.line, LONGEST)
    probes = []
    for lead in leads:
        inferred = strip.at(lead).start
        try:
            if _verdicts(inferred) != _verdicts(trial.start(lead)):
                probes.append(Probe(strip.line, inferred, lead))
        except RunError as error:
            probes.append(Probe(strip.line, inferred, lead, str(error)))
    return probes

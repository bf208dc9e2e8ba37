"""The search ``rvads critical --all-lines``: all starts of two vehicles at which a verdict changes, as a page and as JSON.

Starts are simulated on a grid. Between two neighbours with different verdicts, bisection locates the change down to two starts
that are `STEP` apart. Verdicts between two simulated starts with equal verdicts are inferred. Random probes show how often an
inferred verdict differs from a simulated verdict.

The page shows strips, drawn as SVG: rows of coloured bands over a common axis. The axis is the lead of the subject (the vehicle
under test): how much earlier than the other vehicle the subject would arrive at its line [s].
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import groupby, pairwise
from operator import itemgetter
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from pytest_rvads.cli.common import progress, say, warn
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.outcome import Mark, Outcome
from pytest_rvads.report.folders import ROOT, STARTS
from pytest_rvads.report.outline import Block, Head, Picture, Section
from pytest_rvads.satellites.pages.page import rendered
from pytest_rvads.satellites.starts.lines import STEP, Begin, Line, Outcomes, Setting, Start, Trial, lines_at, start_of
from pytest_rvads.support.errors import RunError, RvadsError, ScenarioError
from pytest_rvads.support.executors import Progress, spread
from pytest_rvads.support.storage import check_writable, write_file
from pytest_rvads.support.wording import markup, plural

LONGEST = 6.0
"""Greatest lead of either vehicle [s]."""
_HELP = (
    "A strip holds all starts of two vehicles. At a lead of +1 s, the subject would reach its line 1 s before the other vehicle "
    "if both kept their speeds; where the two have green at different times, 1 s before its light turns yellow. From rest, the "
    "subject stands at its line at the start.",
    "Full colour: the subject enters first. Faint colour: the subject waits. Each tick below a strip is a simulated start. The "
    "verdicts between two ticks with equal verdicts are inferred.",
    "Green: no rule is broken. Orange: the rule that the band names is broken, or a run has no verdict (ERROR). Yellow: the "
    "broken rule is PROVOKED, UNAVOIDABLE, UNSURE or OPEN. The commands below the strips repeat one start of each such band.",
)
_WALKING = "With a pedestrian, the lead is the arrival of the pedestrian minus that of the subject where their ways meet."
_NARROW = 0.05
"""Pieces of strips (leads with equal verdicts) up to this width are ignored when the page merges equal strips into a row [s]."""
_LEFT, _WIDE, _ROW, _LABEL, _BAR, _TOP = 34.0, 1000.0, 62.0, 26.0, 20.0, 66.0
"""Margin and width of the strips, height of a row, of its label, of a strip and of the axis [px].

Labels stand above the strips, and have room for the larger letters of narrow screens.
"""


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
        guesses = known or range(trial.low, trial.high, round(0.5 / STEP))
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


def search_all(
    options: argparse.Namespace,
    places: Iterable[Junction],
    setting: Setting,
    executor: Executor | int | None,
    again: Callable[[Junction, str], str],
) -> int:
    """Search all lines of starts for changes of a verdict, print what was found, write the page, and return the exit status."""
    page = Path(options.output or f"{ROOT}/{STARTS}")
    try:
        check_writable(page)
    except OSError as error:
        raise RvadsError(
            f"-o must name a file to write, got {str(page)!r}, which can't be written ({error.strerror}): name another file"
        ) from error
    certificates: list[dict[str, Any]] = []
    stopped: BaseException | None = None
    differs = False
    for place in places:
        try:
            atlas = draw_atlas(
                place,
                setting,
                probes=options.probes,
                behaviours=options.pedestrians,
                executor=executor,
                progress=partial(progress, what="groups"),
            )
        except (KeyboardInterrupt, RvadsError) as error:  # what was found at the junctions before is shown
            stopped = error
            if certificates:
                warn(f"rvads: INCOMPLETE: the search ended before junction {place.name}")
            break
        certificates.append(_certificate(atlas, setting, options, again))
        without_verdict = [(strip.line, strip.error) for strip in atlas.strips if strip.error]
        without_verdict += [(probe.line, probe.error) for probe in atlas.differing if probe.error]
        differs = differs or bool(atlas.differing or without_verdict)
        if not options.json:
            say(certificates[-1]["summary"])
            for line, reason in without_verdict:
                say(f"{line}: ERROR: {reason}")
    if certificates:
        write_file(page, _page(certificates).encode())
        if options.json:
            print(json.dumps({"version": 1, "atlases": certificates}))
        else:
            say(f"wrote {page}")
    if stopped:
        raise stopped
    return 1 if differs else 0


def _certificate(
    atlas: Atlas, setting: Setting, options: argparse.Namespace, again: Callable[[Junction, str], str]
) -> dict[str, Any]:
    """Return the atlas of a junction (verdicts of all starts of two vehicles) as a JSON object; leads are in seconds."""
    simulated = sum(len(strip.simulated) for strip in atlas.strips)
    drawn = [strip for strip in atlas.strips if strip.pieces]
    inferred = sum(strip.pieces[-1].last - strip.pieces[0].first + 1 - len(strip.simulated) for strip in drawn)
    summary = (
        f"{atlas.place.name}: {plural(len(atlas.strips), 'line')} of starts, {simulated:,} starts simulated, {inferred:,} "
        f"inferred; {len(atlas.differing)} of {atlas.probes:,} random starts differ"
    )
    return {
        "junction": atlas.place.name,
        "digest": atlas.place.digest,
        "driver": options.autopilot or options.sut,
        "simulator": setting.simulator.name,
        **({"pedestrians": options.pedestrians} if options.pedestrians else {}),
        "rules": [rule.name for rule in setting.rules if rule.concerns(atlas.place)],
        "summary": summary,
        "groups": [[_strip(strip, setting, again) for strip in group] for group in atlas.groups],
        "probes": atlas.probes,
        "differing": [
            {"line": str(probe.line), "error": probe.error, **start_of(probe.line, probe.lead, setting)}
            for probe in atlas.differing
        ],
    }


def _strip(strip: Strip, setting: Setting, again: Callable[[Junction, str], str]) -> dict[str, Any]:
    line = strip.line
    pieces = []
    for piece in strip.pieces:
        worst = next(iter(piece.start.failed()), None)
        failed = worst and again(line.place, setting.id(line.scenario(piece.start.lead)))
        pieces.append(
            {
                "from": round(piece.first * STEP, 2),
                "to": round(piece.last * STEP, 2),
                "order": "goes" if piece.start.goes else "waits",
                "status": str(worst[1]) if worst else "PASS",
                "rule": worst[0] if worst else "",
                "verdicts": dict(piece.start.outcomes),
                "rerun": failed or "",
            }
        )
    return {
        "ways": list(line.named()),
        "from_rest": line.begin is Begin.REST,
        "title": " meets ".join(line.labels),
        "decided_by": line.vista,
        "pieces": pieces,
        "simulated": [round(lead * STEP, 2) for lead in strip.simulated],
        "unfit": strip.unfit,
        "error": strip.error,
    }


def _page(certificates: Sequence[Mapping[str, Any]]) -> str:
    """Return the HTML page of the atlases of junctions, with a strip per group of movement pairs with equal verdicts."""
    first = certificates[0]
    rules = f"Judged by {', '.join(first['rules'])}."
    read = (*_HELP, *([_WALKING] if "pedestrians" in first else []), rules)
    head = Head((("driven by", first["driver"]), ("simulated by", first["simulator"])))
    blocks: list[Block] = [head, Section("how to read the strips", read)]
    for certificate in certificates:
        rows, groups = [], certificate["groups"]
        errors = [strip for group in groups for strip in group if strip["error"]]
        failures = [((strip["title"], ""), (f"ERROR: {strip['error']}", "error"), ("", "")) for strip in errors]
        for strips in (merged for group in groups for merged in _merged(group)):
            strip, bands = strips[0], []
            for (order, status, rule), alike in groupby(strip["pieces"], key=itemgetter("order", "status", "rule")):
                pieces = list(alike)
                begin, end = pieces[0]["from"], pieces[-1]["to"]
                label = f"{rule} {status}" if rule else order
                hint = f"{begin:+.2f} to {end:+.2f} s: the subject {order}" + (f", {label}" if rule else "")
                bands.append(Band(begin - STEP / 2, end + STEP / 2, Outcome(status).mark, order == "waits", label, hint))
                if rule:
                    span = f"{label} from {begin:+.2f} to {end:+.2f} s"
                    failures.append(((strip["title"], ""), (span, Outcome(status).mark), (pieces[0]["rerun"], "code")))
            more = f", {len(strips) - 1} more equal" if len(strips) > 1 else ""
            note = "no room where a vehicle starts" if strip["unfit"] else f"{strip['decided_by']}{more}"
            rows.append(StripRow(strip["title"], f"ERROR{more}" if strip["error"] else note, bands, strip["simulated"]))
        summary = certificate["summary"].removeprefix(f"{certificate['junction']}: ")
        picture = draw_strips(rows, -LONGEST, LONGEST, "lead of the subject")
        blocks.append(Picture((summary,), certificate["junction"], picture))
        if failures:
            blocks.append(Section(f"broken at {certificate['junction']}", (), ("starts", "verdict", "again"), tuple(failures)))
    return rendered("critical starts", blocks, None, Path(), "all_lines.css")


def _merged(group: Sequence[Mapping[str, Any]]) -> Iterator[Sequence[Mapping[str, Any]]]:
    """Yield lists of strips that share a row of the page, because their changes are at most 0.05 s apart."""
    shown: dict[tuple[object, ...], list[Mapping[str, Any]]] = {}
    for strip in group:
        pieces = [
            (round(p["from"], 1), p["order"], p["status"], p["rule"]) for p in strip["pieces"] if p["to"] - p["from"] > _NARROW
        ]
        shown.setdefault((*pieces, bool(strip["unfit"]), bool(strip["error"])), []).append(strip)
    yield from shown.values()


class Band(NamedTuple):
    """A coloured part of a strip, from one time to another."""

    first: float
    """Where the band begins [s]."""
    last: float
    """Where the band ends [s]."""
    mark: Mark
    faint: bool
    label: str
    hint: str


class StripRow(NamedTuple):
    """A strip (row of bands) with its label."""

    label: str
    note: str
    """Text below the label."""
    bands: Sequence[Band]
    ticks: Sequence[float]
    """Places of small marks below the strip [s]."""


def draw_strips(rows: Sequence[StripRow], least: float, greatest: float, axis: str) -> str:
    """Return strips, from `least` to `greatest` [s], as an SVG element; the style sheet of the page gives the colours."""
    height = _TOP + _ROW * len(rows) + 10
    width = 2 * _LEFT + _WIDE

    def x(seconds: float) -> float:
        return _LEFT + _WIDE * (seconds - least) / (greatest - least)

    body = [f'<text x="{_LEFT:g}" y="22">{markup(axis)}</text>']
    for second in range(round(least), round(greatest) + 1):
        body.append(f'<path class="grid" d="M{x(second):.1f} {_TOP - 8:g}V{height:g}"/>')
        body.append(f'<text x="{x(second):.1f}" y="{_TOP - 14:g}" class="middle">{second:+d} s</text>')
    for number, row in enumerate(rows):
        top = _TOP + _ROW * number
        label = f'{markup(row.label)} <tspan class="aside">{markup(row.note)}</tspan>'
        body.append(f'<text x="{_LEFT:g}" y="{top + _LABEL - 8:g}" class="label">{label}</text>')
        top += _LABEL
        for band in row.bands:
            left, wide = x(band.first), max(x(band.last) - x(band.first), 1.0)
            faint = " faint" if band.faint else ""
            body.append(
                f'<rect class="band {band.mark}{faint}" x="{left:.1f}" y="{top:g}" width="{wide:.1f}" height="{_BAR:g}">'
                f"<title>{markup(band.hint)}</title></rect>"
            )
            if len(band.label) * 7.0 < wide:  # a character is 7 px wide
                kind = "inside middle faint" if band.faint else "inside middle on"
                body.append(f'<text x="{left + wide / 2:.1f}" y="{top + 14:g}" class="{kind}">{markup(band.label)}</text>')
        ticks = "".join(f"M{x(tick):.1f} {top + _BAR + 2:g}v4" for tick in row.ticks)
        body.append(f'<path class="ticks" d="{ticks}"/>')
    return f'<svg class="strips" viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{markup(axis)}">{"".join(body)}</svg>'

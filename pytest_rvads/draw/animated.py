"""A run as an animated SVG without a script, which also moves on pages that allow images only."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Iterable
from math import degrees

import numpy as np

from pytest_rvads.draw.film import Film, filmed, framed
from pytest_rvads.draw.scene import Scene, body, inks, size
from pytest_rvads.draw.svg import wrap
from pytest_rvads.errors import RunError
from pytest_rvads.runs.run import Run
from pytest_rvads.wording import markup

__all__ = ["animated"]

_SEAM = 0.2
"""How much wider than they are lanes are drawn, so that nothing shows through where they meet [m]."""
_BAR, _FONT, _LINE = 24.0, 17.0, 24.0
"""Height of the bar with the clock, of letters and of lines of the text below the view [px]."""
_STYLE = """
.lane{fill:none;stroke:#8f969f}.way{display:none}.mark,.arrow{fill:none;stroke:#e9ebee;stroke-width:.14}
.mark.broken{stroke-dasharray:3 3}.arrow{stroke-width:.25}.stop{stroke:#fff;stroke-width:.65}
.number{display:none}.letter,.name{text-anchor:middle;fill:#fff;font-weight:bold}.letter{font-size:1.8px}
.front{fill:none;stroke:#fff;stroke-width:.24}.ring{fill:none;stroke:#d11f1f;stroke-width:.45;transform-box:fill-box;transform-origin:center}
text{font-family:system-ui,-apple-system,"Segoe UI",Helvetica,Arial,sans-serif}
"""


def animated(  # noqa: PLR0913 - a run, and what of it is shown
    run: Run,
    *,
    title: str = "",
    responsible: Collection[str] = (),
    around: float | None = None,
    before: float = 4.0,
    after: float = 2.5,
    width: int = 640,
) -> str:
    """Return an SVG document in which the vehicles of a run move, over and over.

    Who asks for less motion, or sees it where nothing moves, sees the instant that it is about.

    Args:
        run: a run with positions.
        title: what it shows; it appears at `around`, from the beginning without that.
        responsible: names of the vehicles to point out.
        around: time that the picture is about, on the clock of the recording [s]; without, the run is shown from its beginning.
        before: how much is shown before that [s].
        after: how much is shown after it [s].
        width: of the picture [px].

    Raises:
        RunError: the run holds no positions, or no states.
        MapError: its junction has no geometry.
    """
    if run.pose is None:
        raise RunError(f"run {run.label!r} holds no positions, so there is nothing to draw")
    if not run.steps:
        raise RunError(f"run {run.label!r} has no states, so there is nothing to draw")
    scene = Scene(run.junction)
    film = filmed(run, scene, responsible, around, before, after)
    left, top, wide, high = framed(run, scene, film, responsible)
    tall = round(width * high / wide)
    lines = _even(title, max(int((width - 24) / (0.54 * _FONT)), 8))
    full = tall + round(_BAR) + (round(_LINE * len(lines)) + 10 if lines else 0)
    colours, rules = inks(run.agents), [f".lane{{stroke-width:{run.junction.lane_width + _SEAM:g}}}"]
    parts = [scene.road(), *_lamps(run, scene, film, rules)]
    for column, agent in enumerate(run.agents):
        if run.here[film.ticks, column].any():
            ring = _ring(size(run, column)) if agent.name in responsible else ""
            pose = np.nan_to_num(run.pose[film.still, column])
            drawn = body(pose, agent, size(run, column), colours[column], style=f"v{column}", more=ring)
            parts.append(_moving(run, film, column, drawn, rules))
    if around is not None:
        rules.append(_steps("told", film, [(0.0, "opacity:0"), (film.pause, "opacity:1")]))
        rules.append("@keyframes pulse{from{transform:scale(1)}50%{transform:scale(1.12)}to{transform:scale(1)}}")
        rules.append(f".told{{animation:told {film.length:g}s step-end infinite}}.ring{{animation:pulse .8s infinite}}")
    clock = _clock(run, film, width, rules)
    if around is not None and run.subject and lines:
        rules.append(_steps("calm", film, [(0.0, "opacity:1"), (film.pause, "opacity:0")]))
        rules.append(f".calm{{opacity:0;animation:calm {film.length:g}s step-end infinite}}")
        quiet = f"{run.subject} is under test, the others are traffic"
        clock += f'<text class="calm" x="12" y="{_BAR + _LINE:g}" font-size="{_FONT:g}" fill="#3d434a">{markup(quiet)}</text>'
    caption = "".join(f'<text x="12" y="{_LINE * (k + 1):g}">{markup(line)}</text>' for k, line in enumerate(lines))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{full}" viewBox="0 0 {width} {full}" role="img">'
        f"<title>{markup(title or run.label)}</title><style>{_STYLE}{''.join(rules)}"
        "@media (prefers-reduced-motion:reduce){*{animation:none!important}}</style>"
        f'<rect width="{width}" height="{full}" rx="8" fill="#fff"/>'
        f'<svg width="{width}" height="{tall}" viewBox="{left:.2f} {top:.2f} {wide:.2f} {high:.2f}">'
        f'<rect x="{left:.2f}" y="{top:.2f}" width="{wide:.2f}" height="{high:.2f}" fill="#e6ebe2"/>{"".join(parts)}</svg>'
        f'<g transform="translate(0 {tall})">{clock}</g>'
        f'<g class="{"told" if around is not None else ""}" transform="translate(0 {tall + _BAR:g})" font-size="{_FONT:g}" '
        f'font-weight="600" fill="#b3151b">{caption}</g>'
        f'<rect x=".5" y=".5" width="{width - 1}" height="{full - 1}" rx="8" fill="none" stroke="#c3c8ce"/></svg>\n'
    )


def _even(title: str, most: int) -> list[str]:
    """Return a text as lines of about the same length, at most so many letters each."""
    lines = wrap(title, most) if title else []
    for narrow in range(len(title) // max(len(lines), 1), most):
        if len(tried := wrap(title, narrow)) <= len(lines):
            return tried
    return lines


def _moving(run: Run, film: Film, column: int, drawn: str, rules: list[str]) -> str:
    """Return a vehicle that moves, and add the style by which it does."""
    pose, here = run.need("pose"), run.here[:, column]
    begin, end = run.spans[column].tolist()
    turned = np.zeros(run.steps)
    turned[begin:end] = np.unwrap(np.nan_to_num(pose[begin:end, column, 2]))
    known = np.flatnonzero(here[film.ticks])
    first, final = int(known[0]), int(known[-1])
    frames = []
    for k, (tick, time) in enumerate(zip(film.ticks, film.times, strict=True)):
        if first <= k <= final:
            x, y = pose[tick, column, :2]
            moved = f"transform:translate({x:.2f}px,{-y:.2f}px) rotate({-degrees(turned[tick]):.1f}deg)"
            frames.append((film.share(time), moved))
    ends = (0, len(frames) - 1)
    merged = [f for k, f in enumerate(frames) if k in ends or len({style for _, style in frames[k - 1 : k + 2]}) > 1]
    start, stop = ("0%", merged[0][1]), ("100%", merged[-1][1])
    rules.append(f"@keyframes v{column}{{{_frames([start, *merged, stop])}}}")
    rules.append(f".v{column}{{animation:v{column} {film.length:g}s linear infinite}}")
    hidden = "" if here[film.still] else ' visibility="hidden"'
    if first == 0 and final == len(film.ticks) - 1:
        return drawn
    off, on = "visibility:hidden", "visibility:visible"
    edges = [(0.0, on if first == 0 else off), (film.times[first], on)]
    edges += [(film.times[final + 1], off)] if final + 1 < len(film.ticks) else []
    rules.append(_steps(f"s{column}", film, edges))
    rules.append(f".s{column}{{animation:s{column} {film.length:g}s step-end infinite}}")
    return f'<g class="s{column}"{hidden}>{drawn}</g>'


def _ring(extent: tuple[float, float]) -> str:
    """Return what points a vehicle out when it happens."""
    length, width = extent
    return (
        f'<g class="told"><rect class="ring" x="{-length - 0.7:g}" y="{-width / 2 - 0.7:g}" width="{length + 1.4:g}" '
        f'height="{width + 1.4:g}" rx="1"/></g>'
    )


def _lamps(run: Run, scene: Scene, film: Film, rules: list[str]) -> Iterable[str]:
    """Yield the lamps of every state of the lights that is shown, each visible while it is so."""
    shown = [tuple(map(int, run.lights[tick])) for tick in film.ticks]
    changes = [k for k in range(len(shown)) if k == 0 or shown[k] != shown[k - 1]]
    if len(changes) == 1:
        return [scene.lights(shown[0])]
    found = []
    now = changes[bisect_right(changes, list(film.ticks).index(film.still)) - 1]
    for number, k in enumerate(changes):
        until = changes[number + 1] if number + 1 < len(changes) else None
        edges = [(0.0, "visibility:visible" if k == 0 else "visibility:hidden"), (film.times[k], "visibility:visible")]
        edges += [] if until is None else [(film.times[until], "visibility:hidden")]
        rules.append(_steps(f"l{number}", film, edges))
        rules.append(f".l{number}{{animation:l{number} {film.length:g}s step-end infinite}}")
        hidden = "" if k == now else ' visibility="hidden"'
        found.append(f'<g class="l{number}"{hidden}>{scene.lights(shown[k])}</g>')
    return found


def _clock(run: Run, film: Film, width: int, rules: list[str]) -> str:
    """Return a bar that fills and the time on the clock of the run, and add the style by which they move."""
    room = width - 96.0
    begin, end = film.ticks[0], film.ticks[-1]
    whole = max(end - begin, 1)
    shown = list(zip(film.ticks, film.times, strict=True))
    fills = [(film.share(time), f"transform:scaleX({(tick - begin) / whole:.4f})") for tick, time in shown]
    rules.append(f"@keyframes bar{{{_frames([*fills, ('100%', fills[-1][1])])}}}")
    rules.append(f".bar{{animation:bar {film.length:g}s linear infinite}}")
    lines: list[str] = []
    turns, seen = [], -1
    for tick, time in shown:
        if tick != seen:
            lines.append(f'<text y="{17 + _BAR * len(lines):g}">{run.start + tick * run.dt:.2f} s</text>')
            turns.append((time, f"transform:translateY({-_BAR * (len(lines) - 1):g}px)"))
        seen = tick
    rules.append(_steps("clock", film, turns))
    rules.append(f".clock{{animation:clock {film.length:g}s step-end infinite}}")
    row = sorted(set(film.ticks)).index(film.still)
    share = (film.still - begin) / whole
    mark = f'<path d="M{12 + room * share:.1f} 5v14" stroke="#b3151b" stroke-width="3"/>' if film.times[-1] > film.pause else ""
    fill = f'<g class="bar" transform="scale({share:.4f} 1)"><rect width="{room:g}" height="6" rx="3" fill="#5c6470"/></g>'
    return (
        f'<rect x="12" y="9" width="{room:g}" height="6" rx="3" fill="#e3e6ea"/><g transform="translate(12 9)">{fill}</g>{mark}'
        f'<svg x="{width - 76:g}" width="70" height="{_BAR:g}"><g class="clock" '
        f'transform="translate(0 {-_BAR * row:g})" font-size="14" fill="#3d434a">{"".join(lines)}</g></svg>'
    )


def _steps(name: str, film: Film, edges: Iterable[tuple[float, str]]) -> str:
    """Return keyframes of what changes at once."""
    return f"@keyframes {name}{{{_frames([(film.share(time), style) for time, style in edges])}}}"


def _frames(frames: Iterable[tuple[str, str]]) -> str:
    return "".join(f"{share}{{{style}}}" for share, style in frames)

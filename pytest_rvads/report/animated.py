"""Draws a run as an animated SVG without a script, which also moves on pages that allow only images."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from itertools import pairwise
from math import degrees
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.report.scene import Scene, body, inks, size
from pytest_rvads.report.svg import wrap
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import markup

_RATE = 10
"""Keyframes per second; browsers interpolate between keyframes in straight lines."""
_HOLD, _REST = 2.0, 1.0
"""Viewing time for which the picture stands still at the shown instant, and at the end of the film [s]."""
_LONGEST = 60.0
"""Longest shown part of a run [s], so that a picture stays below a megabyte."""
_NEAR, _SPAN = 11.0, 16.0
"""Vehicles are in view within the first distance of the junction; a responsible vehicle only within the second distance of its
position at the shown instant [m]."""
_AROUND = 3.5
"""Margin of the view [m]."""
_APPROACH = 1.0
"""The film begins this long before a responsible vehicle comes to its line [s]."""
_SEAM = 0.2
"""Additional width of drawn lanes, so that no gap shows between lanes that meet [m]."""
_BAR, _FONT, _LINE = 24.0, 17.0, 24.0
"""Height of the bar with the clock, and of letters and lines of the text below the view [px]."""
_STYLE = """
.lane{fill:none;stroke:#8f969f}.way{display:none}.mark,.arrow{fill:none;stroke:#e9ebee;stroke-width:.14}
.mark.broken{stroke-dasharray:3 3}.arrow{stroke-width:.25}.stop{stroke:#fff;stroke-width:.65}
.number{display:none}.letter,.name{text-anchor:middle;fill:#fff;font-weight:bold}.letter{font-size:1.8px}
.front{fill:none;stroke:#fff;stroke-width:.24}.ring{fill:none;stroke:#d11f1f;stroke-width:.45;transform-box:fill-box;transform-origin:center}
text{font-family:system-ui,-apple-system,"Segoe UI",Helvetica,Arial,sans-serif}
"""


def animated(
    run: Run,
    *,
    title: str = "",
    responsible: Collection[str] = (),
    around: float | None = None,
    before: float = 4.0,
    after: float = 2.5,
    width: int = 640,
) -> str:
    """Return an SVG document in which the vehicles of a run move in an endless loop.

    The loop shows the times `before` and `after` [s] an instant `around` on the clock of the recording [s]; None shows the run
    from its beginning. Programs that do not animate SVG, and browsers with reduced motion, show the instant.
    """
    if run.pose is None:
        raise RunError(f"run {run.label!r} holds no positions, so there is nothing to draw")
    if not run.steps:
        raise RunError(f"run {run.label!r} has no states, so there is nothing to draw")
    scene = Scene(run.junction)
    film = filmed(run, scene, responsible, around, before, after)
    left, top, wide, high = framed(run, scene, film, responsible)
    tall = round(width * high / wide)
    most = max(int((width - 24) / (0.54 * _FONT)), 8)
    lines = wrap(title, most) if title else []
    # The title takes as few lines as possible, all of about the same length.
    narrower = (wrap(title, letters) for letters in range(len(title) // max(len(lines), 1), most))
    lines = next((row for row in narrower if len(row) <= len(lines)), lines)
    full = tall + round(_BAR) + (round(_LINE * len(lines)) + 10 if lines else 0)
    colours, rules = inks(run.agents), [f".lane{{stroke-width:{run.junction.lane_width + _SEAM:g}}}"]
    parts = [scene.road()]
    shown = [tuple(map(int, run.lights[tick])) for tick in film.ticks]
    changes = [k for k in range(len(shown)) if k == 0 or shown[k] != shown[k - 1]]
    for number, (first, end) in enumerate(pairwise([*changes, len(shown)])):
        parts.append(_shown(f"l{number}", film, first, end, scene.lights(shown[first]), rules))
    for column, agent in enumerate(run.agents):
        if run.here[film.ticks, column].any():
            ring, (long, broad) = "", size(run, column)
            if agent.name in responsible:
                ring = (
                    f'<g class="told"><rect class="ring" x="{-long - 0.7:g}" y="{-broad / 2 - 0.7:g}" width="{long + 1.4:g}" '
                    f'height="{broad + 1.4:g}" rx="1"/></g>'
                )
            pose = np.nan_to_num(run.pose[film.still, column])
            drawn = body(pose, agent, (long, broad), colours[column], style=f"v{column}", more=ring)
            parts.append(_moving(run, film, column, drawn, rules))
    if around is not None:
        rules.append(_keyframes("told", film, [(0.0, "opacity:0"), (film.pause, "opacity:1")]))
        rules.append("@keyframes pulse{from{transform:scale(1)}50%{transform:scale(1.12)}to{transform:scale(1)}}")
        rules.append(f".told{{animation:told {film.length:g}s step-end infinite}}.ring{{animation:pulse .8s infinite}}")
    clock = _clock(run, film, width, rules)
    if around is not None and run.subject and lines:
        rules.append(_keyframes("calm", film, [(0.0, "opacity:1"), (film.pause, "opacity:0")]))
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


class Film(NamedTuple):
    """The states of a run that an animation shows, and the viewing times of these states."""

    ticks: Sequence[int]
    """Shown ticks of the run, in order."""
    times: Sequence[float]
    """Viewing time of each tick [s]."""
    still: int
    """Tick of the shown instant, which programs that do not animate SVG show."""
    pause: float
    """Viewing time of the shown instant [s]."""
    length: float
    """Viewing time of the whole film [s]."""


def filmed(run: Run, scene: Scene, responsible: Collection[str], around: float | None, before: float, after: float) -> Film:
    """Return the states that an animation shows, with the arguments of `animated`; `before` and `after` are longest times [s]."""
    last, begin, hold = run.steps - 1, 0, 0.0
    still = end = min(last, round(_LONGEST / run.dt))
    if around is not None:
        still, hold = min(max(round((around - run.start) / run.dt), 0), last), _HOLD
        begin = max(still - round(min(before, _LONGEST) / run.dt), 0)
        about = [column for column, agent in enumerate(run.agents) if agent.name in responsible]
        visible = np.any([_in_view(run, scene, column, still)[begin:still] for column in about], axis=0)
        begin += int(visible.argmax()) if about and len(visible) else 0  # argmax is 0 if no vehicle came into view
        arrived = (run.zone[: still + 1, about] >= Zone.ENTRANCE).any(axis=1)
        begin = max(begin, int(arrived.argmax()) - round(_APPROACH / run.dt))  # likewise if no vehicle came to its line
        end = min(still + round(min(after, _LONGEST) / run.dt), last)
    every = max(round(1 / _RATE / run.dt), 1)
    ticks = sorted({*range(begin, end + 1, every), still, end})
    times = [(tick - begin) * run.dt + (hold if tick > still else 0.0) for tick in ticks]
    # The picture stands still between two keyframes of the same state.
    place = ticks.index(still)
    if hold:
        ticks.insert(place, still)
        times.insert(place + 1, times[place] + hold)
    return Film(ticks, times, still, times[place], times[-1] + _REST)


def framed(run: Run, scene: Scene, film: Film, responsible: Collection[str]) -> tuple[float, float, float, float]:
    """Return left, top, width and height of the visible part of the road, in SVG coordinates [m].

    The part holds the junction, the vehicles near the junction at the shown instant, and the way of the responsible vehicles.
    """
    points = list(scene.core)
    for column, agent in enumerate(run.agents):
        ticks = list(film.ticks) if agent.name in responsible else [film.still]
        x, y, heading = run.need("pose")[ticks, column][_in_view(run, scene, column, film.still)[ticks]].T
        length = size(run, column)[0]
        points += [*np.stack([x, y], axis=1), *np.stack([x - length * np.cos(heading), y - length * np.sin(heading)], axis=1)]
    (x0, y0), (x1, y1) = np.min(points, axis=0) - _AROUND, np.max(points, axis=0) + _AROUND
    wide, tall = float(x1 - x0), float(y1 - y0)
    wide = max(wide, tall / 0.85)
    tall = max(tall, 0.62 * wide)  # the least height of the view
    return float(x0 + x1 - wide) / 2, -float(y0 + y1 + tall) / 2, wide, tall


def _in_view(run: Run, scene: Scene, column: int, still: int) -> NDArray[np.bool_]:
    """Return whether a vehicle is near the junction and near its position at the shown instant, per state, shape ``(steps,)``."""
    low, high = scene.core
    way = run.need("pose")[:, column, :2]
    visible: NDArray[np.bool_] = run.here[:, column] & ((way > low - _NEAR) & (way < high + _NEAR)).all(axis=1)
    if run.here[still, column]:
        visible &= np.hypot(*(way - way[still]).T) < _SPAN
    return visible


def _moving(run: Run, film: Film, column: int, drawn: str, rules: list[str]) -> str:
    """Return the element of a moving vehicle, and add its style to `rules`."""
    pose = run.need("pose")
    begin, end = run.spans[column].tolist()
    turned = np.zeros(run.steps)
    turned[begin:end] = np.unwrap(np.nan_to_num(pose[begin:end, column, 2]))
    visible = np.flatnonzero(run.here[film.ticks, column]).tolist()
    frames: list[tuple[float | str, str]] = []
    for k in range(visible[0], visible[-1] + 1):
        tick = film.ticks[k]
        x, y = pose[tick, column, :2]
        frames.append((film.times[k], f"transform:translate({x:.2f}px,{-y:.2f}px) rotate({-degrees(turned[tick]):.1f}deg)"))
    ends = (0, len(frames) - 1)
    merged = [f for k, f in enumerate(frames) if k in ends or len({style for _, style in frames[k - 1 : k + 2]}) > 1]
    whole = [("0%", merged[0][1]), *merged, ("100%", merged[-1][1])]
    rules.append(_animation(f"v{column}", film, whole, "linear"))
    return _shown(f"s{column}", film, visible[0], visible[-1] + 1, drawn, rules)


def _shown(name: str, film: Film, first: int, end: int, drawn: str, rules: list[str]) -> str:
    """Return an element that is visible from one frame of the film until another, and add its style to `rules`."""
    if first == 0 and end == len(film.ticks):
        return drawn
    frames: list[tuple[float | str, str]] = [
        (0.0, f"visibility:{'hidden' if first else 'visible'}"),
        (film.times[first], "visibility:visible"),
    ]
    if end < len(film.ticks):
        frames.append((film.times[end], "visibility:hidden"))
    rules.append(_animation(name, film, frames, "step-end"))
    hidden = "" if first <= list(film.ticks).index(film.still) < end else ' visibility="hidden"'
    return f'<g class="{name}"{hidden}>{drawn}</g>'


def _clock(run: Run, film: Film, width: int, rules: list[str]) -> str:
    """Return a progress bar and the time on the clock of the run, and add the styles of both to `rules`."""
    room = width - 96.0
    begin, end = film.ticks[0], film.ticks[-1]
    span = max(end - begin, 1)
    shown = list(zip(film.ticks, film.times, strict=True))
    fills = [(time, f"transform:scaleX({(tick - begin) / span:.4f})") for tick, time in shown]
    rules.append(_animation("bar", film, [*fills, ("100%", fills[-1][1])], "linear"))
    times: dict[int, float] = {}
    for tick, time in shown:
        times.setdefault(tick, time)
    lines = [f'<text y="{17 + _BAR * row:g}">{run.start + tick * run.dt:.2f} s</text>' for row, tick in enumerate(times)]
    turns = [(time, f"transform:translateY({-_BAR * row:g}px)") for row, time in enumerate(times.values())]
    rules.append(_animation("clock", film, turns, "step-end"))
    row = list(times).index(film.still)
    share = (film.still - begin) / span
    mark = f'<path d="M{12 + room * share:.1f} 5v14" stroke="#b3151b" stroke-width="3"/>' if film.times[-1] > film.pause else ""
    fill = f'<g class="bar" transform="scale({share:.4f} 1)"><rect width="{room:g}" height="6" rx="3" fill="#5c6470"/></g>'
    return (
        f'<rect x="12" y="9" width="{room:g}" height="6" rx="3" fill="#e3e6ea"/><g transform="translate(12 9)">{fill}</g>{mark}'
        f'<svg x="{width - 76:g}" width="70" height="{_BAR:g}"><g class="clock" '
        f'transform="translate(0 {-_BAR * row:g})" font-size="14" fill="#3d434a">{"".join(lines)}</g></svg>'
    )


def _keyframes(name: str, film: Film, frames: Iterable[tuple[float | str, str]]) -> str:
    """Return CSS keyframes from styles and their viewing times [s] or shares of the film."""
    steps = []
    for time, style in frames:
        share = time if isinstance(time, str) else f"{100 * min(time / film.length, 1.0):.2f}%"
        steps.append(f"{share}{{{style}}}")
    return f"@keyframes {name}{{{''.join(steps)}}}"


def _animation(name: str, film: Film, frames: Iterable[tuple[float | str, str]], course: str) -> str:
    """Return the CSS of a class whose elements go through keyframes again and again, linearly or in steps."""
    return f"{_keyframes(name, film, frames)}.{name}{{animation:{name} {film.length:g}s {course} infinite}}"

"""Draw the pictures of docs/concepts/ with the package's own functions: ``python tools/make_pictures.py [FOLDER]``."""

from __future__ import annotations

import math
import re
import sys
import tempfile
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np

import pytest_rvads as rvads
from pytest_rvads.cli import main as command
from pytest_rvads.report.failures import moment
from pytest_rvads.report.scene import path, picture
from pytest_rvads.support.storage import write_file

FOLDER = Path(__file__).parents[1] / "docs" / "concepts"
ROOM, TITLE = 26.0, 4.0
"""How far a picture reaches from the centre of its junction to each side, and how high the line above it is [m]."""
ZONES = {"approach": "#6b6f76", "entrance": "#e69f00", "junction": "#0072b2", "exit": "#009e73"}


class Stands(rvads.Follower):
    """Stops at the line and never goes on."""

    def target_speed(self, seen: rvads.Observation) -> float:
        """Return a speed that ends before the line [m/s]."""
        return self.stopping_speed(seen.itinerary.line - seen.me.station - 0.5)


def pictures() -> dict[str, str]:
    """Return every picture by its name."""
    makers = (zones, classes, configurations, subject, not_applicable, still_open, provoked, unsure, unavoidable)
    return {maker.__name__.replace("_", "-"): maker() for maker in makers}


def zones() -> str:
    """Return the parts of the way of one vehicle, each in a colour."""
    run = _run("stop4", "3000", rvads.Reference, distance=14)
    (way,) = rvads.Scenario(run.junction, "3000").itineraries()
    borders = [-ROOM, way.line - 1.0, 0.0, way.length, way.length + ROOM]
    lines, labels, style = [], [], 'font-size="2.2" font-weight="bold"'
    for (name, colour), begin, end in zip(ZONES.items(), borders[:-1], borders[1:], strict=True):
        points = np.array([way.pose(station)[:2] for station in np.arange(begin, end + 0.01, 0.25)])
        lines.append(f'<polyline fill="none" stroke="{colour}" stroke-width="1.6" points="{path(points)}"/>')
        x, y, _ = way.pose({"approach": -6.0, "exit": way.length + 7.0}.get(name, (begin + end) / 2))
        aside = (0.0, 3.2) if name == "exit" else (-1.8, 0.7)
        anchor = "middle" if name == "exit" else "end"
        labels.append(
            f'<text x="{x + aside[0]:.2f}" y="{-y + aside[1]:.2f}" {style} text-anchor="{anchor}" fill="{colour}">{name}</text>'
        )
    return _cropped(picture(run, 0, "the way of a0, which turns left, and its four zones"), "".join(lines + labels))


def classes() -> str:
    """Return the table of classes of a junction with three ways, as `rvads classes` draws it."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "classes.svg"
        command(["classes", "3", "--svg", str(file)])
        return file.read_text(encoding="utf-8")


def configurations() -> str:
    """Return a scenario in configuration E, as it starts."""
    scenario = rvads.Scenario(rvads.find("stop4"), "2222", distance=(0.3, 0.3, 20, 20))
    run = rvads.simulate(rvads.Case(scenario, rvads.Reference))
    return _cropped(picture(run, 0, "configuration E: two at the line, two 20 m before it"), room=42.0)


def subject() -> str:
    """Return a subject among traffic."""
    run = _run("stop4", "2132", rvads.Reference, distance=(3, 1, 4, 7), subject=0)
    x, y, heading = run.need("pose")[0, 0]
    x, y = x - 2.3 * math.cos(heading), y - 2.3 * math.sin(heading)
    ring = f'<circle cx="{x:.2f}" cy="{-y:.2f}" r="4" fill="none" stroke="#d11f1f" stroke-width="0.4"/>'
    words = f'<text x="{x + 5:.2f}" y="{-y + 0.8:.2f}" font-size="2.2" fill="#d11f1f">yours: the subject</text>'
    return _cropped(picture(run, 0, "a0 runs your controller, the others are traffic"), ring + words)


def not_applicable() -> str:
    """Return a run to which a rule does not apply."""
    return _judged(_run("light4", "1220", rvads.Reference, distance=20, subject=0), "right_on_red", 450)


def still_open() -> str:
    """Return a run that ends while a vehicle has to wait."""
    return _judged(_run("stop4", "2200", Stands, distance=(10, 20, 1, 1), subject=0, duration=10), "p3", 999, ["a0"])


def provoked() -> str:
    """Return a rule that traffic breaks."""
    run = _run("stop4", "2200", rvads.Reference, "red_light_runner", distance=20, speed=8, subject=0)
    return _judged(run, "full_stop")


def unavoidable() -> str:
    """Return four vehicles that came at once."""
    return _judged(_run("stop4", "2222", rvads.Reference, distance=20), "p2")


def unsure() -> str:
    """Return recorded traffic in which two arrive almost at once."""
    run = _run("stop4", "2200", rvads.Reference, distance=(20, 20.2, 1, 1))
    errors = np.random.default_rng(0).normal(0, 0.1, (run.steps, len(run.agents), 2))
    table: dict[str, list[float | str]] = {key: [] for key in ("id", "time", "x", "y", "heading", "speed", "length", "width")}
    for tick in range(0, run.steps, 10):
        for column, agent in enumerate(run.agents):
            if run.here[tick, column]:
                (x, y, heading), (length, width) = run.need("pose")[tick, column], agent.size or (4.6, 1.8)
                x, y = np.array([x, y]) - length / 2 * np.array([math.cos(heading), math.sin(heading)]) + errors[tick, column]
                row = (agent.name, tick * run.dt, x, y, heading, run.need("speed")[tick, column], length, width)
                for values, value in zip(table.values(), row, strict=True):
                    values.append(value)
    (recorded,) = rvads.files.read_tracks(table, "stop4", position_accuracy=0.1)
    return _judged(recorded, "p3")


def _run(junction: str, directions: str, driver: Callable[[], object], traffic: str = "reference", **more: object) -> rvads.Run:
    scenario = rvads.Scenario(rvads.find(junction), directions, **more)  # type: ignore[arg-type]
    others = rvads.traffic(traffic) if "subject" in more else None
    return rvads.simulate(rvads.Case(scenario, driver, traffic=others))  # type: ignore[arg-type]


def _judged(run: rvads.Run, rule: str, tick: int | None = None, who: Collection[str] = ()) -> str:
    """Return a run at the instant that a verdict is about, under what the verdict says."""
    verdict = rvads.check(run, rule)
    shown = round((moment(run, verdict) - run.start) / run.dt) if tick is None else tick
    said = verdict.message.partition(";")[0].partition(", since")[0]
    return _cropped(picture(run, shown, said, who or verdict.responsible))


def _cropped(svg: str, more: str = "", room: float = ROOM) -> str:
    """Return a picture of the middle of a junction, with its title on lines that fit and further elements over it."""
    title = re.search(r'<text class="title"[^>]*>([^<]*)</text>', svg)
    assert title, "a picture has a title"
    body = svg[: title.start()].rpartition("<rect")[0]
    head, _, rest = body.partition("><style>")
    lines = _lines(title[1], round(room * 1.6))
    high = TITLE * 0.8 * len(lines) + 1.2
    left, top = -room, -room - high
    head = re.sub(r" width=.*$", f' width="{10 * 2 * room:.0f}" height="{10 * (2 * room + high):.0f}"', head)
    head += f' viewBox="{left:g} {top:.2f} {2 * room:g} {2 * room + high:.2f}"'
    cover = f'<rect x="{left:g}" y="{top:.2f}" width="{2 * room:g}" height="{high:.2f}" fill="#fff"/>'
    words = "".join(
        f'<text class="title" x="{left + 1:g}" y="{top + 3.2 * (k + 1):.2f}">{line}</text>' for k, line in enumerate(lines)
    )
    return f"{head}><style>{rest}{more}{cover}{words}</svg>\n"


def _lines(text: str, width: int) -> list[str]:
    lines = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) > width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines


def main() -> None:
    """Write all pictures, into the folder named on the command line or docs/concepts/."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for name, svg in pictures().items():
        write_file(folder / f"{name}.svg", svg.encode())


if __name__ == "__main__":
    main()

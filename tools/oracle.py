"""Dump what the package says of runs, maps and examples, and compare two dumps.

``python tools/oracle.py dump FILE [SECTION ...]`` writes one JSON object; ``python tools/oracle.py compare OLD NEW`` prints one
line per section and a line per field that differs, and exits with 1 if anything differs. A change that must not alter a verdict
is proven by two equal dumps, one of each side of the change. All sections together take about fifteen minutes of processor time;
recordings and maps of others are read from ``../shared`` and are left out where that folder is absent.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np

import pytest_rvads as rvads
from pytest_rvads.cli import main as command
from pytest_rvads.drivers.walking import BEHAVIOURS
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.recording import zones
from pytest_rvads.satellites.paper.tables import TABLES, Setup, entries, run_entry
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.pedestrians import walks_of
from pytest_rvads.scenarios.selection import Selection

SHARED = Path(__file__).parents[2] / "shared"
DATA = Path(rvads.__file__).parent / "geometry" / "data"
"""The built-in maps, as files."""
BOOKS = ("paper", "road")
JUNCTIONS = ("stop3", "stop4", "light3", "light4", "yield4", "right4", "lanes4", "roundabout4")
STARTS = 3
"""Simulated starts per junction and traffic policy; eight junctions, seven policies and the rules of both books make some 2,000
verdicts."""
WALKS = 4
"""Simulated starts, at least, per junction with crosswalks and behaviour of pedestrians."""
LEAGUE = """\
junctions = ["stop4", "zebra4"]
seats = [0]
cells = 6
critical = 2
rules = ["full_stop", "right_first", "no_collision"]
seed = 1
[drivers]
reference = { autopilot = "reference" }
rolling = { autopilot = "rolling_stop" }
"""
CROWD_STEPS, CROWD_STEP = 500, 0.1
"""States of one random crowd, and the time between two of them [s]; four crowds hold 2,000 states."""

Entry = dict[str, Any]
Entries = Iterator[tuple[str, Entry]]


def verdicts(name: str, run: rvads.Run) -> Entries:
    """Judge a run by every rule of both books that concerns the junction of the run."""
    for rule in rules_for(BOOKS, run.junction):
        verdict = rvads.check(run, rule)
        yield f"{name} {rule.name}", {**verdict.record(), "outcome": verdict.outcome.value, "hash": run.hash}


def told(folder: Path, *arguments: str) -> Entry:
    """Run the command ``rvads`` in a folder; return its exit status and what it prints, without the paths of this machine."""
    before = Path.cwd()
    with redirect_stdout(StringIO()) as output, redirect_stderr(StringIO()) as errors:
        os.chdir(folder)
        try:
            status = command(list(arguments))
        finally:
            os.chdir(before)
    texts = {"output": output.getvalue(), "errors": errors.getvalue()}
    places = {str(folder): "FOLDER", str(DATA): "DATA", str(SHARED): "SHARED"}
    for name, text in texts.items():
        for path, word in places.items():
            text = text.replace(path, word)
        texts[name] = text
    return {"exit": status, **texts}


def of_report(name: str, file: Path) -> Entries:
    """Yield the records of a report, each with the verdicts of its rule."""
    for record in json.loads(file.read_text())["records"]:
        kept = {key: record.get(key) for key in ("status", "hash", "message", "duration", "verdicts")}
        yield f"{name}{record['nodeid']}", kept


def recorded() -> Entries:
    """Judge the recorded runs of the paper's authors."""
    for file in sorted((SHARED / "runs").glob("*.json")):
        for number, run in enumerate(rvads.files.read_recorded(file)):
            yield from verdicts(f"{file.stem}#{number} {run.label}", run)


def maps() -> Entries:
    """Read every map of others as ``rvads map --json`` does: one entry per junction, one for the rest of the output."""
    folder = SHARED / "maps"
    for file in sorted([*folder.glob("*.xodr"), *folder.glob("lanelet2/*.osm"), *folder.glob("commonroad/*.xml")]):
        answer = told(file.parent, "map", "--json", str(file))
        # A map without junctions is refused, with a message and no JSON.
        description = json.loads(answer.pop("output") or '{"junctions": []}')
        for junction in description.pop("junctions"):
            yield f"{file.name} {junction['id']}", junction
        yield file.name, {**description, "file": file.name, **answer}


def cells() -> Entries:
    """Run and judge the tables of the paper."""
    for table in TABLES:
        for entry in entries(table):
            yield from verdicts(f"{table.name} {entry.number} {entry.row} {entry.configuration}", run_entry(entry, Setup()))


def examples() -> Entries:
    """Run ``pytest examples`` in a process of its own and take the records of its report."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.json")
        session = [sys.executable, "-m", "pytest", "examples", "-q", f"--rvads-report={report}", "-o", f"cache_dir={folder}"]
        subprocess.run(session, capture_output=True, check=False, cwd=Path(__file__).parents[1])
        yield from of_report("", report)


def subjects() -> Entries:
    """Simulate the reference as the subject among each traffic policy, and judge every start by both books."""
    policies = ("reference", "hesitant", "rolling_stop", "late_yielder", "red_light_runner", "stopped", "lgsvl")
    for place in map(rvads.find, JUNCTIONS):
        points = grid(("arrivals", "A", "C", "D"), len(place.entrances), place.control)
        starts = list(Selection(place, points, subject="all", followers=(0, 1)))
        for shift, policy in enumerate(policies):
            # Every policy meets other starts, which lie evenly among all.
            step = len(starts) // STARTS
            for scenario in islice(starts, shift * step // len(policies), None, step):
                case = rvads.Case(scenario, rvads.Reference, rvads.traffic(policy))
                try:
                    yield from verdicts(f"{scenario.name} {policy}", rvads.simulate(case))
                except rvads.errors.ScenarioError as error:  # a follower has no room on the short approaches of a roundabout
                    yield f"{scenario.name} {policy}", {"error": str(error)}


def crowd(place: str, seed: int) -> rvads.Run:
    """Return a recorded run of seven vehicles that drive along random ways at random speeds and heed nobody."""
    junction, rng = rvads.find(place), np.random.default_rng(seed)
    ways, shape = sorted(junction.movements), (CROWD_STEPS, 7)
    zone = np.full(shape, rvads.Zone.ABSENT, dtype=np.int8)
    station, speed, pose = np.full(shape, np.nan), np.full(shape, np.nan), np.full((*shape, 3), np.nan)
    agents = []
    for vehicle, first in enumerate(np.sort(rng.integers(0, CROWD_STEPS // 2, shape[1])).tolist()):
        way = rvads.values.Itinerary.through(junction, *ways[rng.integers(len(ways))])
        speeds = np.repeat(rng.choice([0.0, 0.05, 1.0, 3.0, 5.0, 9.0], 200), rng.integers(3, 25, 200))[: CROWD_STEPS - first]
        along = way.line - 14.0 + np.concatenate(([0.0], np.cumsum(speeds[:-1]) * CROWD_STEP))
        present = slice(first, first + int(np.searchsorted(along, way.leave)))
        along = along[: present.stop - first]
        zone[present, vehicle], station[present, vehicle] = zones(way.borders, along), along
        speed[present, vehicle] = speeds[: len(along)]
        pose[present, vehicle] = [way.pose(float(s)) for s in along]
        agents.append(rvads.Agent(f"v{vehicle}", junction.movements[way.entrance, way.exit], size=(4.6, 1.8)))
    lights = np.zeros((CROWD_STEPS, len(junction.entrances)), dtype=np.int8)
    for entrance in (entrance for group in junction.phase_groups for entrance in group):
        colours = rng.choice([rvads.Colour.GREEN, rvads.Colour.YELLOW, rvads.Colour.RED], CROWD_STEPS // 20)
        lights[:, entrance] = np.repeat(colours, 20)
    name, vehicles = f"crowd {place}", tuple(agents)
    return rvads.Run(name, junction, vehicles, zone, lights, station=station, speed=speed, pose=pose, dt=CROWD_STEP)


def crowds() -> Entries:
    """Judge random crowds as whole runs, and state by state with a live monitor."""
    for place in ("stop4", "light4", "yield4", "right4"):
        run = crowd(place, seed=7)
        yield from verdicts(f"{place} whole", run)
        monitor = rvads.RuleMonitor(BOOKS, run.junction, dt=run.dt)
        for tick in range(run.steps):
            state = zip(run.agents, run.need("station")[tick], run.need("speed")[tick], run.need("pose")[tick], strict=True)
            seen = [rvads.values.Seen(agent, float(s), float(v), *map(float, pose)) for agent, s, v, pose in state if s == s]
            for decided in monitor.see(seen, run.lights[tick]):
                binding = sorted(decided.binding.items())
                yield f"{place} live {decided.rule} {binding}", {"tick": tick, "verdict": str(decided.verdict)}


def walked() -> Entries:
    """Let a pedestrian of every behaviour meet the reference at each junction with crosswalks, and judge the runs."""
    for place in (rvads.find(name).walked for name in ("zebra4", "walk4")):
        for number, behaviour in enumerate(BEHAVIOURS):
            walks = walks_of({"behaviour": behaviour, "difference": [-1.0, 0.5]})
            starts = list(Selection(place, grid(("C",), len(place.entrances), place.control), subject="all", pedestrians=walks))
            for scenario in starts[number :: max(len(starts) // WALKS, 1)]:
                driver = rvads.traffic(("reference", "stopped", "lgsvl")[number % 3])
                case = rvads.Case(scenario, driver, rvads.traffic("hesitant"))
                yield from verdicts(f"{scenario.name} {behaviour}", rvads.simulate(case))


def logs() -> Entries:
    """Write simulated runs as logs with noise, import the logs, and judge the recordings: many verdicts are UNSURE."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number, (place, policy) in enumerate(product(("stop4", "yield4", "right4"), ("reference", "rolling_stop"))):
            junction = rvads.find(place)
            scenario = rvads.Scenario(junction, "2321", distance=(30, 25, 20, 15), speed=8)
            run = rvads.simulate(rvads.Case(scenario, rvads.traffic(policy)))
            for noise in (0.02, 0.1, 0.3):
                file = folder / f"{place}-{policy}-{noise}.csv"
                source = ("--junction", place, "-o", "log.npz", "--point", "front", "--accuracy", f"{3 * noise:g}")
                write_log(file, run, np.random.default_rng(number), noise)
                yield (
                    f"{file.stem} import",
                    told(folder, "import", file.name, *source),
                )
                yield f"{file.stem} check", told(folder, "check", "log.npz")
                for part, cut in enumerate(rvads.files.load_recording(folder / "log.npz")):
                    yield from verdicts(f"{file.stem} #{part}", cut)


def write_log(file: Path, run: rvads.Run, rng: np.random.Generator, noise: float) -> None:
    """Write every tenth state of a run as tracks, with normal noise on each coordinate [m]."""
    poses, speeds = run.need("pose"), run.need("speed")
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["time", "id", "x", "y", "heading", "speed", "length", "width"])
        for tick in range(0, run.steps, 10):
            for column, agent in enumerate(run.agents):
                x, y, heading = map(float, poses[tick, column])
                if x == x:
                    x, y = (round(float(value + rng.normal(0.0, noise)), 3) for value in (x, y))
                    writer.writerow(
                        [round(tick * run.dt, 2), agent.name, x, y, heading, speeds[tick, column], *(agent.size or ())]
                    )


def campaigns() -> Entries:
    """Judge a town and a league, search critical starts, and check recorded runs: records, output and exit statuses."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        town = ["town", f"{DATA / 'stop4.xodr'}", f"{DATA / 'light4.xodr'}", "--sample", "30", "-j", "1"]
        for driver in ("reference", "rolling_stop"):
            yield f"town {driver}", told(folder, *town, "--autopilot", driver, "-o", driver)
            yield from of_report(f"town {driver} ", folder / driver / "town.json")
        (folder / "league.toml").write_text(LEAGUE)
        yield "league", told(folder, "league", "league.toml", "-j", "1", "-o", "league")
        yield "league page", json.loads((folder / "league" / "league.json").read_text())
        search = ["critical", "stop3", "-j", "1", "--json", "--rules", "full_stop", "right_first", "no_collision"]
        answer = told(folder, *search, "--autopilot", "late_yielder")
        for number, entry in enumerate(json.loads(answer.pop("output"))["lines"]):
            yield f"critical {number}", entry
        yield "critical", answer
        if SHARED.is_dir():
            for book in BOOKS:
                yield f"check {book}", told(folder, "check", f"{SHARED / 'runs'}", "--rules", book)


SECTIONS: dict[str, Callable[[], Entries]] = {
    function.__name__: function for function in (recorded, maps, cells, examples, subjects, walked, crowds, logs, campaigns)
}


def dump(names: list[str]) -> dict[str, dict[str, Entry]]:
    """Return the entries of the named sections, all of them where none is named."""
    return {name: dict(SECTIONS[name]()) for name in names or SECTIONS}


def compare(old: dict[str, dict[str, Entry]], new: dict[str, dict[str, Entry]]) -> list[str]:
    """Return one line per section of either dump, with the number of entries that differ, and one line per field that differs."""
    lines = []
    for section in old | new:
        before, after = old.get(section, {}), new.get(section, {})
        differences = [
            (key, field, before.get(key, {}).get(field), after.get(key, {}).get(field))
            for key in before | after
            for field in before.get(key, {}) | after.get(key, {})
            if before.get(key, {}).get(field) != after.get(key, {}).get(field)
        ]
        line = f"{section}: {len({key for key, *_ in differences})} of {len(before | after)} entries differ"
        if differences:
            line += f" ({', '.join(f'{field} {count}' for field, count in Counter(d[1] for d in differences).most_common())})"
        lines += [line, *(f"  {key}: {field} {was!r} -> {becomes!r}" for key, field, was, becomes in differences)]
    return lines


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="action", required=True)
    dumping = commands.add_parser("dump", help="write what the package says into a JSON file")
    dumping.add_argument("file", type=Path)
    dumping.add_argument("sections", nargs="*", choices=[*SECTIONS, []], metavar="SECTION", help=", ".join(SECTIONS))
    comparing = commands.add_parser("compare", help="say in one line per section what differs")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    options = parser.parse_args()
    if options.action == "dump":
        options.file.write_text(json.dumps(dump(options.sections), default=str))
        return 0
    old, new = json.loads(options.old.read_text()), json.loads(options.new.read_text())
    print(*compare(old, new), sep="\n")
    return 0 if old == new else 1


if __name__ == "__main__":
    sys.exit(main())

"""A small change of every kind that CONTRIBUTING.md has a recipe for: the files that the change makes or edits."""

import shutil
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest_rvads

ROOT = Path(__file__).parents[2]
Edits = Mapping[str, str | tuple[tuple[str, str], ...]]
"""By file: the content of a new file; or texts that a file has, each with the text that is inserted behind it."""


@dataclass(frozen=True, slots=True)
class Change:
    """A thing that is added to a copy of the project."""

    name: str
    """Name of the thing, as tables spell it."""
    code: Edits
    """Makes the thing."""
    tables: Edits
    """Names the thing where the things of its kind are listed, and tests it."""
    works: str
    """Raises an error unless the thing is there."""


CHANGES = {
    "a rule": Change(
        "top_speed",
        {
            "pytest_rvads/logic/rules/rulebooks.py": (
                (
                    '        responsible="the vehicle that speeds",\n        bound=("a",),\n    ),\n',
                    """    _rule(
        "top_speed",
        "forall a. G a.sp <= 40",
        "top speed",
        "No vehicle drives faster than 40 m/s.",
        source="regional law",
        responsible="the fast vehicle",
        bound=("a",),
    ),
""",
                ),
            )
        },
        {
            "docs/rules.md": (("no_collision, no_conflict, ", "top_speed, "),),
            "tests/logic/test_road_rules.py": (
                (
                    "STAND = (0, 0.0)\n",
                    """

@pytest.mark.parametrize(("speed", "outcome"), [(39.0, ("PASS", None)), (41.0, ("FAIL", 1.0))])
def test_nobody_drives_faster_than_the_top_speed(drive: Make, speed: float, outcome: Any) -> None:
    verdict = check(drive("stop4", {0: (2, -90.0, [(0, 30.0), (100, speed)])}, 150), "top_speed")
    assert (verdict.status, verdict.time) == outcome


""",
                ),
            ),
        },
        'from pytest_rvads.logic.rules.book import rulebook; assert "top_speed" in [rule.name for rule in rulebook("road")]',
    ),
    "a word": Change(
        "reverses",
        {
            "pytest_rvads/logic/conduct/reversing.py": '''"""Driving backwards."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blocks import Block, signal
from pytest_rvads.logic.conduct.standing import STANDSTILL

__all__ = ["reverses"]


@signal
def reverses(block: Block) -> NDArray[np.bool_]:
    """Whether each vehicle drives backwards."""
    backwards: NDArray[np.bool_] = block.need("speed") < -STANDSTILL
    return backwards
''',
            "pytest_rvads/logic/rules/lexicon.py": (
                (
                    "from pytest_rvads.logic.ltl import formula as f\n",
                    "from pytest_rvads.logic.conduct.reversing import reverses\n",
                ),
                (
                    "BUILT_IN: Vocabulary = Vocabulary.of(\n",
                    '    _word("reverses", _ONE, reverses, "{0} backs off", "{0} does not back off", turns_on=_MOVES),\n',
                ),
            ),
        },
        {"docs/rules.md": (("`idles(a)`, ", "`reverses(a)`, "),)},
        'from pytest_rvads.logic.rules.lexicon import BUILT_IN; BUILT_IN["reverses"]',
    ),
    "a simulator": Change(
        "echo",
        {
            "pytest_rvads/satellites/echo.py": '''"""The usual engine under another name."""

from __future__ import annotations

from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.loop import Loop
from pytest_rvads.simulators.loop import usual
from pytest_rvads.support.installed import versions

__all__ = ["echo"]


class Echo:
    """A simulator of planar vehicle dynamics."""

    name = "echo"

    def __call__(self, case: Case) -> Run:
        """Return the run of a case."""
        return Loop(case, self.name, usual().engine.world, versions()).drive()

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest safe speed before the stopping line [m/s]."""
        return usual().vmax(distance, aggression, vehicle)


echo = Echo()
''',
            "pyproject.toml": (('[project.entry-points."rvads.simulators"]\n', 'echo = "pytest_rvads.satellites.echo:echo"\n'),),
        },
        {
            "tests/simulators/test_conformance.py": (('SHIPPED = {"bullet": "pybullet", ', '"echo": "numpy", '),),
            "docs/simulators.md": (
                (
                    "| installed by | wheels |\n|---|---|---|---|\n",
                    "| `echo` | as the usual engine | the package | as the engine |\n",
                ),
            ),
        },
        'from pytest_rvads.simulators.simulator import named; named("echo")',
    ),
    "a report format": Change(
        ".plain",
        {
            "pytest_rvads/report/plain_text.py": '''"""A report as plain text."""

from __future__ import annotations

from pathlib import Path

from pytest_rvads.report.outline import outline
from pytest_rvads.report.session_report import Report

__all__ = ["plain_text"]


def plain_text(report: Report, _folder: Path) -> str:
    """Return all that a report says, a line per sentence."""
    return "".join(f"{line}\\n" for block in outline(report) for line in (block.title, *block.plain()))
''',
            "pytest_rvads/report/files.py": (
                (
                    "from pytest_rvads.satellites.pages.page import page\n",
                    "from pytest_rvads.report.plain_text import plain_text\n",
                ),
                ('    ".html": page,\n', '    ".plain": plain_text,\n'),
            ),
        },
        {"docs/sessions.md": (("`.html` and `.md` for people, ", "`.plain` for terminals, "),)},
        'from pytest_rvads.report.files import fitting; fitting("report.plain")',
    ),
    "a kind of agent": Change(
        "tram",
        {
            "pytest_rvads/runs/states.py": (
                (
                    '    PEDESTRIAN = "pedestrian", "pedestrian", "walker", "person"\n',
                    '    TRAM = "tram", "tram", "streetcar"\n',
                ),
            )
        },
        {
            "clients/c/rvads.h": (("RVADS_CYCLIST, RVADS_PEDESTRIAN", ", RVADS_TRAM"),),
            "docs/attach-your-stack.md": (("`kind` (car, truck, cyclist, pedestrian", ", tram"),),
        },
        'from pytest_rvads.satellites.tracks.samples import kind_of; assert kind_of("Streetcar") == "tram"',
    ),
    "a map format": Change(
        "star",
        {
            "pytest_rvads/satellites/star.py": '''"""OpenDRIVE under another suffix."""

from __future__ import annotations

import os

from pytest_rvads.geometry.network import Network
from pytest_rvads.geometry.opendrive.builder import read_network

__all__ = ["read_star"]


def read_star(path: str | os.PathLike[str]) -> Network:
    """Return the network of a file."""
    return read_network(path)
''',
            "pyproject.toml": (
                (
                    'osm = "pytest_rvads.satellites.lanelet2.lanelet_map:read_lanelet2"\n',
                    'star = "pytest_rvads.satellites.star:read_star"\n',
                ),
            ),
        },
        {
            "docs/maps.md": (("## What is read how\n", "\n- **Stars.** A `.star` file is OpenDRIVE.\n"),),
            "tests/satellites/test_star.py": '''"""Maps of the format star."""

from pytest_rvads.geometry.builtin import path_of
from pytest_rvads.geometry.road_map import READERS


def test_file_of_the_format_is_read() -> None:
    assert len(READERS[".star"](path_of("stop4")).junctions) == 1
''',
        },
        "from pytest_rvads.geometry.builtin import path_of; from pytest_rvads.geometry.road_map import READERS; "
        'READERS[".star"](path_of("stop4"))',
    ),
    "a log format": Change(
        "buoys",
        {
            "pytest_rvads/satellites/buoys.py": '''"""Logs with a line per place of a front bumper: time, name, x and y."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from pytest_rvads.satellites.tracks.logformats import Format
from pytest_rvads.satellites.tracks.samples import Gather, Log
from pytest_rvads.satellites.tracks.source import Watch, opened
from pytest_rvads.support.errors import RunError

__all__ = ["FORMAT"]


def read_buoys(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of a file."""
    if columns:
        raise RunError(f"{path.name}: buoys have fixed fields, leave --columns out")
    with opened(path, watch) as source:
        gather = Gather(source.where, {}, strict=strict)
        for row, line in enumerate(source.lines(), start=1):
            time, name, x, y = line.decode().split()
            gather.add(name, row, (float(time), float(x), float(y), math.nan, math.nan))
        return gather.log()


FORMAT = Format(read_buoys, (".buoys",), "front")
''',
            "pyproject.toml": (('[project.entry-points."rvads.logs"]\n', 'buoys = "pytest_rvads.satellites.buoys:FORMAT"\n'),),
        },
        {
            "docs/bring-recorded-runs.md": (
                (
                    "| format | `--format` | recognised by |\n|---|---|---|\n",
                    "| places of front bumpers | `buoys` | `.buoys` |\n",
                ),
            ),
            "tests/satellites/test_buoys.py": '''"""Logs of the format buoys."""

from pathlib import Path

from pytest_rvads.satellites.tracks.logformats import read_log


def test_file_of_the_format_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.buoys").write_text("0.0 bus 1.0 2.0\\n0.1 bus 1.5 2.0\\n", encoding="utf-8")
    log, point = read_log(tmp_path / "a.buoys")
    assert (point, [vehicle.points.tolist() for vehicle in log.vehicles]) == ("front", [[[1.0, 2.0], [1.5, 2.0]]])
''',
        },
        'from pytest_rvads.satellites.tracks.logformats import formats; formats()["buoys"]',
    ),
    "a driver or traffic policy": Change(
        "idler",
        {
            "pytest_rvads/drivers/idler.py": '''"""A traffic policy that never goes."""

from __future__ import annotations

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.reference import Reference

__all__ = ["Idler"]


class Idler(Reference):
    """Stands where it is."""

    def target_speed(self, _seen: Observation) -> float:
        """Return no speed [m/s]."""
        return 0.0
''',
            "pytest_rvads/drivers/traffic.py": (
                ("import numpy as np\n\n", "from pytest_rvads.drivers.idler import Idler\n"),
                ('    "stopped": Stopped,\n', '    "idler": Idler,\n'),
            ),
        },
        {
            "docs/attach-your-stack.md": (
                ('| `"stopped"` | drives up to the line and never goes on |\n', '| `"idler"` | stands |\n'),
            ),
            "tests/honesty/catalogue.py": (
                (
                    "    # The reference autopilot, at an all-way stop and at lights, among every policy of traffic.\n",
                    '    Entry("reference_among_idler", CONFLICTS, "waits behind others that stand", "no FAIL, no ERROR"),\n',
                ),
            ),
        },
        'from pytest_rvads.drivers.traffic import traffic; traffic("idler")',
    ),
}
"""A change per recipe, by its heading."""


def copied(folder: Path) -> None:
    """Copy the package, its tests and its tables."""
    ignore = shutil.ignore_patterns("__pycache__", ".*")
    shutil.copytree(Path(pytest_rvads.__file__).parent, folder / "pytest_rvads", ignore=ignore)
    for name in ("tests", "tools", "docs", "clients"):
        shutil.copytree(ROOT / name, folder / name, ignore=ignore)
    for name in ("pyproject.toml", "CONTRIBUTING.md"):
        shutil.copy(ROOT / name, folder)


def edit(folder: Path, edits: Edits) -> None:
    """Make files of a copy, or insert texts into files of the copy."""
    for name, change in edits.items():
        file = folder / name
        if isinstance(change, str):
            file.write_text(change, encoding="utf-8")
            continue
        text = file.read_text(encoding="utf-8")
        for before, inserted in change:
            assert text.count(before) == 1, (name, before)
            text = text.replace(before, before + inserted)
        file.write_text(text, encoding="utf-8")


def install(folder: Path) -> None:
    """Declare the entry points of a copy, as an installation does."""
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    info = folder / f"pytest_rvads-{project['version']}.dist-info"
    info.mkdir()
    head = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (info / "METADATA").write_text(head, encoding="utf-8")
    groups = project["entry-points"].items()
    lines = [
        line for group, entries in groups for line in (f"[{group}]", *(f"{name} = {value}" for name, value in entries.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")

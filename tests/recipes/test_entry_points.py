"""Packages of others add simulators, marks, policies, formats of maps, tracks and reports, and commands by entry points."""

import json
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import pytest_rvads
from pytest_rvads.geometry.opendrive.map_file import path_of

RVADS = [sys.executable, "-c", "from pytest_rvads.cli import main; raise SystemExit(main())"]
PYTEST = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider"]
TESTS = """
import pytest_rvads as rvads

@rvads.scenario("stop4", classes=1, grid="E", rules=("p1", "p2"), duration=1)
def test_rules(run, rule, monitor):
    monitor.verdict(rule)
"""
MODULE = """
import pytest_rvads as rvads
from pytest_rvads.geometry.opendrive.builder import read_network
from pytest_rvads.session.collection.cells import Cell
from pytest_rvads.session.collection.misuse import caller
from pytest_rvads.session.collection.searching import Found, SearchMark, Shown
from pytest_rvads.satellites.tracks.csvfile import read_csv
from pytest_rvads.satellites.tracks.logformats import Format
from pytest_rvads.simulators.loop import Loop, usual

class Mine:
    name = "mine"
    libraries = ("no_such_library",)
    def __call__(self, case, watch=None):
        raise AssertionError("no case is simulated")
    def vmax(self, distance, aggression=1, vehicle=None):
        return None

class Twin(Mine):
    name = "twin"
    libraries = ("msgspec",)
    def __call__(self, case, watch=None):
        return Loop(case, self.name, usual().engine.world, {}, watch=watch).drive()

mine, twin = Mine(), Twin()
beacons = Format(read_csv, (".beacons",))

class Sleepy(rvads.Reference):
    pass

def slowest(junction, speeds):
    def search(asked):
        scenario = rvads.Scenario(rvads.find(junction), "1000", subject=0, distance=20, speed=asked.target, duration=1)
        run = rvads.simulate(rvads.Case(scenario, asked.driver, fleet=asked.fleet), asked.simulator)
        failure = rvads.RuleViolation(f"{asked.target} m/s is too slow") if asked.target < 2 else None
        return Found(failure, Shown(scenario, run, [rvads.check(run, "full_stop")], None))

    scenario = rvads.Scenario(rvads.find(junction), "1000", subject=0)
    cells = [Cell(scenario, None, None, f"v{speed}", f"v{speed}", {"junction": junction}, ()) for speed in speeds]
    return SearchMark("slowest", caller(), None, search, list(zip(speeds, cells)))

def words(report, folder):
    return f"{len(report.records)} items, {folder.name}"

def octets(report, folder):
    return bytes([0xff, len(report.records)])

def declare(commands):
    commands.add_parser("greet").set_defaults(command=lambda options: print("hello") or 0)
"""
ENTRIES = """
[rvads.simulators]
mine = own_package:mine
gone = no_such_module:gone
twin = own_package:twin
[rvads.maps]
own = own_package:read_network
[rvads.logs]
beacons = own_package:beacons
[rvads.marks]
slowest = own_package:slowest
[rvads.policies]
sleepy = own_package:Sleepy
[rvads.reports]
words = own_package:words
octets = own_package:octets
[rvads.commands]
greet = own_package
"""


def run(folder: Path, *words: str, program: list[str] = RVADS) -> subprocess.CompletedProcess[str]:
    """Run ``rvads``, or another program, where a package of others is installed."""
    (folder / "own_package.py").write_text(MODULE, encoding="utf-8")
    info = folder / "own_package-1.0.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-package\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(ENTRIES, encoding="utf-8")
    places = (str(folder), str(Path(pytest_rvads.__file__).parents[1]))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places)}
    return subprocess.run([*program, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.extended
def test_command_of_another_package_is_a_command_of_rvads(tmp_path: Path) -> None:
    assert run(tmp_path, "greet").stdout == "hello\n"


@pytest.mark.extended
def test_map_format_of_another_package_is_read_by_its_suffix(tmp_path: Path) -> None:
    (tmp_path / "crossing.own").write_bytes(path_of("stop4").read_bytes())
    done = run(tmp_path, "map", "crossing.own")
    assert (done.returncode, done.stderr) == (0, "")
    assert "1 of 1 usable" in done.stdout


@pytest.mark.extended
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("import", "x.beacons", "--format", "bacons"),
            "is no format of tracks, known are csv, .*beacons.*did you mean 'beacons'",
        ),
        (("dynamics", "braking", "--simulator", "mine"), "simulator 'mine' needs the package no_such_library"),
        (("dynamics", "braking", "--simulator", "gone"), "simulator 'gone' can't be loaded: No module named 'no_such_module'"),
        (("dynamics", "braking", "--simulator", "men"), "there is bullet, mujoco, gone, mine, sumo, .*did you mean 'mine'"),
    ],
)
def test_names_of_another_package_are_known_to_commands(tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    if words[0] == "import":
        words = (*words, "--junction", "stop4", "-o", "out.npz")
    done = run(tmp_path, *words)
    assert done.returncode == 2
    assert re.search(message, done.stderr)


@pytest.mark.extended
def test_report_names_the_library_of_a_simulator_of_another_package(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(TESTS, encoding="utf-8")
    options = ("--rvads-autopilot=reference", "--rvads-simulator=twin", "--rvads-report=out.json", "--rvads-report=out.md")
    run(tmp_path, *options, program=PYTEST)
    library = version("msgspec")
    assert f"twin (msgspec {library}): 1 run" in (tmp_path / "out.md").read_text("utf-8")
    assert json.loads((tmp_path / "out.json").read_text("utf-8"))["versions"]["msgspec"] == library


@pytest.mark.extended
def test_mark_of_another_package_makes_items_that_search_and_report(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(
        "import pytest_rvads as rvads\n\n@rvads.slowest('stop4', [1, 3])\ndef test_gaps():\n    print('the body runs')\n", "utf-8"
    )
    done = run(tmp_path, "-rA", "--rvads-autopilot=reference", "--rvads-report=out.json", program=PYTEST)
    assert "RuleViolation: 1 m/s is too slow" in done.stdout
    assert "test_it.py::test_gaps[v3]" in done.stdout
    assert done.stdout.count("\nthe body runs") == 1
    slow, fast = json.loads((tmp_path / "out.json").read_text("utf-8"))["records"]
    assert (slow["outcome"], fast["outcome"], fast["junction"]) == ("failed", "passed", "stop4")
    assert slow["driver"].endswith(".Reference")
    assert slow["hash"] != fast["hash"]


@pytest.mark.extended
def test_policy_of_another_package_has_its_name(tmp_path: Path) -> None:
    code = (
        "import own_package, pytest_rvads as rvads; from pytest_rvads.drivers.traffic import policy_name;"
        "print(policy_name(own_package.Sleepy), rvads.traffic('sleepy').__name__); rvads.traffic('slepy')"
    )
    done = run(tmp_path, "-c", code, program=[sys.executable])
    assert done.stdout == "sleepy Sleepy\n"
    assert "there are reference, " in done.stderr
    assert "lgsvl, sleepy, sumo; did you mean 'sleepy'?" in done.stderr.replace(": did", "; did")


@pytest.mark.extended
def test_report_format_of_another_package_is_written_by_sessions_check_town_and_comparisons(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(TESTS, encoding="utf-8")
    (tmp_path / "cross.xodr").write_bytes(path_of("stop4").read_bytes())
    names = ("out/session.words", "out/session.octets", "out/session.json")
    run(tmp_path, *(f"--rvads-report={name}" for name in names), "--rvads-keep=kept", program=PYTEST)
    run(tmp_path, "check", "kept", "--rules", "p1", "-o", "out/check.words")
    town = ("town", "cross.xodr", "--autopilot", "reference", "--rules", "p1", "--sample", "1")
    run(tmp_path, *town, "-o", "town")
    (results,) = (tmp_path / "town").glob("results-*.jsonl")
    run(tmp_path, "report", "merge", str(results), "-o", "out/town.words")
    run(tmp_path, "report", "compare", names[2], names[2], "-o", "out/comparison.words")
    written = {path.stem: path.read_text(encoding="utf-8") for path in (tmp_path / "out").glob("*.words")}
    assert written == {"session": "2 items, out", "check": "1 items, out", "town": "1 items, out", "comparison": "2 items, out"}
    assert (tmp_path / "out/session.octets").read_bytes() == b"\xff\x02"
    refused = run(tmp_path, "check", "kept", "-o", "check.wirds")
    assert "a report is a .json, .html, .md, .csv, .xml, .octets, .words file, got 'check.wirds'" in refused.stderr

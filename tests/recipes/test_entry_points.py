"""Packages of others add simulators, map formats, formats of tracks and commands by entry points."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import pytest_rvads
from pytest_rvads.junctions.builtin import path_of

RVADS = [sys.executable, "-c", "from pytest_rvads.cli import main; raise SystemExit(main())"]
MODULE = """
from pytest_rvads.opendrive.builder import read_network
from pytest_rvads.satellites.tracks.csvfile import read_csv
from pytest_rvads.satellites.tracks.logformats import Format

class Mine:
    name = "mine"
    libraries = ("no_such_library",)
    def __call__(self, case):
        raise AssertionError("no case is simulated")
    def vmax(self, distance, aggression=1, vehicle=None):
        return None

mine = Mine()
beacons = Format(read_csv, (".beacons",))

def declare(commands):
    commands.add_parser("greet").set_defaults(command=lambda options: print("hello") or 0)
"""
ENTRIES = """
[rvads.simulators]
mine = own_package:mine
gone = no_such_module:gone
[rvads.maps]
own = own_package:read_network
[rvads.logs]
beacons = own_package:beacons
[rvads.commands]
greet = own_package
"""


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run ``rvads`` where a package of others is installed."""
    (folder / "own_package.py").write_text(MODULE, encoding="utf-8")
    info = folder / "own_package-1.0.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-package\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(ENTRIES, encoding="utf-8")
    places = (str(folder), str(Path(pytest_rvads.__file__).parents[1]))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places)}
    return subprocess.run([*RVADS, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False)


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
        (("braking", "--simulator", "mine"), "simulator 'mine' needs the package no_such_library"),
        (("braking", "--simulator", "gone"), "simulator 'gone' can't be loaded: No module named 'no_such_module'"),
        (("braking", "--simulator", "men"), "there is bullet, mujoco, gone, mine, sumo, .*did you mean 'mine'"),
    ],
)
def test_names_of_another_package_are_known_to_commands(tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    if words[0] == "import":
        words = (*words, "--junction", "stop4", "-o", "out.npz")
    done = run(tmp_path, *words)
    assert done.returncode == 2
    assert re.search(message, done.stderr)

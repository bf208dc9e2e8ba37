"""Drivers and modules that end their process, hang or catch everything: no command of ``rvads`` passes or hangs by them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.opendrive.map_file import path_of

START = "stop3-class00-as022-s2-cfgd20.00_20.00_24.08v00.00_08.00_08.00"
MAP = str(path_of("stop3"))
COMMANDS = {
    "town": ("town", MAP, "--sample", "1", "-j", "1"),
    "critical": ("critical", "stop3", "-j", "1", "--rules", "full_stop"),
    "start": ("critical", "stop3", "--start", START),
    "all_lines": ("critical", "stop3", "--all-lines", "-j", "1", "--probes", "0", "--rules", "full_stop"),
    "pedals": ("dynamics", "pedals"),
    "dynamics": ("dynamics",),
}
EXITS = """
import sys

import pytest_rvads as rvads


class Mine(rvads.Reference):
    def vmax(self):
        return 1.0


{end}
"""
DRIVERS = """
import os
import sys
import time
from pathlib import Path

import pytest_rvads as rvads


class Leaves(rvads.Reference):
    def control(self, seen):
        os._exit(0)


class Exits(rvads.Reference):
    def control(self, seen):
        sys.exit(0)


class ExitsEarly(rvads.Reference):
    def __init__(self):
        sys.exit(0)


class Swallows(rvads.Reference):
    def control(self, seen):
        Path("asked").touch()
        while True:
            try:
                time.sleep(0.1)
            except BaseException:
                pass


class Simulator:
    name = "exits"

    def __call__(self, case, watch=None):
        sys.exit(0)

    def vmax(self, distance, aggression=1, vehicle=None):
        sys.exit(0)


simulator = Simulator()
hasty = rvads.limits(0.3)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with drivers."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("exiting", "ending"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    (tmp_path / "ending.py").write_text(DRIVERS)
    return tmp_path


def sentence(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Return the last line on standard error of a command that must end with the status 2."""
    assert main(words) == 2
    return capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("command", COMMANDS)
def test_module_that_exits_at_its_import_is_named_with_its_line(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("exiting.py").write_text(EXITS.format(end="sys.exit(0)"))
    told = sentence(capsys, *COMMANDS[command], "--autopilot", "exiting:Mine")
    assert told.endswith("got 'exiting:Mine': exiting raised SystemExit: 0 (exiting.py:12)")


@pytest.mark.parametrize(
    ("end", "reason"),
    [
        ("sys.exit()", "exiting raised SystemExit"),
        ("raise SystemExit('bye')", "exiting raised SystemExit: bye (exiting.py:12)"),
        ("import pytest; pytest.skip('no', allow_module_level=True)", "exiting raised Skipped: "),
        ("import os; os._exit(0)", "exiting ended its process while it was imported"),
    ],
)
@pytest.mark.parametrize("option", ["--autopilot", "--simulator"])
def test_module_that_ends_in_any_way_at_its_import_is_refused(
    end: str, reason: str, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("exiting.py").write_text(EXITS.format(end=end))
    words = ("--autopilot", "reference") if option == "--simulator" else ()
    assert reason in sentence(capsys, *COMMANDS["pedals"], *words, option, "exiting:Mine")


def test_module_of_a_driver_in_a_league_is_named_with_its_entry(capsys: pytest.CaptureFixture[str]) -> None:
    Path("exiting.py").write_text(EXITS.format(end="sys.exit(0)"))
    Path("l.toml").write_text('junctions = ["stop4"]\ncells = 1\n[drivers]\nmine = { autopilot = "exiting:Mine" }\n')
    assert "l.toml: drivers.mine: --autopilot must name" in sentence(capsys, "league", "l.toml", "-j", "1")


@pytest.mark.parametrize("command", COMMANDS)
def test_driver_that_ends_its_process_is_no_pass(command: str) -> None:
    code = "import sys; from pytest_rvads.cli import main; sys.exit(main())"  # in this process it would end the tests
    words = [sys.executable, "-c", code, *COMMANDS[command], "--autopilot", "ending:Leaves"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == (1 if command == "town" else 2)
    assert "died" in done.stdout + done.stderr


@pytest.mark.parametrize("driver", ["Exits", "ExitsEarly"])
@pytest.mark.parametrize("command", ["start", "pedals"])
def test_driver_that_exits_is_a_fault(command: str, driver: str, capsys: pytest.CaptureFixture[str]) -> None:
    status = main([*COMMANDS[command], "--autopilot", f"ending:{driver}"])
    assert status == (1 if command == "start" else 2)
    out, err = capsys.readouterr()
    assert "raised SystemExit: 0 (ending.py:" in out + err


def test_simulator_that_exits_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--simulator", "ending:simulator")
    assert "called raised SystemExit: 0 (ending.py:" in sentence(capsys, "dynamics", "braking", *words)
    assert "called raised SystemExit: 0 (ending.py:" in sentence(capsys, *COMMANDS["pedals"], "--autopilot", "reference", *words)


def test_driver_that_hangs_and_catches_everything_ends_its_process() -> None:
    code = "import sys; from pytest_rvads.cli import main; sys.exit(main())"
    words = [sys.executable, "-c", code, *COMMANDS["start"], "--autopilot", "ending:Swallows", "--simulator", "ending:hasty"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "in control" in done.stderr, "the stacks of the process"
    assert done.stderr.splitlines()[-1].startswith("rvads: the process that worked on it died, ")


@pytest.mark.parametrize("command", ["start", "critical"])
def test_termination_ends_a_command_whose_driver_catches_everything(command: str, folder: Path) -> None:
    code = "import sys; from pytest_rvads.cli import main; sys.exit(main())"
    words = [sys.executable, "-c", code, *COMMANDS[command], "--autopilot", "ending:Swallows"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        try:
            for _ in range(300):
                if (folder / "asked").exists():
                    break
                time.sleep(0.1)
            os.kill(process.pid, signal.SIGTERM)
            _, err = process.communicate(timeout=10)
        finally:
            process.kill()
    assert process.returncode == 130
    assert err.splitlines()[-1] == "rvads: interrupted"

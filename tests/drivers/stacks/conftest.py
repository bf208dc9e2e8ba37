"""Stacks for tests: compiled ones, faulty ones, and a count of the processes they are."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pytest_rvads.drivers.stacks.process import Process

Find = Callable[[str], list[int]]

ROOT = Path(__file__).parents[3]
FAULTY = Path(__file__).with_name("faulty.py")
CLINGING = Path(__file__).with_name("clinging.py")


def wait_for(condition: Callable[[], object], seconds: float = 120.0) -> bool:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def faulty_command(fault: str, scenario: int = 1, decision: int = 3) -> list[str]:
    return [sys.executable, "-I", "-S", str(FAULTY), fault, str(scenario), str(decision)]


@pytest.fixture
def faulty() -> Iterator[Callable[..., Process]]:
    """Return a function that makes a stack which fails: which fault, in which scenario, at which decision."""
    made = []

    def make(fault: str, scenario: int = 1, decision: int = 3, startup: float = 60.0) -> Process:
        # Only what is meant to come too late may be cut off soon: a busy machine is no fault of a stack.
        timeout = 1.0 if fault in ("hang", "late") else 60.0
        made.append(Process(faulty_command(fault, scenario, decision), timeout=timeout, startup=startup))
        return made[-1]

    yield make
    for stack in made:
        stack.close()


@pytest.fixture(scope="session")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile the example of the C++ client as its documentation says, and return the program."""
    if shutil.which("g++") is None:
        pytest.skip("needs g++")
    folder = tmp_path_factory.mktemp("stack")
    for file in (ROOT / "clients" / "c").iterdir():
        shutil.copy(file, folder)
    done = subprocess.run(
        ["g++", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2", "-o", "stack", "example.cpp"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder / "stack"


@pytest.fixture
def marked() -> Find:
    """Return a function that lists the processes with a word on their command line."""

    def find(word: str) -> list[int]:
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit() and int(entry.name) != os.getpid():
                try:
                    line = (entry / "cmdline").read_bytes().decode(errors="replace")
                    state = (entry / "stat").read_text().rpartition(")")[2].split()[0]
                except OSError:
                    continue
                if word in line.split("\0") and state != "Z":
                    found.append(int(entry.name))
        return found

    return find

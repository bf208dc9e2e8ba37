"""The clients fit into the programs of others: in every standard of C and C++, wherever the header is included."""

import shutil
import subprocess
from pathlib import Path

import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.stacks.process import Process
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate

from .conftest import ROOT

FOLDER = ROOT / "clients" / "c"
C = ["c99", "c11", "c17"]
CPP = ["c++11", "c++17"]


def build(compiler: str, standard: str, source: Path, program: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"needs {compiler}")
    flags = [f"-std={standard}", "-pedantic", "-Wall", "-Wextra", "-Werror", f"-I{FOLDER}"]
    done = subprocess.run([compiler, *flags, "-o", program, source], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("compiler", "standard"),
    [
        *((compiler, standard) for compiler in ("gcc", "clang") for standard in C),
        *((compiler, standard) for compiler in ("g++", "clang++") for standard in CPP),
    ],
)
@pytest.mark.parametrize("before", ["", "#include <stdio.h>\n"], ids=["first", "after another header"])
def test_the_header_compiles_in_every_standard(tmp_path: Path, compiler: str, standard: str, before: str) -> None:
    example = FOLDER / ("example.c" if standard in C else "example.cpp")
    source = tmp_path / example.name
    source.write_text(before + example.read_text(encoding="utf-8"), encoding="utf-8")
    build(compiler, standard, source, tmp_path / "stack")


@pytest.mark.parametrize("before", ["", "#include <stdio.h>\n"], ids=["first", "after another header"])
def test_the_example_in_c99_drives(tmp_path: Path, before: str) -> None:
    (tmp_path / "stack.c").write_text(before + (FOLDER / "example.c").read_text(encoding="utf-8"), encoding="utf-8")
    build("gcc", "c99", tmp_path / "stack.c", tmp_path / "stack")
    scenario = Scenario(find("stop4"), "1133", distance=20, subject=0, duration=15)
    with Process([str(tmp_path / "stack")]) as stack:
        run = simulate(Case(scenario, stack, traffic=Reference))
    assert run.fault is None
    assert {check(run, rule).status for rule in ("full_stop", "no_collision", "speed_limit")} == {"PASS"}
    assert 0.0 < run.provenance["timing"]["a0"]["compute"] < 60.0, "measured here where the header could not"

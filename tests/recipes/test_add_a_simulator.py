"""CONTRIBUTING.md, "Add a simulator": done as it says; and what docs/bring-a-simulator.md shows is what is printed."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

import pytest_rvads as rvads
from pytest_rvads.physics.body import Motion
from pytest_rvads.physics.engines import MujocoWorld
from pytest_rvads.runs.run import DT
from pytest_rvads.satellites.conformance.bench import Bench
from pytest_rvads.satellites.conformance.test_conformance import CHECKS, faults
from pytest_rvads.simulators.loop import Loop, usual
from pytest_rvads.simulators.patience import Watch
from pytest_rvads.simulators.simulator import named, simulators
from pytest_rvads.support.installed import entries, versions

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "bring-a-simulator.md").read_text(encoding="utf-8")


class Points:
    """A world of vehicles that go straight on and touch nothing: as simple as one that takes controls can be."""

    def __init__(self, _: Sequence[rvads.Vehicle], starts: Sequence[Motion]) -> None:
        self.now = list(starts)

    def motions(self) -> list[Motion]:
        return self.now

    def step(self, forces: Sequence[float]) -> None:
        self.now = [self.moved(motion, *forces[3 * k : 3 * k + 2]) for k, motion in enumerate(self.now)]

    @staticmethod
    def moved(motion: Motion, throttle: float, brake: float) -> Motion:
        left = max(0.0, 1.0 - 0.1 * brake + 0.01 * throttle)
        return motion._replace(x=motion.x + motion.vx * DT, y=motion.y + motion.vy * DT, vx=motion.vx * left, vy=motion.vy * left)

    def contacts(self) -> list[tuple[int, int]]:
        return []

    def remove(self, body: int) -> None:
        self.now[body] = self.now[body]._replace(vx=0.0, vy=0.0)

    def close(self) -> None:
        self.now = []


class Mine:
    name = "mine"

    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        return Loop(case, self.name, Points, versions(), controlled=True, watch=watch).drive()

    def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
        return min(distance, 11.0)


mine = Mine()


def test_a_simulator_is_a_world_in_the_loop_and_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    added = {**entries("simulators"), "mine": EntryPoint("mine", f"{__name__}:mine", "rvads.simulators")}
    monkeypatch.setattr("pytest_rvads.simulators.simulator.entries", lambda group: added)
    assert {"bullet", "mujoco", "mine"} <= simulators().keys()
    assert named("mine") is mine
    scenario = rvads.Scenario(rvads.find("stop4"), "2000", distance=20, speed=8.0, duration=0.5)
    run = rvads.simulate(rvads.Case(scenario, rvads.RollingStop), mine)
    assert (run.provenance["simulator"], run.steps) == ("mine", 51)


@pytest.mark.extended
def test_conformance_tests_find_what_such_a_simulator_lacks() -> None:
    bench = Bench(mine, (rvads.Reference,), (rvads.find("stop4"),))
    failed = {check for check in CHECKS if check != "another_process" and faults(check, bench)}
    assert {"crossing", "running_into", "refusals"} <= failed, "nobody touches anybody there"
    assert not failed & {"name", "starts", "clock", "seen", "faults", "hanging", "repeatable", "provenance"}


def test_a_world_of_controls_is_handed_what_drivers_answer_and_one_of_forces_is_not() -> None:
    pytest.importorskip("mujoco")
    handed: dict[bool, list[Sequence[float]]] = {True: [], False: []}

    class Brakes:
        def control(self, seen: rvads.Observation) -> rvads.Control:
            return rvads.Control(0.0, 0.75, 0.25 if seen.me.name == "a1" else -0.125)

    for controlled in handed:

        class Listens(MujocoWorld):
            def step(self, forces: Sequence[float]) -> None:
                handed[controlled].append(tuple(forces))  # noqa: B023 - it is called in this round
                super().step([0.0] * len(forces))

        case = rvads.Case(rvads.Scenario(rvads.find("stop4"), "2200", speed=5.0, duration=0.02), Brakes)
        Loop(case, "listens", Listens, {}, controlled=controlled).drive()
    assert handed[True] == [(0.0, 0.75, -0.125, 0.0, 0.75, 0.25)] * 2
    assert max(map(abs, handed[False][0])) > 100.0, "newtons"


@pytest.mark.extended
def test_the_page_shows_what_is_printed(tmp_path: Path) -> None:
    for code in re.findall(r"^```python\n(# (\w+\.py)\n.*?)^```", PAGE, re.MULTILINE | re.DOTALL):
        (tmp_path / code[1]).write_text(code[0].replace("rvads.bullet", f"rvads.{usual().name}"), encoding="utf-8")
    ((command, shown),) = re.findall(r"^\$ pytest (.*)\n((?:(?!```).*\n)*)", PAGE, re.MULTILINE)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), str(tmp_path)))}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *shlex.split(command)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    printed = done.stdout.splitlines()
    lines = shown.splitlines()[:-1]  # the last line stands for what follows
    assert printed[: len(lines)] == lines
    assert "1 failed, 25 passed" in printed[-1]


def test_page_names_all_checks_that_no_simulator_can_do_without() -> None:
    names = re.findall(r"`(\w+)`", PAGE.partition("Every simulator must support")[2].partition(":")[0])
    assert sorted(names) == sorted(name for name, (_, needed) in CHECKS.items() if needed)

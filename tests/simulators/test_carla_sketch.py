"""The sketch of CARLA as a simulator, held against an exchange written by hand and against a stand-in; no server was there.

The exchange is what CARLA's documented API would be asked, and would answer, in two ticks: a vehicle from the east, ten metres
before a red light at entrance 1 of the built-in junction, heads west and brakes.
"""

import json
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.satellites.conformance.bench import Bench
from pytest_rvads.satellites.conformance.test_conformance import CHECKS, faults, unsupported

ROOT = Path(__file__).parents[2]
EXCHANGE = [
    json.loads(line) for line in Path(__file__).with_name("carla_exchange.jsonl").read_text(encoding="utf-8").splitlines()
]


@pytest.fixture(autouse=True)
def _found(monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in (ROOT / "examples", Path(__file__).parent):
        monkeypatch.syspath_prepend(folder)


def sketch(connect: Any = None, steering: float = 1.2) -> Any:
    return import_module("carla_simulator").Carla(connect or stand_in().LeftHandedServer, steering, rvads.find("stop4"))


def stand_in() -> Any:
    return import_module("left_handed_server")


class Exchange:
    """Answers as the exchange says, where it is asked just that."""

    def __init__(self, lines: list[dict[str, Any]]) -> None:
        self.lines = list(lines)

    def __getattr__(self, call: str) -> Any:
        def answer(*given: Any) -> Any:
            line = self.lines.pop(0)
            assert (call, *given) == (line["call"], *(pytest.approx(v) if isinstance(v, float) else v for v in line["with"]))
            return line["answer"]

        return answer


class Left:
    """Brakes, then steers to the left."""

    def control(self, seen: rvads.Observation) -> rvads.Control:
        return rvads.Control(brake=1.0, steering=0.0 if seen.time == 0.0 else 0.3)


def test_it_asks_and_reads_in_the_frame_of_carla() -> None:
    exchange = Exchange(EXCHANGE)
    scenario = rvads.Scenario(rvads.find("light4"), "0200", distance=10, speed=5, duration=0.02)
    fleet = rvads.Fleet(rvads.Vehicle(length=4.8, width=2.1))
    run = rvads.simulate(rvads.Case(scenario, Left, fleet=fleet), sketch(lambda: exchange))
    assert exchange.lines == []
    assert run.fault is None
    # By hand: the bumper is 2.42 m before the location, at headings of 180, 180.1 and 179.8 degrees; the line is at x = 15 m.
    assert run.pose is not None
    assert run.pose[:, 0].tolist() == [
        pytest.approx([25.0, 1.75, 3.141593], abs=1e-5),
        pytest.approx([24.952004, 1.745776, 3.143338], abs=1e-5),
        pytest.approx([24.906015, 1.759447, 3.138102], abs=1e-5),
    ]
    assert run.need("station")[:, 0] == pytest.approx([-10.0, -9.952004, -9.906015], abs=1e-5)
    assert run.need("speed")[:, 0] == pytest.approx([5.0, 4.799993, 4.600042], abs=1e-5)
    assert [list(map(int, row)) for row in run.lights] == [[1, 3, 1, 3]] * 3


@pytest.mark.parametrize(
    ("line", "field", "value"), [(1, "with", ["car", 27.42, 1.75, 180.0]), (9, "with", [217, 0.0, 0.0, 1.0])]
)
def test_another_exchange_is_noticed(line: int, field: str, value: Any) -> None:
    other = [one | ({field: value} if number == line else {}) for number, one in enumerate(EXCHANGE)]
    scenario = rvads.Scenario(rvads.find("light4"), "0200", distance=10, speed=5, duration=0.02)
    case = rvads.Case(scenario, Left, fleet=rvads.Fleet(rvads.Vehicle(length=4.8, width=2.1)))
    with pytest.raises(AssertionError):
        rvads.simulate(case, sketch(lambda: Exchange(other)))


@pytest.fixture(scope="module")
def bench() -> Bench:
    with pytest.MonkeyPatch.context() as patch:
        for folder in (ROOT / "examples", Path(__file__).parent):
            patch.syspath_prepend(folder)
        return Bench(sketch(steering=stand_in().STEERING), (Reference,), (rvads.find("stop4"), rvads.find("light4")))


@pytest.mark.extended
@pytest.mark.parametrize("check", CHECKS)
def test_sketch_with_a_stand_in_for_the_server_passes_all_checks_but_those_of_bodies(check: str, bench: Bench) -> None:
    assert bool(faults(check, bench)) == (check in unsupported(bench.simulator))


def test_server_has_no_actors_after_a_run() -> None:
    servers = []

    def connect() -> Any:
        servers.append(stand_in().LeftHandedServer())
        return servers[-1]

    class Raises:
        def control(self, seen: rvads.Observation) -> rvads.Control:
            raise ValueError("no")

    for driver in (Left, Raises):
        rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "1111", duration=0.1), driver), sketch(connect))
    with pytest.raises(
        rvads.errors.ScenarioError, match=r"no room for vehicle 1 of .* in CARLA: Spawn failed because of collision"
    ):
        rvads.simulate(
            rvads.Case(rvads.Scenario(rvads.find("stop4"), "2000", followers=1, distance=1.0), Left),
            sketch(lambda: crowded(connect())),
        )
    assert [server.actors for server in servers] == [{}] * 3


def crowded(server: Any) -> Any:
    """Every vehicle after the first is told that there is no room."""
    spawn = server.spawn

    def refuse(*where: Any) -> int:
        if server.made:
            raise RuntimeError("Spawn failed because of collision at spawn position")
        return int(spawn(*where))

    server.spawn = refuse
    return server

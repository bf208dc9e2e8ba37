"""What a driver can have: any object will do, a wrapper has all of them, types are checked."""

import copy
import pickle
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.naming import called, name_of
from pytest_rvads.geometry.ways import Movement
from pytest_rvads.runs.states import Agent
from pytest_rvads.satellites.relations.variants import renamed
from pytest_rvads.simulators.seat import crew

AGENTS = [Agent(f"a{k}", Movement(k, (k + 2) % 4, rvads.values.Turn.STRAIGHT, 10.0, "m")) for k in range(2)]
CONTROL = rvads.Control(brake=1.0)


def driving(**attributes: object) -> type:
    return type("Driver", (), {"control": lambda self, seen: CONTROL} | attributes)


@pytest.mark.parametrize("label", [3, b"mine"])
def test_a_label_is_a_text(label: object) -> None:
    case = rvads.Case(rvads.Scenario(rvads.find("stop4"), "2000", duration=0.05), driving(label=label))
    says = f"Driver can't drive a0: its label must be a text, got an object of type {type(label).__name__}"
    assert rvads.simulate(case).fault.reason == says
    crew(AGENTS[:1], driving(label=None))


class Able:
    """Has everything that a driver can have, without a base."""

    period = 0.05
    label = "able"

    def control(self, seen: rvads.Observation) -> rvads.Control:
        return CONTROL

    def timing(self) -> dict[str, object]:
        return {"stack": "able", "decisions": 1, "compute": 0.5, "longest": 0.5}

    def abandon(self) -> str:
        return "last words"


class Ables(rvads.TrafficSystem):
    label = "ables"

    def autopilots(self, agents: Sequence[Agent], /) -> list[Able]:
        return [Able() for _ in agents]


NAMES = {agent.name: f"b{k}" for k, agent in enumerate(AGENTS)}


@pytest.mark.parametrize("factory", [Able, Ables, rvads.Reference])
def test_what_is_wrapped_has_every_ability(factory: type) -> None:
    plain, wrapped = crew(AGENTS, factory), crew(AGENTS, renamed(factory, NAMES))
    for one, other in zip(plain, wrapped, strict=True):
        assert other.name == one.name
        assert other.timing() == one.timing()
        for ability in ("period", "timing", "abandon"):
            here, there = (getattr(seat.autopilot, ability, None) for seat in (one, other))
            assert (here() == there()) if callable(here) else here == there, ability
    assert name_of(renamed(factory, NAMES)) == name_of(factory)
    for again in (copy.deepcopy(renamed(factory, NAMES)), pickle.loads(pickle.dumps(renamed(factory, NAMES)))):
        assert [seat.name for seat in crew(AGENTS, again)] == [seat.name for seat in plain]
    made = renamed(Ables, NAMES)()
    assert all(getattr(made, ability) for ability in ("autopilots", "prepare", "label"))


def test_a_base_gives_the_defaults() -> None:
    class Mine(rvads.Autopilot):
        def control(self, seen: rvads.Observation) -> rvads.TargetSpeed:
            return rvads.TargetSpeed(5.0)

    (seat,) = crew(AGENTS[:1], Mine)
    assert seat.name == Mine.__qualname__
    assert (seat.autopilot.period, seat.timing(), seat.autopilot.abandon()) == (0.01, None, "")
    assert called(Mine) == f"{__name__}.{Mine.__qualname__}"
    assert called(Able) == "able"
    with pytest.raises(TypeError, match="abstract"):
        rvads.Autopilot()  # type: ignore[abstract]


def test_subject_is_matched_by_name_and_not_by_entrance() -> None:
    """Two stand at entrance 0, one behind the other."""
    agents = [AGENTS[0], Agent("a0+1", Movement(0, 2, rvads.values.Turn.STRAIGHT, 10.0, "m")), AGENTS[1]]
    seats = crew(agents, Able, rvads.Reference, "a0+1")
    assert [seat.name for seat in seats] == ["Reference", "able", "Reference"]


SNIPPETS = """
from functools import partial
import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Factory

class Plain:
    def control(self, seen: rvads.Observation) -> rvads.Trajectory: ...

class Based(rvads.Autopilot):
    def control(self, seen: rvads.Observation) -> rvads.TargetSpeed: ...

class System:
    def autopilots(self, agents: object) -> list[Plain]: ...

class Mute:
    pass

def simulate(driver: Factory) -> None: ...

simulate(Plain); simulate(Based); simulate(System); simulate(rvads.Reference); simulate(partial(rvads.Reference, tie=0.5))
simulate(rvads.LgsvlLike); simulate(lambda: Plain()); simulate(rvads.Process("./stack")); simulate(rvads.traffic("hesitant"))
simulate(int)  # refused
simulate(Mute)  # refused
simulate(Plain())  # refused
rvads.scenario("stop4", subject=0, traffic=(Plain, "hesitant"))
rvads.scenario("stop4", subject=0, traffic=int)  # refused
rvads.falsify("stop4", rule="p1", autopilot=int)  # refused
rvads.falsify("stop4", rule="p1", near="x")  # refused
"""


@pytest.mark.extended
def test_a_type_checker_refuses_what_can_not_drive(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    (tmp_path / "snippets.py").write_text(SNIPPETS, encoding="utf-8")
    here = Path(rvads.__file__).parents[1]
    found = {} if here.name == "site-packages" else {"MYPYPATH": str(here)}  # mypy looks among what is installed by itself
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--follow-imports=silent", "snippets.py"],
        cwd=tmp_path,
        env={**found, "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    wrong = [int(line.split(":")[1]) for line in done.stdout.splitlines() if ": error:" in line and "[arg-type]" in line]
    expected = [number for number, line in enumerate(SNIPPETS.splitlines(), 1) if line.endswith("# refused")]
    assert wrong == expected, done.stdout + done.stderr

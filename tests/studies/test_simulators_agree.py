"""Both engines tell the same: verdicts, order of entry and who collides; a difference is found and told where there is one."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.physics.engines import BULLET, MUJOCO
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators import simulator
from pytest_rvads.simulators.loop import bullet
from pytest_rvads.simulators.patience import Watch
from pytest_rvads.support.errors import ScenarioError
from studies import agreement, simulators
from studies.agreement import Agreement, Mutant, Trial, agree, differences, same_order, text_agreements
from studies.case_sets import SETS, class_trials, recorded_trials
from studies.contact_cases import contact_cases
from studies.mutants import MUTANTS

pytest.importorskip("pybullet")
ENGINES = ("bullet", "mujoco")
EARLY = 0.011
"""Entry times and impacts may differ by one tick and what floats make of it [s]."""


@pytest.fixture(autouse=True)
def _both() -> None:
    for engine in (BULLET, MUJOCO):
        pytest.importorskip(engine.library)


def told(trials: Sequence[Trial | Mutant]) -> list[str]:
    """What differs on both engines, in lines; entry times that are far apart are among them."""
    lines = []
    count = 0
    for found in agree(ENGINES, trials, executor=1):
        count += 1
        lines += differences(found, ENGINES)
        lines += [f"{found.name}: entries differ by {shift} s" for shift in found.shifts if shift > EARLY]
        one, two = found.impacts
        if one is not None and two is not None and abs(one - two) > EARLY:
            lines.append(f"{found.name}: impacts at {one} s and {two} s")
    assert count == len(trials) > 0
    return lines


def every(name: str, step: int, first: int = 0) -> list[Trial | Mutant]:
    return list(islice(SETS[name](), first, None, step))


@pytest.mark.extended
def test_in_a_run_of_every_class_and_configuration_of_the_paper() -> None:
    """Rows in turn: the 4 classes in their 5 configurations, 60 cells."""
    trials = [trial for k, trial in enumerate(SETS["paper"]()) if k // 5 % 4 == k % 5 % 4]
    assert len(trials) == 20
    assert told(trials) == []


@pytest.mark.extended
def test_in_every_class_with_the_reference() -> None:
    """Classes of four ways at stop signs and at lights in turn, in five configurations; those of three ways at both."""
    trials = list(class_trials(("stop3", "light3"), "D"))
    for k, letter in enumerate("CDEIJ"):
        stop, light = (list(class_trials((name,), letter)) for name in ("stop4", "light4"))
        trials += [(stop, light)[number % 2][number] for number in range(k, len(stop), 5)]
    assert {trial.case.scenario.number for trial in trials if trial.case.scenario.ways == 4} == set(range(1, 25))
    assert told(trials) == []


@pytest.mark.extended
def test_where_signs_and_lanes_decide() -> None:
    assert told(list(class_trials(("yield4", "right4", "lanes4", "roundabout4"), "D", most=1))) == []


@pytest.mark.extended
def test_agreement_in_what_kills_a_mutant() -> None:
    assert told([Mutant("ignores stop")]) == []


@pytest.mark.parametrize("name", contact_cases())
def test_in_a_collision(name: str) -> None:
    case = contact_cases()[name]
    (found,) = agree(ENGINES, [Trial(case, ("no_collision",))], executor=1)
    assert differences(found, ENGINES) == []
    # Traffic is to blame where it runs into the vehicle ahead, or came to the stop sign second and goes on.
    blamed = "PROVOKED" if name in ("rear-end", "standing vehicle hit", "cyclist") else "FAIL"
    assert found.statuses == {"no_collision": (blamed, blamed)}
    ((pair,), _) = found.touched
    assert case.scenario.under_test in pair
    assert abs(found.impacts[0] - found.impacts[1]) <= EARLY


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("rear-end", 0, 1),
        ("standing vehicle hit", 0, 1),
        ("head-on", 150, 180),
        ("crossing", 88, 92),
        ("corner to side", 100, 140),
        ("side-swipe", 2, 12),
        ("truck and car", 88, 92),
        ("cyclist", 88, 92),
    ],
)
def test_contact_cases_match_their_names(name: str, least: float, most: float) -> None:
    """By the angle between the headings when they touch [degrees], and by who stands."""
    run = bullet(contact_cases()[name])
    collision = run.collisions[0]
    tick = round(collision.time / run.dt)
    columns = [[agent.name for agent in run.agents].index(agent) for agent in collision.agents]
    one, two = (run.pose[tick, column, 2] for column in columns)
    assert least <= math.degrees(abs(math.remainder(one - two, 2 * math.pi))) <= most
    assert (run.speed[tick, columns].min() < 0.1) == (name == "standing vehicle hit")


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_agreement_in_a_whole_set(name: str) -> None:
    assert told(every(name, 1)) == []


@pytest.mark.slow
@pytest.mark.parametrize("file", ["t-way-stop.json", "t-way-light.json"])
def test_in_predictions_of_recorded_runs(shared: Path, file: str) -> None:
    assert told(list(recorded_trials(shared / "runs" / file))) == []


def test_the_two_runs_are_by_two_engines() -> None:
    """Else there would be nothing to compare: bits differ, by far less than what any outcome hangs on."""
    case = next(iter(class_trials(("stop4",), "D"))).case
    one, two = (simulator.simulate(case, simulator.named(name)) for name in ENGINES)
    assert tuple(run.provenance["simulator"] for run in (one, two)) == ENGINES
    assert one.hash != two.hash
    assert 0.0 < abs(one.station - two.station).max() < 1e-6


def test_sets_are_as_large_as_the_paper_and_the_classes_say() -> None:
    paper = list(SETS["paper"]())
    assert sum(len(trial.rules) for trial in paper if isinstance(trial, Trial)) == 240
    assert len(list(SETS["classes"]())) == (4 + 24 + 4 + 24) * 10
    assert [mutant.name for mutant in SETS["mutants"]()] == list(MUTANTS)


class Deaf:
    """Bullet, but the first vehicle stands where it starts, and nobody collides: all stand where the run of bullet ends."""

    name = "deaf"

    def __call__(self, case: Case, watch: Watch | None = None) -> Run:
        run = bullet(case, watch)
        steps = round(case.scenario.duration / run.dt) + 1
        held = np.minimum(np.arange(steps), run.steps - 1)
        columns: dict[str, Any] = {name: getattr(run, name)[held] for name in ("zone", "lights", "station", "speed", "pose")}
        columns["speed"][run.steps :] = columns["speed"][:, 0] = 0.0
        for name in ("zone", "station", "pose"):
            columns[name][:, 0] = columns[name][0, 0]
        return replace(run, collisions=(), **columns)

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        return bullet.vmax(distance, aggression, vehicle)


deaf = Deaf()


@pytest.fixture
def with_deaf(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gives it a name."""
    monkeypatch.setattr(agreement, "named", lambda name: deaf if name == "deaf" else simulator.named(name))


@pytest.mark.usefixtures("with_deaf")
def test_difference_between_simulators_is_reported() -> None:
    case = contact_cases()["crossing"]
    (found,) = agree(("bullet", "deaf"), [Trial(case, ("no_collision",))], executor=1)
    assert not found.same
    lines = differences(found, ("bullet", "deaf"))
    name = case.scenario.name
    assert f"{name}: no_collision is FAIL by bullet, NA by deaf" in lines
    assert f"{name}: collided a0 with a1 by bullet and nobody by deaf" in lines
    assert any(line.startswith(f"{name}: another order of entry by bullet and deaf, a0 ") for line in lines)
    table = text_agreements({"one": [found]}, ("bullet", "deaf")).splitlines()
    assert table[2].startswith("| one | 1 | 0 of 1 | 0 of 1 | 0 of 1 | 0.00, 0.0000 |  |")
    assert table[3:] == ["", *(f"- {line}" for line in lines)]


def test_refusal_by_one_simulator_is_a_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(case: Case, by: simulator.Simulator) -> Run:
        if by.name == "mujoco":
            raise ScenarioError("no place for a0")
        return simulator.simulate(case, by)

    monkeypatch.setattr(agreement, "simulate", refuse)
    (found,) = agree(ENGINES, [Trial(contact_cases()["crossing"], ("no_collision",))], executor=1)
    lines = differences(found, ENGINES)
    assert any(line.endswith("simulating is nothing by bullet, refused (no place for a0) by mujoco") for line in lines)


def test_refusal_by_both_simulators_is_no_verdict() -> None:
    case = contact_cases()["crossing"].but(distance=1000.0)
    (found,) = agree(ENGINES, [Trial(case, ("no_collision",))], executor=1)
    (line,) = differences(found, ENGINES)
    assert re.search(r": simulating is refused \(.*1000.* by both$", line)
    assert "| far | 1 | 0 of 0 |  |" in text_agreements({"far": [found]}, ENGINES)


def test_the_order_of_entry_counts_ties_and_who_never_enters() -> None:
    assert same_order({"a": (1.0, 2.0), "b": (2.0, 3.0), "c": (None, None)})
    assert not same_order({"a": (1.0, 2.0), "b": (2.0, 2.0)})
    assert not same_order({"a": (1.0, 2.0), "b": (2.0, 1.0)})
    assert not same_order({"a": (1.0, 1.0), "b": (2.0, None), "c": (None, 3.0)})


def test_the_table_tells_the_greatest_and_the_mean_difference() -> None:
    found = Agreement("x", {"p1": ("PASS", "PASS")}, {"a": (1.0, 1.5), "b": (2.0, 2.1), "c": (None, 3.0)}, ((), ()), (None, None))
    assert found.same
    assert "| x set | 1 | 1 of 1 | 1 of 1 |  | 0.50, 0.3000 |  |" in text_agreements({"x set": [found]}, ENGINES)


def test_the_command_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert simulators.main([*ENGINES, "--set", "contacts", "--workers", "1", "--strict"]) == 0
    assert "| contacts | 8 | " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("bullet", "mujocco"), r"unknown simulator 'mujocco'.*did you mean 'mujoco'"),
        (("bullet", "mujoco", "--set", "clases"), r"--set must be one of paper, .* got 'clases'.*did you mean 'classes'"),
        (("bullet", "mujoco", "--workers", "0"), "--workers must be at least 1, got 0"),
        (("bullet", "mujoco", "--recorded", "nothing.json"), "nothing.json"),
    ],
)
def test_wrong_use_of_the_command_is_told(capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], says: str) -> None:
    assert simulators.main(arguments) == 2
    assert re.search(says, capsys.readouterr().err)

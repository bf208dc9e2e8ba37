"""Measuring how good the checks are: methods, races, tables."""

from itertools import combinations, islice, product

import pytest

import pytest_rvads as rvads
from pytest_rvads.satellites.starts.lines import Begin
from pytest_rvads.simulators.loop import usual
from studies import detection, power
from studies.critical_power import found_by
from studies.detection import Power, detects, interval, measure
from studies.killing import Killing
from studies.methods import METHODS
from studies.power_tables import plot, table_of_mutants, table_of_power


@pytest.mark.extended
@pytest.mark.parametrize("name", METHODS)
def test_a_seed_determines_the_sequence(name: str) -> None:
    one, same, other = ([s.name for s in islice(METHODS[name]("paper_light4", seed), 12)] for seed in (1, 1, 2))
    assert one == same != other


def test_class_covering_takes_every_class_in_every_configuration_once() -> None:
    seen = [(s.number, s.configuration) for s in islice(METHODS["class-covering"]("paper_stop4", 0), 120)]
    assert sorted(seen) == sorted(product(range(1, 25), "ABCDE"))


def test_pairwise_covers_all_pairs_of_levels_soon() -> None:
    """An array of strength 2 over 3, 3, 3, 3 and 5 levels has at least 15 rows; a greedy one has few more."""
    rows = [(*s.directions, s.configuration) for s in islice(METHODS["pairwise"]("paper_stop4", 3), 25)]
    levels = [(1, 2, 3)] * 4 + [tuple("ABCDE")]
    for (i, one), (j, two) in combinations(enumerate(levels), 2):
        assert {(row[i], row[j]) for row in rows} == set(product(one, two))


@pytest.mark.extended
def test_random_speeds_stay_inside_the_braking_envelope() -> None:
    for scenario in islice(METHODS["continuous"]("paper_stop4", 0), 10):
        for entrance in scenario.creation:
            distance, speed = scenario.start(entrance)
            assert speed <= (rvads.vmax(distance) or 0.0)


def test_ties_detect_i3_and_nothing_else() -> None:
    tied, simulator = rvads.Scenario(rvads.find("paper_stop4"), "2200"), usual().name
    assert detects(("I3", tied, None, simulator))
    assert not detects(("I1", tied, None, simulator))


def test_one_vehicle_among_traffic_has_the_deficiency() -> None:
    at_the_line = rvads.Scenario(rvads.find("paper_stop4"), "2200", distance=0.0, subject=0)
    simulator = usual().name
    assert detects(("I1", at_the_line, "reference", simulator)), "it drives off before it knows that it has to stop"
    assert not detects(("I3", at_the_line, "reference", usual().name)), (
        "which of several goes first is the traffic's own decision"
    )


def test_the_race_counts_up_to_the_first_that_detects(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detection, "detects", lambda job: job[1].configuration == "E")
    monkeypatch.setattr(detection, "METHODS", {name: METHODS[name] for name in ("class-covering", "pairwise")})
    found = measure(20, 10, deficiencies=["I3"], executor=1)
    assert [p.method for p in found] == ["class-covering", "pairwise"]
    covering = found[0]
    assert all(1 <= n <= 11 for n in covering.simulations)
    for seed, count in enumerate(covering.simulations):
        first = [s.configuration for s in islice(METHODS["class-covering"]("paper_stop4", seed), 10)]
        assert count == (first.index("E") + 1 if "E" in first else 11)


@pytest.mark.extended
def test_critical_starts_from_rest_find_i1() -> None:
    """A vehicle with I1 that waits at its line sets off, so it shows at starts whose subject stands at its line."""
    find = found_by("I1")
    assert {"p4", "p5", "p6"} & set(find.safety_rules)
    assert find.line is not None
    assert find.line.begin is Begin.REST


def test_the_bootstrap_interval_holds_the_median() -> None:
    assert interval((3,) * 20) == (3, 3)
    low, high = interval(tuple(range(1, 101)))
    assert 35 < low < 50.5 < high < 66  # median of 100: standard error about 1.25 * 29 / 10


def test_tables_and_plot() -> None:
    measured = [Power("I3", "uniform", (1, 2, 3, 4, 41), 40), Power("I3", "pairwise", (41, 41, 41), 40)]
    table = table_of_power(measured)
    assert "| I3 | 3 (" in table
    assert "80% |" in table
    assert "> 40 (> 40 to > 40), 0% |" in table
    assert plot(measured).count("<circle") == 2
    assert "**survives**" in table_of_mutants([Killing("deadlocks", "Waits.", (), ("mirror",))])


def test_command_line_misused(capsys: pytest.CaptureFixture[str]) -> None:
    assert power.main(["--seeds", "0"]) == 2
    assert "--seeds must be at least 1" in capsys.readouterr().err

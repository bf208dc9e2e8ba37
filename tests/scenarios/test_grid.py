"""Configurations and the braking envelope."""

import math

import pytest

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.scenarios.configurations import configuration, explicit, grid, outside, probe
from pytest_rvads.support.errors import ScenarioError


def test_letters_of_configurations_match_the_paper() -> None:
    # Column heads of the two tables of the paper (distance; speed).
    heads = {
        "A": ((0.01,) * 4, 0), "B": ((0.3,) * 4, 0), "C": ((20,) * 4, 0), "D": ((20,) * 4, 10), "E": ((0.3, 0.3, 20, 20), 0),
        "F": ((0.01,) * 4, 0), "G": ((0.3,) * 4, 0), "H": ((20,) * 4, 0), "I": ((20,) * 4, 10), "J": ((20, 0.3, 20, 0.3), 0),
    }  # fmt: skip
    for letter, (distances, speed) in heads.items():
        point = configuration(letter, 4)
        assert (point.distances, point.speeds) == (distances, (speed,) * 4), letter


def test_uneven_configurations_in_a_t() -> None:
    assert configuration("E", 3).distances == (0.3, 0.3, 20.0)
    assert configuration("J", 3).distances == (20.0, 0.3, 20.0)


def test_the_papers_grid_depends_on_the_control() -> None:
    assert "".join(p.label for p in grid("paper", 4, JunctionControl.STOP)) == "ABCDE"
    assert "".join(p.label for p in grid("paper", 4, JunctionControl.LIGHTS)) == "FGHIJ"
    assert "".join(p.label for p in grid(("CD", "C"), 4, JunctionControl.STOP)) == "CD"


def test_explicit_grids_are_products() -> None:
    points = explicit([5, (20, 20, 0.3, 0.3)], [0, 2.5], 4)
    assert [p.label for p in points] == [
        "d05.00v00.00",
        "d05.00v02.50",
        "d20.00_20.00_00.30_00.30v00.00",
        "d20.00_20.00_00.30_00.30v02.50",
    ]


def test_points_beyond_the_envelope_are_found() -> None:
    def envelope(distance: float) -> float:
        return math.sqrt(2 * 4.0 * distance)  # v^2 = 2 a d

    (inside,) = explicit(2.0, 4.0, 3)
    (fast,) = explicit((9.0, 9.0, 1.0), 4.0, 3)
    assert outside(inside, envelope) is None
    assert outside(fast, envelope) == (1.0, 4.0)
    assert outside(explicit(0.0, 0.0, 3)[0], lambda _: None) is None
    assert outside(explicit(0.0, 1.0, 3)[0], lambda _: None) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("distances", "speeds", "says"),
    [
        (-1, 0, "distances must be 0 or more and finite, got -1"),
        (math.nan, 0, "must be 0 or more and finite, got nan"),
        (math.inf, 0, "got inf"),
        (5, "fast", "speeds"),
        ((1, 2), 0, "one per entrance"),
        ([], 0, "empty list"),
        (True, 0, "must be 0 or more"),
    ],
)
def test_wrong_numbers_are_named(distances: object, speeds: object, says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        explicit(distances, speeds, 4)  # type: ignore[arg-type]


def test_unknown_configuration_and_empty_grid() -> None:
    with pytest.raises(ScenarioError, match="unknown configuration 'K'"):
        grid("DK", 4, JunctionControl.STOP)
    with pytest.raises(ScenarioError, match="at least one configuration"):
        grid((), 4, JunctionControl.STOP)


def test_probe_names_vehicle_speed_and_limit() -> None:
    (fast,) = explicit((20.0, 1.0, 20.0, 20.0), 4.0, 4)
    assert probe(fast, lambda distance: 2.0 * distance) == (
        "a deliberate probe: at 4 m/s nobody stops within 1 m, v(d)max is 2.00 m/s"
    )
    assert "drives off before looking" in probe(configuration("A", 4), lambda distance: 10.0)
    assert [probe(configuration(letter, 4), lambda distance: 10.0) for letter in "BCDE"] == [""] * 4

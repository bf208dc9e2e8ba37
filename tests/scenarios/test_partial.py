"""What full scenarios can't show: a driver that never looks straight across."""

from itertools import combinations

import pytest_rvads as rvads
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.studies.mutants.sight import BlindAhead


def test_a_driver_that_never_looks_across_passes_all_classes_and_fails_with_empty_arms() -> None:
    """In a full scenario somebody from the side is always between the two in the order of going."""
    place = rvads.find("stop4")
    points = grid("B", 4, place.control)

    def broken(cover: str, count: int) -> dict[str, bool]:
        """By scenario of so many vehicles in which p1 to p3 are not kept, whether it collides."""
        found = {}
        for scenario in Selection(place, points, cover=cover):
            if len(scenario.agents()) == count:
                run = rvads.simulate(rvads.Case(scenario, BlindAhead))
                if any(rvads.check(run, rule).status == "FAIL" for rule in ("p1", "p2", "p3")):
                    found[scenario.label] = bool(run.collisions)
        return found

    assert broken("class", 4) == {}
    alone = broken("partial", 2)
    assert set(alone) == {f"0{a}0{b}" for a, b in [*combinations("123", 2), *zip("123", "123", strict=True)]}, "two face to face"
    assert alone["0103"], "a right turn and the left turn opposite lead into the same exit"

"""No policy of the traffic goes by numbers: turned around or in a mirror, where traffic keeps left, it is judged alike."""

import pytest

from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.geometry.finder import find
from pytest_rvads.satellites.relations.metamorphic import compare
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import configuration
from pytest_rvads.scenarios.scenario import Scenario

from ..policies import EVERYWHERE

POINTS = {"light4": ("2332", "I", ("mirror",)), "stop4": ("1230", "E", ("rotation",))}


@pytest.mark.extended
@pytest.mark.parametrize("junction", POINTS)
@pytest.mark.parametrize("policy", sorted(set(EVERYWHERE) - {"lgsvl"}))
def test_a_policy_is_symmetric(policy: str, junction: str) -> None:
    """All but the paper's stack, which is documented to go by the order of creation."""
    code, letter, relations = POINTS[junction]
    point = configuration(letter, 4)
    start = Scenario(find(junction), code, distance=point.distances, speed=point.speeds, duration=30)
    found = compare(Case(start, traffic(policy)), ("paper", "road"), relations=relations)
    assert found.differences == ()
    assert len(found.compared) >= len(relations)
    assert found.triggered

"""Your own map: its file is named by the ini option ``rvads_map``, the variable RVADS_MAP, or ``--rvads-map``.

Without one, the junctions come from the built-in maps.
Junctions are asked for by their type, so that the same test runs on every map that has some, and at all of these::

    RVADS_MAP=town.xodr pytest examples/test_5_your_own_map.py

``@rvads.scenario("169", map="town.xodr")`` asks for one by its id; ``rvads map town.xodr`` lists what a file offers.
"""

import pytest_rvads as rvads


@rvads.scenario("4-way stop", classes=(2, 7), grid="CE", rules=("p1", "p3"))
def test_stop(run, rule, monitor):
    monitor.check(rule)


@rvads.scenario("4-way lights", classes=(8, 13), grid="GJ")
def test_lights(run, rule, monitor):
    monitor.check(rule)

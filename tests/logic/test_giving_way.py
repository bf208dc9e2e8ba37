"""Who gives way by signs, sides and priority, lane by lane: for each rule a drive that breaks it alone, and one that keeps it.

On stop4, whose signs are exchanged here, a0 comes from the south, a1 from the east, a2 from the north, a3 from the west: a1 comes
from the right of a0. Directions are 1 right, 2 straight, 3 left; the entrance vertex is 15 m from the middle.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Movement
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.lane import wrong_lanes
from pytest_rvads.logic.conduct.priority import owes
from pytest_rvads.logic.conduct.rights import Ground, comes_first, ground_of
from pytest_rvads.logic.conduct.standing import stopped
from pytest_rvads.logic.conduct.static_model import extract
from pytest_rvads.logic.conduct.waiting import due, may_go
from pytest_rvads.logic.judging.instances import prepare
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.logic.rules.book import get_rule, rules_for
from pytest_rvads.logic.rules.lexicon import BUILT_IN
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor
from pytest_rvads.satellites.relations.variants import mirrored

from ..run_builders import coarse

Make = Callable[..., Run]
N, S, Y, P, L = Sign.NONE, Sign.STOP, Sign.YIELD, Sign.PRIORITY, Sign.LIGHTS
STAND = (0, 0.0)


def signed(*signs: Sign, junction: Junction | None = None, **more: Any) -> Junction:
    """stop4, or another junction, with other signs."""
    junction = junction or rvads.find("stop4")
    phases = {entrance: 0 for entrance, sign in enumerate(signs) if sign is L}
    lanes = zip(junction.entrances, signs, strict=True)
    entrances = tuple(replace(lane, sign=sign, phase=phases.get(k)) for k, (lane, sign) in enumerate(lanes))
    return replace(junction, entrances=entrances, **more)


YIELD, RIGHT, MAJOR, MINOR_STOP = signed(P, Y, P, Y), signed(N, N, N, N), signed(N, P, N, P), signed(N, S, N, S)
STATED = signed(N, N, N, N, stated=frozenset({((1, 3), (0, 2))}))
"""The map gives the straight way from the south priority over that from the east, which would have it by the side."""


def lanes(*signs: Sign) -> Junction:
    """stop4 with another lane at the kerb of the south arm, entrance 0, for right turns alone; the old one is entrance 1."""
    old = rvads.find("stop4")
    approach, exit = old.way_in(0), old.way_out(1)
    kerb = Segment("kerb", approach.points + np.array([3.5, 0.0]))
    start, goal, corner = kerb.points[-1], exit.points[0], np.array([kerb.points[-1][0], exit.points[0][1]])
    along = np.linspace(0.0, 1.0, 41)[:, None]
    bend = (1 - along) ** 2 * start + 2 * along * (1 - along) * corner + along**2 * goal
    path = Segment("kerb right", bend, Turn.RIGHT, old.id)
    movements = {(e + 1, x): replace(m, entrance=e + 1) for (e, x), m in old.movements.items() if (e, x) != (0, 1)}
    movements[0, 1] = Movement(0, 1, Turn.RIGHT, path.length, path.id, path)
    numbers = {arm: [k for k, own in enumerate((0, 0, 1, 2, 3)) if own == arm] for arm in range(4)}

    def lifted(pairs: frozenset[tuple[int, int]]) -> frozenset[tuple[int, int]]:
        return frozenset((a, b) for one, two in pairs for a in numbers[one] for b in numbers[two])

    entrances = (
        Entrance(0, 0, signs[0], approach=kerb),
        replace(old.entrances[0], lane=1, sign=signs[0]),
        *(replace(lane, sign=sign) for lane, sign in zip(old.entrances[1:], signs[1:], strict=True)),
    )
    return Junction("lanes", "1", entrances, old.exits, movements, lifted(old.right_of), lifted(old.opposite))


def wait(direction: int, go: int) -> Any:
    """Stand 0.5 m before the line from the start and set off at tick `go`."""
    return direction, -0.5, [STAND, (go, 8.0)]


def comes(direction: int, after: float, place: Junction, one: tuple[int, int], other: tuple[int, int]) -> Any:
    """Come at 8 m/s onto the stretch that two ways share so long after who sets off on the other one at 1 s has left it [s]."""
    assert place.stretches is not None
    common = place.stretches[one, other]
    left = 1.0 + (0.5 + common.mine.end + 4.6) / 8.0
    return direction, common.yours.start - 8.0 * (left + after), [(0, 8.0)]


SOUTH, EAST, NORTH, LEFT = (0, 2), (1, 3), (2, 0), (0, 3)
PAIRS: dict[str, tuple[Junction, int, int, tuple[int, int], int, tuple[int, int]]] = {
    # rule, and what decides: the junction; who gives way, its direction and way; to whom, and its way
    "yield_sign": (YIELD, 1, 2, EAST, 0, SOUTH),
    "yield_sign at a stop sign": (MINOR_STOP, 1, 2, EAST, 0, SOUTH),
    "priority by a sign": (MAJOR, 0, 2, SOUTH, 1, EAST),
    "priority by the map": (STATED, 1, 2, EAST, 0, SOUTH),
    "right_before_left": (RIGHT, 0, 2, SOUTH, 1, EAST),
    "right_before_left at two yield signs": (signed(Y, Y, P, N), 0, 2, SOUTH, 1, EAST),
    "left_yields": (YIELD, 0, 3, LEFT, 2, NORTH),
    "left_yields without signs": (RIGHT, 0, 3, LEFT, 2, NORTH),
}


def statuses(run: Run) -> dict[str, str]:
    """Whatever is neither kept nor beside the point, rule by rule."""
    found = {rule.name: str(check(run, rule).status) for rule in rules_for("road", run.junction)}
    return {name: status for name, status in found.items() if status not in ("PASS", "NA")}


@pytest.mark.parametrize("name", PAIRS)
def test_whoever_takes_the_way_breaks_the_rule_alone(drive: Make, name: str) -> None:
    place, me, direction, mine, you, yours = PAIRS[name]
    rule = name.split()[0]
    for gap, status in ((0.9, {rule: "FAIL"}), (1.1, {})):
        run = drive(place, {me: wait(direction, 100), you: comes(2, gap, place, mine, yours)}, 900)
        assert statuses(run) == status, gap
        assert check(run, rule).status == ("FAIL" if status else "PASS"), "it was asked"
    broken = check(drive(place, {me: wait(direction, 100), you: comes(2, 0.9, place, mine, yours)}, 900), rule)
    assert broken.responsible == (f"a{me}",)


@pytest.mark.parametrize("name", PAIRS)
def test_vehicle_that_gives_way_keeps_the_rule(drive: Make, name: str) -> None:
    place, me, direction, _, you, _ = PAIRS[name]
    run = drive(place, {me: wait(direction, 700), you: (2, -15.0, [(0, 8.0)])}, 1500)
    assert statuses(run) == {}
    assert check(run, name.split()[0]).status == "PASS"
    assert not may_go(run, 0)[:200].any(), "it has reason to wait"


@pytest.mark.parametrize("name", PAIRS)
def test_vehicle_with_priority_owes_nothing(drive: Make, name: str) -> None:
    place, me, direction, _, you, _ = PAIRS[name]
    run = drive(place, {me: (direction, -20.0, [(0, 8.0)]), you: wait(2, 100)}, 900)
    assert not owes(run, 1, 0).any()


@pytest.mark.parametrize("name", PAIRS)
def test_each_pair_has_one_ground(name: str) -> None:
    place = PAIRS[name][0]
    assert place.yields is not None
    for one, other in place.yields:
        assert ground_of(place, one, other) is not None
        assert ground_of(place, other, one) is None


def test_a_sign_counts_before_a_side_and_the_map_before_a_sign() -> None:
    assert ground_of(YIELD, EAST, SOUTH) is Ground.SIGN
    assert ground_of(signed(N, Y, P, P), EAST, SOUTH) is Ground.SIGN
    assert ground_of(MAJOR, SOUTH, EAST) is Ground.PRIORITY
    assert ground_of(RIGHT, SOUTH, EAST) is Ground.SIDE
    assert ground_of(STATED, EAST, SOUTH) is Ground.PRIORITY
    over = replace(YIELD, stated=frozenset({(SOUTH, EAST)}))
    assert (ground_of(over, SOUTH, EAST), ground_of(over, EAST, SOUTH)) == (Ground.PRIORITY, None)
    assert ground_of(rvads.find("stop4"), SOUTH, EAST) is None, "at an all-way stop the order of arrival decides"
    assert ground_of(rvads.find("light4"), SOUTH, EAST) is None


def test_where_traffic_keeps_left_the_near_side_is_the_left(drive: Make) -> None:
    place = signed(N, N, N, N, junction=mirrored(rvads.find("stop4")))
    ways = [place.leads(entrance, 2).key for entrance in range(4)]
    pairs = {(one, other) for one in range(4) for other in range(4) if ground_of(place, ways[one], ways[other]) is Ground.SIDE}
    assert len(pairs) == 4
    assert pairs == {(one, other) for other, one in place.right_of}
    me, you = min(pairs)
    run = drive(place, {me: wait(2, 100), you: comes(2, 0.5, place, ways[me], ways[you])}, 900)
    verdict = check(run, "right_before_left")
    assert (verdict.status, verdict.responsible) == ("FAIL", (f"a{me}",))
    assert f"because   entrance {you} is on the left of entrance {me}" in verdict.explanation


@pytest.mark.parametrize(
    ("name", "because", "roles"),
    [
        ("yield_sign", "entrance 1 has a yield sign, entrance 0 a priority sign", "entrance +0 has a yield sign, entrance +3"),
        ("yield_sign at a stop sign", "entrance 1 has a stop sign, entrance 0 no sign", "entrance +0 has a stop sign"),
        ("priority by a sign", "entrance 0 has no sign, entrance 1 a priority sign", "entrance +0 has no sign, entrance +1"),
        ("priority by the map", "by the map the way from entrance 0 has priority over the one from entrance 1", "by the map"),
        ("right_before_left", "entrance 1 is on the right of entrance 0, and neither has priority", "entrance +1 is on the"),
        ("left_yields", "who comes from entrance 0 turns left across the way from entrance 2", "who comes from entrance +0"),
    ],
)
def test_the_explanation_says_why(drive: Make, name: str, because: str, roles: str) -> None:
    place, me, direction, mine, you, yours = PAIRS[name]
    verdict = check(drive(place, {me: wait(direction, 100), you: comes(2, 0.5, place, mine, yours)}, 900), name.split()[0])
    assert f"\nbecause   {because}" in verdict.explanation
    assert roles in verdict.roles
    assert verdict.message.endswith(f" s: a{me} gets in the way of a{you}")


@pytest.mark.parametrize("name", PAIRS)
def test_state_by_state_the_same_is_said(drive: Make, name: str) -> None:
    place, me, direction, mine, you, yours = PAIRS[name]
    run = coarse(drive(place, {me: wait(direction, 100), you: comes(2, 0.5, place, mine, yours)}, 480), 5)
    for rule in dict.fromkeys((name.split()[0], "yield_sign" if place is YIELD else "right_before_left")):
        monitor = RuleMonitor(rule, place, run.agents, dt=run.dt)
        motion = [{what: run.need(what)[k] for what in ("station", "speed", "pose")} for k in range(run.steps)]
        told = [monitor.step(run.zone[k], run.lights[k], **motion[k]) for k in range(run.steps)]
        time = check(run, rule).time
        assert told.count(Truth.FALSE) == (0 if time is None else run.steps - round(time / run.dt))


# Who is next at its line


def test_circle_of_four_standing_vehicles_has_no_due_vehicle(drive: Make) -> None:
    stands: dict[Any, Any] = {e: (2, -0.5, [STAND]) for e in range(4)}
    circle = drive(RIGHT, stands, 1200)
    three = drive(RIGHT, {e: stands[e] for e in (0, 1, 2)}, 1200)
    assert not any(due(circle, e, (e + 1) % 4)[0] for e in range(4))
    assert [due(three, 1, 2)[0], due(three, 0, 1)[0]] == [True, False], "a2 has nobody on its right, a1 has a2"
    assert np.flatnonzero(owes(three, 1, 2)).tolist() == list(range(300)), "until a2 has stood there, free to go, for 3 s"
    assert not owes(three, 0, 1).any()
    found = check(circle, "progress")
    assert (found.status, set(found.responsible)) == ("FAIL", {"a0", "a1", "a2", "a3"}), "somebody has to go"


def test_vehicle_facing_red_is_not_due_to_signed_traffic(drive: Make) -> None:
    place = signed(L, Y, L, Y)
    for colour, owed in ((Colour.GREEN, True), (Colour.YELLOW, True), (Colour.RED, False)):
        run = drive(place, {1: wait(2, 600), 0: (2, -15.0, [(0, 8.0)])}, 20, {0: [(0, colour)], 2: [(0, colour)]})
        assert owes(run, 0, 1).all() == owed, colour


def test_waiting_vehicle_is_not_impeded(drive: Make) -> None:
    # a2 brakes hard for its stop sign while a0 turns left before it; both have one, a1 and a3 have priority.
    place = signed(S, P, S, P)
    vehicles = {0: wait(3, 100), 2: (2, -24.0, [(0, 8.0), (200, 6.0), (220, 4.0), (240, 2.0), (260, 0.0), (560, 8.0)])}
    run = drive(place, vehicles, 1100)
    assert check(run, "left_yields").status == "PASS"
    through = drive(place, {0: wait(3, 100), 2: comes(2, 0.5, place, LEFT, NORTH)}, 900)
    assert statuses(through) == {"left_yields": "FAIL", "full_stop": "FAIL"}


# Signs and lights at some entrances


def test_a_stop_sign_of_the_minor_road_asks_for_a_stop_and_for_giving_way(drive: Make) -> None:
    run = drive(MINOR_STOP, {1: (2, -10.0, [(0, 5.0)]), 0: (2, -10.0, [(0, 5.0)])}, 900)
    assert check(run, "full_stop").responsible == ("a1",)
    assert [j.status for j in check(run, "full_stop").instances] == ["FAIL"], "a0 has no sign"
    alone = drive(MINOR_STOP, {0: (2, -10.0, [(0, 5.0)])}, 900)
    assert check(alone, "full_stop").status == "NA"


def test_red_applies_at_entrances_with_a_light(drive: Make) -> None:
    place = signed(L, N, L, N)
    run = drive(place, {0: wait(2, 100), 1: wait(2, 600)}, 900, {0: [(0, Colour.RED)], 2: [(0, Colour.RED)]})
    assert statuses(run) == {"red": "FAIL"}
    assert check(run, "red").responsible == ("a0",)
    assert extract(run).lights == (0, 2)


def test_who_ran_the_stop_sign_of_a_minor_road_is_to_blame(drive: Make) -> None:
    run = drive(MINOR_STOP, {1: (2, -25.0, [(0, 8.0)]), 0: (2, -25.0, [(0, 8.0)])}, 900, collisions=[(480, "a0", "a1")])
    assert check(run, "no_collision").responsible == ("a1",)
    yields = drive(YIELD, {1: (2, -25.0, [(0, 8.0)]), 0: (2, -25.0, [(0, 8.0)])}, 900, collisions=[(480, "a0", "a1")])
    assert check(yields, "no_collision").responsible == ("a1",)


@pytest.mark.parametrize("rule", ["yield_sign", "right_before_left", "priority"])
def test_sign_rules_do_not_apply_at_all_way_stops_and_lights(drive: Make, rule: str) -> None:
    for name in ("stop4", "light4"):
        verdict = check(drive(name, {0: wait(2, 100), 1: wait(2, 900)}, 10), rule)
        assert verdict.status == "NA"
        assert "about junctions with" in verdict.reason
        assert rule not in [r.name for r in rules_for("road", rvads.find(name))]


def test_without_geometry_nothing_is_guessed(drive: Make, topology: Callable[[Junction], Junction]) -> None:
    run = drive(YIELD, {0: wait(2, 100), 1: wait(2, 900)}, 10)
    verdict = check(replace(run, junction=topology(YIELD)), "yield_sign")
    assert (verdict.status, verdict.reason) == ("NA", "not recorded: the run holds no geometry of its junction")


# Several lanes, and queues


def test_lanes_of_an_arm_owe_each_other_nothing(drive: Make) -> None:
    place = lanes(S, S, S, S)
    # The one at the kerb came first and stays; the one beside it goes, and so does a1, which it has to wait for.
    run = drive(place, {0: wait(1, 800), 1: (2, -2.5, [(0, 1.0), (200, 0.0), (400, 8.0)])}, 1500)
    assert check(run, "first_come").status == "NA"
    assert not comes_first(run, 1, 0).any()
    run = drive(place, {0: wait(1, 800), 4: (2, -2.5, [(0, 1.0), (200, 0.0), (250, 8.0)])}, 1500)
    assert check(run, "first_come").responsible == ("a3",), "it goes where a0 turns to"
    static, entrances = extract(run), [f.Element(Sort.ENTRANCE, k, "") for k in range(len(place.entrances))]
    neighbours = product(entrances, repeat=2)
    assert [(a.index, b.index) for a, b in neighbours if BUILT_IN["beside"].decide(static, a, b)] == [(0, 1), (1, 0)]


def test_first_come_applies_to_conflicting_lanes_only(drive: Make) -> None:
    """From the kerb lane in the south to the east nobody meets who goes straight on from the east, but who does from the west."""
    late, at_once = (2, -2.5, [(0, 1.0), (200, 0.0), (250, 8.0)]), (2, -0.5, [(0, 0.0), (250, 8.0)])
    place = lanes(S, S, S, S)
    for rule, way in (("first_come", late), ("right_first", at_once)):
        meets, misses = (drive(place, {0: wait(1, 800), entrance: way}, 1500) for entrance in (4, 2))
        assert [check(run, rule).status for run in (meets, misses)] == ["FAIL", "NA"], rule
        assert not comes_first(misses, 1, 0).any()
    # The same holds with one lane on each arm: vehicles that go straight on from opposite arms never meet.
    misses = drive(signed(S, S, S, S), {0: wait(2, 800), 2: late}, 1500)
    assert check(misses, "first_come").status == "NA"
    assert not comes_first(misses, 1, 0).any()


@pytest.mark.parametrize("signs", [(S, S, S, S), (P, Y, P, Y)])
def test_who_is_gone_down_a_short_exit_road_is_in_nobodys_way(drive: Make, signs: Sequence[Sign]) -> None:
    """Where an exit road ends after 4 m, the rear of a car of 4.6 m is still on the movement when it is gone."""
    place = signed(*signs)
    # a1 turns right into the exit road that a0 goes straight on to.
    way = place.leads(1, 1)
    ticks = round((way.length + 4.0 + 0.5) / 8.0 * 100)
    run = drive(place, {1: (1, -0.5, [(0, 8.0), (ticks, 0.0)]), 0: (2, -6.0, [(0, 8.0)])}, 700)
    assert run.need("station")[-1, 0] - 4.6 < way.length
    zone = run.zone.copy()
    zone[ticks:, 0] = Zone.GONE
    stays, gone = run, replace(run, zone=zone)
    assert [check(one, "no_conflict").status for one in (stays, gone)] == ["FAIL", "PASS"]


def test_turn_from_a_lane_without_that_movement_is_a_violation(drive: Make) -> None:
    place = lanes(P, Y, P, Y)
    assert [wrong_lanes(place, *key) for key in ((0, 1), (1, 2), (1, 3), (2, 3))] == [(1,), (0,), (0,), ()]
    # In the lane at the kerb, and straight on: 3.5 m to the right of its own. Nobody knows how large it is.
    for beside, status in ((-3.5, "FAIL"), (-1.7, "PASS"), (-1.8, "FAIL"), (2.0, "PASS")):
        run = drive(place, {1: (2, -10.0, [(0, 5.0)], beside)}, 400, size=None)
        assert statuses(run) == ({"on_lane_allowed": "FAIL"} if status == "FAIL" else {}), beside
        assert check(run, "on_lane_allowed").status == status
    verdict = check(drive(place, {1: (2, -10.0, [(0, 5.0)], -3.5)}, 400), "on_lane_allowed")
    # The entrance zone begins 1 m before the vertex: 9 m at 5 m/s.
    assert (
        verdict.message
        == "on_lane_allowed at t=1.80 s: a0.1 is at entrance 1, a0.1 is in a lane that does not lead where it goes"
    )
    turns = drive(place, {0: (1, -10.0, [(0, 5.0)]), 2: (2, -80.0, [(0, 5.0)])}, 400)
    assert check(turns, "on_lane_allowed").status == "PASS"


def test_lane_rule_does_not_apply_to_single_lanes(drive: Make, topology: Callable[[Junction], Junction]) -> None:
    place = lanes(P, Y, P, Y)
    alone = drive(place, {2: (2, -10.0, [(0, 5.0)])}, 400)
    assert check(alone, "on_lane_allowed").status == "NA", "its arm has one lane"
    one = check(drive("stop4", {0: wait(2, 100)}, 10), "on_lane_allowed")
    assert one.reason == "on_lane_allowed is about junctions with several lanes on an arm, and this junction has one lane on each"
    assert "on_lane_allowed" not in [r.name for r in rules_for("road", rvads.find("stop4"))]
    bare = replace(drive(place, {1: (2, -10.0, [(0, 5.0)])}, 10), junction=topology(place))
    assert check(bare, "on_lane_allowed").reason == "not recorded: the run holds no geometry of its junction"
    with pytest.raises(rvads.errors.RunError, match=r"is about junctions with .* and several lanes on an arm, and this"):
        RuleMonitor("on_lane_allowed", rvads.find("stop4"), alone.agents[:0])


def test_who_queues_at_a_stop_sign_stops_again_at_the_line(drive: Make) -> None:
    place = signed(S, S, S, S)
    near = replace(place, entrances=(replace(place.entrances[0], sign_setback=3.0), *place.entrances[1:]))
    first = (2, -0.4, [STAND, (300, 8.0)])
    behind: Sequence[Any] = (2, -6.5, [(0, 0.5), (20, 0.0), (400, 5.0)])
    run = drive(near, {0: first, (0, 1): behind}, 900)
    assert [agent.name for agent in run.agents] == ["a0", "a0+1"]
    # It stood 6.4 m before the vertex, 3.4 m before the sign, from the start: first in its lane only from 3.05 s on.
    assert np.flatnonzero(stopped(run, 1))[0] == 306
    moving = (2, -6.5, [(0, 0.5), (20, 0.0), (250, 1.0)])
    rolls = drive(near, {0: first, (0, 1): moving}, 1100)
    assert not stopped(rolls, 1).any()
    assert check(rolls, "full_stop").responsible == ("a0+1",)


@pytest.mark.parametrize(
    ("sign", "stands", "counts"), [(None, -5.1, False), (None, -4.9, True), (3.0, -7.9, True), (3.0, -8.1, False)]
)
def test_a_full_stop_counts_from_five_metres_before_the_sign(
    drive: Make, sign: float | None, stands: float, counts: bool
) -> None:
    place = rvads.find("stop4")
    place = replace(place, entrances=(replace(place.entrances[0], sign_setback=sign), *place.entrances[1:]))
    run = drive(place, {0: (2, stands - 5.0, [(0, 5.0), (100, 0.0), (150, 5.0)])}, 700)
    assert check(run, "full_stop").status == ("PASS" if counts else "FAIL")


def test_standing_before_the_entrance_zone_from_the_start_is_no_full_stop(drive: Make) -> None:
    for start, status in ((-3.0, "FAIL"), (-0.9, "PASS")):
        assert check(drive("stop4", {0: (2, start, [STAND, (100, 5.0)])}, 700), "full_stop").status == status


def test_a_queue_behind_who_gives_way_is_not_idle(drive: Make) -> None:
    coming = {(0, k): (2, -20.0 - 30.0 * k, [(0, 8.0)]) for k in range(4)}
    run = drive(YIELD, {1: (2, -0.5, [STAND, (2000, 8.0)]), (1, 1): (2, -6.5, [STAND, (2100, 8.0)]), **coming}, 2600)
    assert not may_go(run, 1)[:1500].any(), "behind a1, which lets four pass"
    assert statuses(run) == {}


def test_vehicle_braking_for_its_leader_is_not_impeded(drive: Make) -> None:
    place = YIELD
    # a0+1 brakes hard because a0 does, which turns right well before the way of a1 and is in nobody's way.
    slow = [(0, 8.0), (240, 3.0)]
    ahead, behind = (1, -20.0, slow), (2, -30.0, slow)
    alone = drive(place, {1: wait(2, 200), (0, 1): behind}, 1500)
    both = drive(place, {1: wait(2, 200), 0: ahead, (0, 1): behind}, 1500)
    assert check(alone, "yield_sign").status == "FAIL"
    assert check(both, "yield_sign").status == "PASS"


def test_vehicles_that_never_meet_make_no_instances(drive: Make) -> None:
    vehicles: dict[Any, Any] = {(e, k): (1, -10.0 - 7 * k, [STAND]) for e in range(4) for k in range(6)}
    run = drive(RIGHT, vehicles, 1)
    static = extract(run)
    assert static.owing == frozenset(), "24 right turns"
    for name in ("right_before_left", "left_yields", "yield_sign", "priority"):
        assert prepare(get_rule(name).formula, static, ("a",)).templates == ()

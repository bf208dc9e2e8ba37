"""Lanes that come together: what a map shows of who joins whom, who then gives way, and where nobody can say.

A road leads from west to east; a ramp from the south-west joins it at an angle. The entrance vertices are at x = 0, the exit is
40 m on.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.precedence import Precedence, Reason
from pytest_rvads.geometry.segment import Pose, Segment
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Movement
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.priority import owes
from pytest_rvads.logic.conduct.rights import Ground, ground_of
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run, save_run

Make = Callable[..., Run]
ROAD, RAMP = (0, 0), (1, 0)
"""The movements from the road and from the ramp. Arm 0 leads out, the road is arm 1 with a1, the ramp arm 2 with a2."""
AWAY = 40.0


def bend(angle: float, south: float) -> tuple[str, float]:
    """Return a cubic from (0, -south), at `angle`, to the exit, and its length."""
    (u, v), tangent = (AWAY * math.cos(angle) + south * math.sin(angle), south * math.cos(angle) - AWAY * math.sin(angle)), AWAY
    ends = (tangent * math.cos(angle), -tangent * math.sin(angle))
    c, d = (3 * u - 2 * tangent - ends[0], 3 * v - ends[1]), (tangent + ends[0] - 2 * u, ends[1] - 2 * v)
    steps = [(tangent * t + c[0] * t**2 + d[0] * t**3, c[1] * t**2 + d[1] * t**3) for t in (k / 2000 for k in range(2001))]
    length = math.fsum(math.dist(one, two) for one, two in pairwise(steps))
    return f'<paramPoly3 aU="0" bU="{tangent}" cU="{c[0]}" dU="{d[0]}" aV="0" bV="0" cV="{c[1]}" dV="{d[1]}"/>', length


def road(
    id: int, start: Pose, shape: str, length: float, links: str, lane: str = "driving", type: str = "town", taper: float = 0
) -> str:
    inside = f'junction="{1 if id > 9 else -1}"'
    ids = '<link><predecessor id="-1"/><successor id="-1"/></link>' if id > 9 else ""
    return (
        f'<road id="{id}" length="{length}" {inside}><link>{links}</link><type s="0" type="{type}"/><planView>'
        f'<geometry s="0" x="{start.x}" y="{start.y}" hdg="{start.heading}" length="{length}">{shape}</geometry></planView>'
        f'<lanes><laneOffset s="0" a="0" b="{-taper / length / 2}" c="0" d="0"/><laneSection s="0">'
        f'<center><lane id="0" type="none"/></center><right><lane id="-1" type="{lane}">{ids}'
        f'<width sOffset="0" a="3.5" b="{-taper / length}" c="0" d="0"/></lane></right></laneSection></lanes></road>'
    )


def merge(
    degrees: float = 30.0, ramp: str = "driving", motorways: tuple[int, ...] = (), taper: float = 0.0, sign: str = ""
) -> str:
    """Return a map: the lane type of the ramp, which roads are motorways, by how much the lane of the ramp gets narrower."""
    angle, far = math.radians(degrees), 120.0
    type = {id: "motorway" if id in motorways else "town" for id in (1, 2, 3)}
    start, south = Pose(-far * math.cos(angle), -8.0 - far * math.sin(angle), angle), 8.0
    to_junction = '<successor elementType="junction" elementId="1"/>'
    shape, length = bend(angle, south)

    def through(id: int) -> str:
        ends = (("predecessor", id, "end"), ("successor", 3, "start"))
        return "".join(f'<{end} elementType="road" elementId="{road}" contactPoint="{at}"/>' for end, road, at in ends)

    roads = [
        road(1, Pose(-far, 0.0, 0.0), "<line/>", far, to_junction, type=type[1]),
        road(2, start, "<line/>", far, to_junction, ramp, type[2]).replace("</road>", f"<signals>{sign}</signals></road>"),
        road(3, Pose(AWAY, 0.0, 0.0), "<line/>", far, '<predecessor elementType="junction" elementId="1"/>', type=type[3]),
        road(10, Pose(0.0, 0.0, 0.0), "<line/>", AWAY, through(1)),
        road(11, Pose(0.0, -south, angle), shape, length, through(2), taper=taper),
    ]
    rows = "".join(
        f'<connection id="{id}" incomingRoad="{one}" connectingRoad="{id}" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection>'
        for one, id in ((1, 10), (2, 11))
    )
    return f'<OpenDRIVE><header revMajor="1" revMinor="6"/>{"".join(roads)}<junction id="1">{rows}</junction></OpenDRIVE>'


@pytest.fixture
def at(tmp_path: Path) -> Callable[..., Junction]:
    """Read a merge."""

    def at(**asked: object) -> Junction:
        path = tmp_path / f"m{len(list(tmp_path.iterdir()))}.xodr"
        path.write_text(merge(**asked))  # type: ignore[arg-type]
        return rvads.find("1", path)

    return at


At = Callable[..., Junction]
SHOWN: dict[str, dict[str, object]] = {
    **{type: {"ramp": type} for type in ("entry", "exit", "onRamp", "offRamp", "connectingRamp", "mwyEntry")},
    "onto a motorway": {"motorways": (1, 3)},
    "a motorway ramp": {"ramp": "onRamp", "motorways": (1, 2, 3)},
    "a lane that ends": {"taper": 3.0},
    "at 70 degrees": {"ramp": "onRamp", "degrees": 70.0},
}


@pytest.mark.parametrize("name", SHOWN)
def test_a_lane_that_joins_gives_way(at: At, name: str) -> None:
    place = at(**SHOWN[name])
    assert place.yields == {(RAMP, ROAD): Reason.MERGE}
    assert place.joining == {(RAMP, ROAD)}
    assert (ground_of(place, RAMP, ROAD), ground_of(place, ROAD, RAMP)) == (Ground.MERGE, None)
    assert "merge" in [rule.name for rule in rules_for("road", place)]


@pytest.mark.parametrize(
    ("asked", "yields"),
    [
        ({}, {(ROAD, RAMP): Reason.UNDECIDED, (RAMP, ROAD): Reason.UNDECIDED}),
        ({"degrees": 49.0}, {(ROAD, RAMP): Reason.UNDECIDED, (RAMP, ROAD): Reason.UNDECIDED}),
        ({"degrees": 51.0}, {(ROAD, RAMP): Reason.RIGHT}),
        ({"motorways": (1, 2, 3)}, {(ROAD, RAMP): Reason.UNDECIDED, (RAMP, ROAD): Reason.UNDECIDED}),
        ({"taper": 2.0}, {(ROAD, RAMP): Reason.UNDECIDED, (RAMP, ROAD): Reason.UNDECIDED}),
    ],
    ids=["a flat angle", "49 degrees", "51 degrees", "motorways alone", "a lane that stays 1.5 m wide"],
)
def test_without_a_lane_that_joins_the_angle_decides(at: At, asked: dict[str, object], yields: object) -> None:
    place = at(**asked)
    assert place.yields == yields
    assert not place.joining
    assert "merge" not in [rule.name for rule in rules_for("road", place)]


def test_a_sign_counts_before_a_lane_that_joins(at: At) -> None:
    sign = '<signal id="9" s="118" t="-5" orientation="+" dynamic="no" type="205" country="DE" subtype="-1"/>'
    assert at(ramp="onRamp", sign=sign).yields == {(RAMP, ROAD): Reason.SIGN}


@pytest.mark.parametrize("turned", [-60.0, 60.0])
@pytest.mark.parametrize("left_hand", [False, True])
def test_side_of_a_merge_follows_from_the_position(turned: float, left_hand: bool) -> None:
    """Both drive north, the second 20 m to the left of the first, turned: its direction says nothing of where it is."""
    north = math.pi / 2
    starts = [(20.0, north), (0.0, north + math.radians(turned))]
    lines = [np.array([(x, 0.0), (x + math.cos(heading), math.sin(heading))]) for x, heading in starts]
    ways = {(k, 0): Movement(k, 0, Turn.STRAIGHT, 1.0, "", Segment("", line)) for k, line in enumerate(lines)}
    relation = Precedence([Entrance(0), Entrance(1)], ways, (), (), (), (), left_hand, all_way_stop=False)
    reasons = [relation.why((0, 0), (1, 0)), relation.why((1, 0), (0, 0))]
    assert reasons == ([Reason.RIGHT, None] if left_hand else [None, Reason.RIGHT])


def statuses(run: Run) -> dict[str, str]:
    """Whatever is neither kept nor beside the point, rule by rule."""
    found = {rule.name: str(check(run, rule).status) for rule in rules_for("road", run.junction)}
    return {name: status for name, status in found.items() if status not in ("PASS", "NA")}


def together(drive: Make, place: Junction, ahead: float) -> Run:
    """Both drive at 8 m/s; the rear of the vehicle from the ramp is `ahead` of the front of the other one, to the exit [m]."""
    longer = place.movements[ROAD].length - place.movements[RAMP].length
    ways = (place.directions(0)[0], place.directions(1)[0])
    return drive(place, {0: (ways[0], longer - 20.0 - 4.6 - ahead, [(0, 8.0)]), 1: (ways[1], -20.0, [(0, 8.0)])}, 1100)


def test_who_joins_too_near_ahead_breaks_the_rule_alone(drive: Make, at: At) -> None:
    """A second is 8 m; the road's vehicle need not brake, so that the gap alone decides."""
    place = at(ramp="onRamp")
    run = together(drive, place, 7.0)
    assert statuses(run) == {"merge": "FAIL"}
    verdict = check(run, "merge")
    assert verdict.responsible == ("a2",)
    assert "\nbecause   by the map the lane from entrance 1 joins the one from entrance 0" in verdict.explanation
    assert verdict.message.endswith(" s: a2 gets in the way of a1")
    run = together(drive, place, 9.0)
    assert (statuses(run), check(run, "merge").status) == ({}, "PASS")


def test_who_joins_behind_keeps_the_rule(drive: Make, at: At) -> None:
    run = together(drive, at(ramp="onRamp"), -20.0)
    assert (statuses(run), check(run, "merge").status) == ({}, "PASS")
    assert not owes(run, 0, 1).any()


@pytest.mark.parametrize("ahead", [-11.0, 2.0])
def test_merge_without_a_known_order_is_na(drive: Make, at: At, ahead: float) -> None:
    """The vehicles follow each other closely, the one or the other first."""
    run = together(drive, at(), ahead)
    assert statuses(run) == {}
    assert check(run, "merge").status == check(run, "right_before_left").status == "NA"
    assert not owes(run, 0, 1).any()
    assert not owes(run, 1, 0).any()


def test_run_file_keeps_the_merge_relation(drive: Make, at: At, tmp_path: Path) -> None:
    run = together(drive, at(ramp="onRamp"), 7.0)
    save_run(run, tmp_path / "run.npz")
    back = load_run(tmp_path / "run.npz")
    assert (back.hash, back.junction.joining) == (run.hash, {(RAMP, ROAD)})
    assert check(back, "merge") == check(run, "merge")
    assert at().digest != run.junction.digest


@pytest.mark.extended
@pytest.mark.parametrize("ramp", ["driving", "onRamp"])
@pytest.mark.parametrize("ahead", [-10.0, 0.0, 10.0])
def test_the_reference_lets_in_and_is_let_in(at: At, ramp: str, ahead: float) -> None:
    """Both come at once, or one after the other."""
    place = at(ramp=ramp)
    scenario = rvads.Scenario(place, (place.directions(0)[0], place.directions(1)[0]), distance=(30.0, 30.0 + ahead), speed=8.0)
    run = rvads.simulate(rvads.Case(scenario, rvads.Reference))
    assert statuses(run) == {}
    assert (run.provenance["end"], run.collisions) == ("left", ())

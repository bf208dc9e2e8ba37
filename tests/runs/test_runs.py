"""Files of runs, their integrity, their key performance indicators."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Movement
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.bodies import contacts
from pytest_rvads.logic.conduct.kpis import describe, kpis
from pytest_rvads.logic.conduct.validate import validate
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import Collision, Excerpt, Facts, Fault, Run
from pytest_rvads.runs.runfile import RUN, load_run, save_run
from pytest_rvads.runs.states import Agent, Colour, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RunError

ELSEWHERE = Movement(0, 7, Turn.LEFT, 10.0, "m")


@pytest.fixture(scope="module")
def real() -> Run:
    return simulate(Case(Scenario(find("light4"), "1230", distance=5.0), Reference))


def moving(vehicles: dict[tuple[int, int], tuple[float, list[float]]], **changes: Any) -> Run:
    """A run on stop4 along the centre lines: per (entrance, exit) the station at the start [m] and the speed in each state."""
    place = find("stop4")
    columns, agents = [], []
    for (entrance, leaving), (start, speeds) in vehicles.items():
        itinerary = Itinerary.through(place, entrance, leaving)
        speed = np.array(speeds)
        station = start + np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2))) * 0.01
        pose = np.array([itinerary.pose(float(s)) for s in station])
        zone = np.array([itinerary.zone(float(s)) for s in station], dtype=np.int8)
        agents.append(Agent(f"a{entrance}", place.movements[entrance, leaving], size=(4.6, 1.86)))
        columns.append((zone, station, speed, pose))
    zone, station, speed, pose = (np.stack([c[k] for c in columns], axis=1) for k in range(4))
    lights = np.zeros((len(zone), 4), dtype=np.int8)
    facts = Facts(speed_limit=11.176)
    run = Run("moving", place, tuple(agents), zone, lights, station=station, speed=speed, pose=pose, facts=facts)
    return replace(run, **changes)


# Files


def test_a_kept_run_comes_back_bit_by_bit(real: Run, tmp_path: Path) -> None:
    run = replace(real, collisions=(Collision(1.5, ("a0", "a1"), 3.25),), fault=Fault(2.0, "a1", "autopilot raised"))
    path = tmp_path / "deep" / "run.npz"
    save_run(run, path)
    back = load_run(path)
    assert back.hash == run.hash
    assert (back.collisions, back.fault, back.provenance["autopilot"]) == (run.collisions, run.fault, run.provenance["autopilot"])
    one, two = run.junction, back.junction
    assert (one.name, one.id, one.control, one.right_of, one.opposite, one.phase_groups, one.setbacks, one.left_hand) == (
        *(two.name, two.id, two.control, two.right_of, two.opposite, two.phase_groups, two.setbacks, two.left_hand),
    )
    assert dict(one.movements) == dict(two.movements)
    assert validate(back) == validate(run) == ()
    first = path.read_bytes()
    save_run(back, path)
    assert path.read_bytes() == first, "equal runs give equal files"


def test_where_signs_stand_and_what_the_map_states_is_kept(real: Run, tmp_path: Path) -> None:
    lanes = real.junction.entrances
    first = replace(lanes[0], sign_setback=2.5)
    pair = ((0, 2), (1, 3))
    run = replace(real, junction=replace(real.junction, entrances=(first, *lanes[1:]), stated=frozenset({pair})))
    save_run(run, tmp_path / "run.npz")
    back = load_run(tmp_path / "run.npz")
    assert (back.hash, back.junction.stated) == (run.hash, {pair})
    assert [lane.sign_setback for lane in back.junction.entrances] == [2.5, None, None, None]
    assert run.hash != real.hash
    save_run(real, tmp_path / "plain.npz")
    header = json.loads(bytes(np.load(tmp_path / "plain.npz")["header"]))
    assert "stated" not in header["junction"]
    assert not any("sign_setback" in lane for lane in header["junction"]["entrances"])


def test_a_kept_run_gets_the_same_verdicts(real: Run, tmp_path: Path) -> None:
    save_run(real, tmp_path / "run.npz")
    back = load_run(tmp_path / "run.npz")
    for name in ("p4", "p5", "p6", "red", "no_conflict", "speed_limit"):
        assert check(back, name).record() == check(real, name).record()
        assert check(back, name).explanation == check(real, name).explanation


def test_run_file_keeps_missing_quantities_missing(tmp_path: Path, topology: Callable[[Junction], Junction]) -> None:
    place = topology(find("stop4"))
    run = Run("bare", place, (Agent("c0", place.movements[0, 1]),), np.zeros((3, 1), np.int8), np.zeros((3, 4), np.int8))
    save_run(run, tmp_path / "run.npz")
    back = load_run(tmp_path / "run.npz")
    assert (back.station, back.speed, back.pose, back.controls, back.junction.drivable) == (*(None,) * 4, False)
    assert back.hash == run.hash


def rewrite(path: Path, change: Callable[[dict[str, Any], dict[str, Any]], None]) -> None:
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(bytes(arrays["header"]).decode())
    change(header, arrays)
    if "header" in arrays:
        arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    with path.open("wb") as out:
        np.savez(out, **arrays)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h, a: h.update(format="other"), "its format is 'other'"),
        (lambda h, a: h.update(version=RUN.version + 1), f"this library reads version {RUN.version}"),
        (lambda h, a: h.pop("label"), "header: the field 'label' is missing"),
        (lambda h, a: a.pop("zone"), "'zone' is missing"),
        (lambda h, a: a.pop("header"), "it has no header"),
        (lambda h, a: h.update(provenance=[]), r"the field 'provenance' must be an object, got \[\]"),
        (
            lambda h, a: h["facts"].update(speed_limit="fast"),
            r"the field 'facts.speed_limit' must be a number or null, got 'fast'",
        ),
        (lambda h, a: h["facts"].update(speed_limit=0), r"the field 'facts.speed_limit' must be a number > 0.0, got 0"),
        (
            lambda h, a: h["agents"][0]["size"].__setitem__(1, -1),
            r"the field 'agents\[0\].size\[1\]' must be a number > 0.0, got -1",
        ),
        (lambda h, a: h["facts"].update(subject="a7"), "subject in facts must be one of the vehicles, got 'a7'"),
        (lambda h, a: h.pop("facts"), "the field 'facts' is missing"),
        (lambda h, a: h["agents"][0].pop("kind"), r"the field 'agents\[0\].kind' is missing"),
        (lambda h, a: h["agents"][0].update(kind="tank"), r"the field 'agents\[0\].kind' must be 'car' or .*, got 'tank'"),
        (lambda h, a: h["agents"][0].update(route=[0, 0]), "a0 goes from entrance 0 to exit 0, where no way leads"),
        (
            lambda h, a: h["agents"][0]["route"].__setitem__(1, "0"),
            r"the field 'agents\[0\].route\[1\]' must be a whole number, got '0'",
        ),
        (
            lambda h, a: h["junction"]["entrances"].pop(),
            r"damaged: lights must be whole numbers in the shape \(\d+, 3\), got int8 in \(\d+, 4\)",
        ),
        (
            lambda h, a: h["junction"]["exits"].pop(),
            "damaged: junction 'light4' has 4 entrances and 3 exits, and no room for",
        ),
        (lambda h, a: a.pop("line_0"), "damaged: 'line_0' is missing"),
        (lambda h, a: a.update(zone=np.int8(1)), r"damaged: zone must be whole numbers in the shape \(0, 3\), got int8 in \(\)"),
        (lambda h, a: a.update(speed=a["zone"]), r"damaged: speed must be numbers in the shape \(\d+, 3\), got int8 in"),
        (lambda h, a: h["agents"][0].update(name=""), r"'agents\[0\].name' must be a text of length >= 1, got ''"),
        (lambda h, a: h["agents"][0].update(name="a" * 1001), r"'agents\[0\].name' must be a text of length <= 1000"),
        (lambda h, a: h["agents"][0].update(name="a1"), "the names of vehicles must differ, got"),
        (lambda h, a: h.update(label="\x1b[2J"), "'label' must be a text without control characters, got"),
        (lambda h, a: h.update(label="\ud800"), "header: not JSON: .* surrogates not allowed"),
        (lambda h, a: h.update(dt=5e-324), "'dt' must be a number >= 1e-06"),
        (lambda h, a: h["provenance"].update(x=float("nan")), "header: not JSON"),
        (lambda h, a: h["provenance"].update(x="x" * 2**20), "its header takes 1,0.* bytes, expected at most 1,048,576"),
        (lambda h, a: h.update(collisions=[{"time": 1e300, "agents": ["a0", "a1"], "speed": 1}]), "damaged: a collision must"),
        (lambda h, a: h.update(collisions=[{"time": 1, "agents": ["a0", "a9"], "speed": 1}]), "within the run, got Collision"),
        (lambda h, a: a.update(station=a["station"] * 1e300), r"damaged: station holds numbers beyond 1e\+09"),
        (lambda h, a: a.update(line_0=a["line_0"] * np.nan), "damaged: segment .* has coordinates that are not finite"),
        (lambda h, a: a.update(line_0=a["line_0"] * 1e300), "damaged: its centre lines have more than 100,000 points, or"),
        (
            lambda h, a: a.update(line_0=a["line_0"] + 50.0),
            "damaged: junction 'light4': the lanes from entrance 0 to exit . do not meet",
        ),
        (lambda h, a: a.update(line_0=np.ones((100_001, 2))), "its centre lines have more than 100,000 points"),
        (
            lambda h, a: a.update({name: a[name] * 1e3 for name in a if name.startswith("line")}),
            "damaged: its movements and crosswalks are .* m long together, expected at most 10,000 m",
        ),
        (
            lambda h, a: a.update(zone=np.zeros((10**7, 3), np.int8)),
            "10,000,000 ticks of so many vehicles and entrances are 490,000,000 pairs of them, at most 320,000,000 are read",
        ),
        (
            lambda h, a: h["junction"].update(stated=[[[0, 2], [0, 0]]]),
            r"damaged: its junction states a priority of the movement \(0, 0\), which it does not have",
        ),
        (lambda h, a: h["junction"].update(stated=[[0, 2]]), r"'junction.stated\[0\]\[0\]' must be a list"),
        (
            lambda h, a: h["junction"]["entrances"][0].update(sign_setback=-1.0),
            r"'junction.entrances\[0\].sign_setback' must be a number >= 0",
        ),
        (
            lambda h, a: h["junction"]["exits"][0].update(arm=7),
            "damaged: junction 'light4' needs two or more arms, numbered from 0",
        ),
    ],
)
def test_a_damaged_file_says_what_is_wrong(
    real: Run, tmp_path: Path, change: Callable[[dict[str, Any], dict[str, Any]], None], message: str
) -> None:
    path = tmp_path / "run.npz"
    save_run(real, path)
    rewrite(path, change)
    with pytest.raises(RunError, match=message):
        load_run(path)


def test_invalid_run_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with pytest.raises(RunError, match="can't be read"):
        load_run(path)
    for content in (b"", b"no archive", b"PK\x03\x04 cut"):
        path.write_bytes(content)
        with pytest.raises(RunError, match=r"run\.npz: "):
            load_run(path)
    with pytest.raises(RunError, match=r"can't be kept: it takes [0-9,]+ bytes"):
        save_run(moving({(0, 2): (-5.0, [1.0] * 5)}, provenance={"what": "x" * 2**20}), path)
    with pytest.raises(RunError, match="can't be kept: the field 'label' must be a text of length >= 1"):
        save_run(moving({(0, 2): (-5.0, [1.0] * 5)}, label=""), path)
    with pytest.raises(RunError, match="can't be kept"):
        save_run(moving({(0, 2): (-5.0, [1.0] * 5)}, provenance={"what": object()}), path)


# Integrity


def straight(**changes: Any) -> Run:
    return moving({(0, 2): (-5.0, [8.0] * 400)}, **changes)


def test_an_intact_run_has_no_findings(real: Run) -> None:
    assert validate(real) == ()
    assert validate(straight()) == ()


def changed(name: str, index: Any, value: Any) -> Run:
    run = straight()
    array = getattr(run, name).copy()
    array[index] = value
    return replace(run, **{name: array})


def without(run: Run, ticks: slice) -> Run:
    keep = np.delete(np.arange(run.steps), ticks)
    parts = {n: getattr(run, n)[keep] for n in ("zone", "lights", "station", "speed", "pose")}
    return replace(run, **parts)


@pytest.mark.parametrize(
    ("run", "kind", "message"),
    [
        (lambda: changed("speed", (7, 0), np.nan), "values", "speed of a0 at 0.07 s is not a finite number"),
        (lambda: replace(straight(), speed=np.zeros((5, 1))), "values", "speed must have shape (400, 1), got (5, 1)"),
        (lambda: changed("zone", (7, 0), 9), "values", "the run has a zone that is none of approach"),
        (lambda: replace(straight(), dt=0.0), "values", "must be positive, got 0.0 s"),
        (lambda: replace(straight(), agents=(Agent("a0", ELSEWHERE),)), "values", "goes from entrance 0 to exit 7, where"),
        (lambda: replace(straight(), agents=()), "values", "zone must have shape (400, 0), got (400, 1)"),
        (lambda: changed("zone", (slice(20, None), 0), Zone.EXIT), "jump", "at 0.20 s: from approach to exit in one step"),
        (lambda: changed("zone", (slice(20, None), 0), Zone.ENTRANCE), "zone", "zone entrance, but its station is -3.40 m"),
        (lambda: changed("speed", slice(10, None), 5.0), "progress", "to the next state, speed times time is 0.050 m"),
        (lambda: without(straight(), slice(30, 32)), "missing ticks", "2 states seem to be missing"),
        (lambda: changed("pose", (slice(100, None), 0, 0), 999.0), "itinerary", "m off its itinerary at 1.00 s"),
        (lambda: changed("lights", (slice(50, None), 1), Colour.RED), "colour", "from none to red at 0.50 s, out of order"),
    ],
    ids=["nan", "shape", "code", "dt", "way", "nobody", "jump", "zone", "progress", "missing", "itinerary", "colour"],
)  # fmt: skip
def test_what_breaks_the_model_is_found(run: Callable[[], Run], kind: str, message: str) -> None:
    finding = next(f for f in validate(run()) if f.kind == kind)
    assert message in str(finding)


def test_coarse_sampling_is_told() -> None:
    run = moving({(0, 2): (-90.0, [8.0] * 100)})
    coarse = replace(run, dt=0.2, station=run.station[:1] + 1.6 * np.arange(100)[:, None])
    (finding,) = [f for f in validate(coarse) if f.kind == "sampling"]
    assert str(finding).startswith("a0 drives 8.0 m/s at 0.00 s: in 0.2 s that is more than the entrance zone of 1 m")
    assert not [f for f in validate(run) if f.kind == "sampling"]


def test_colours_in_order_are_fine() -> None:
    run = straight()
    lights = np.full((400, 4), Colour.GREEN, dtype=np.int8)
    lights[100:], lights[200:], lights[300:] = Colour.YELLOW, Colour.RED, Colour.GREEN
    assert validate(replace(run, lights=lights)) == ()
    lights[200:300] = Colour.GREEN
    first, *_ = validate(replace(run, lights=lights))
    assert str(first) == "light 0 turns from yellow to green at 2.00 s, out of order"


def test_a_damaged_run_is_not_judged_as_if_it_were_fine() -> None:
    verdict = check(changed("speed", (7, 0), np.nan), "p1")
    assert (verdict.status, verdict.reason) == ("ERROR", "speed of a0 at 0.07 s is not a finite number")
    for array, place, value, says in (
        ("zone", (7, 0), 9, "the run has a zone that is none of approach, "),
        ("lights", (7, 0), 9, "the run has a colour that is none of "),
        ("station", (7, 0), np.inf, "station of a0 at 0.07 s is not a finite number"),
    ):
        assert check(changed(array, place, value), "p1").reason.startswith(says)
    sizes: list[Any] = [(), (4.6, 0.0), (4.6, 1.86, 1.4), (np.inf, 1.86)]
    for size in sizes:
        odd = replace(straight(), agents=(replace(straight().agents[0], size=size),))
        assert check(odd, "p1").reason.startswith("the size of a0 must be a positive length and width")
    for broken in (changed("zone", (7, 0), 9), replace(straight(), speed=np.zeros((5, 1))), replace(straight(), dt=np.nan)):
        assert check(broken, "p1").status == "ERROR"


# Key performance indicators


def test_indicators_of_a_vehicle_by_hand() -> None:
    # 8 m/s for 1 s, braking at 4 m/s^2 to 0 in 2 s, standing for 1 s; the line is 0 m before the vertex.
    speeds = [8.0] * 100 + [8.0 - 0.04 * k for k in range(200)] + [0.0] * 101
    run = moving({(0, 2): (-16.5, speeds)})
    (one,) = kpis(run).vehicles
    assert one.delay is None, "it never gets to its exit"
    assert one.deceleration == pytest.approx(4.0)
    assert one.jerk == pytest.approx(4.0 / 0.1), "from 0 to 4 m/s^2 within the window"
    assert one.waiting == pytest.approx(float((run.zone[:, 0] == Zone.ENTRANCE).sum()) * 0.01)
    assert one.waiting > 1.0


def test_an_impact_is_no_braking() -> None:
    # a0 brakes at 2 m/s^2 and is stopped by a collision at 2 s; a1, which drives on, brakes at 4 m/s^2 after 3 s.
    hit = [8.0 - 0.02 * k for k in range(200)] + [0.0] * 201
    spared = [8.0] * 300 + [8.0 - 0.04 * k for k in range(101)]
    run = moving({(0, 2): (-30.0, hit), (1, 3): (-60.0, spared), (2, 0): (-60.0, [8.0] * 401)})
    assert kpis(run).vehicles[0].deceleration == pytest.approx(4.0 / 0.1, rel=0.05), "nobody said that it was an impact"
    touched = kpis(replace(run, collisions=(Collision(2.0, ("a0", "a2"), 9.0),)))
    assert [one.deceleration for one in touched.vehicles] == [pytest.approx(2.0), pytest.approx(4.0), 0.0]
    assert touched.vehicles[0].jerk == pytest.approx(0.0, abs=1e-6)
    at_once = kpis(replace(run, collisions=(Collision(0.0, ("a0", "a2"), 9.0),)))
    assert (at_once.vehicles[0].deceleration, at_once.vehicles[0].jerk) == (None, None), "it never drove"


def test_unrecorded_impact_is_no_braking() -> None:
    # Where nobody watched, bodies that touch tell it: a1 stands in the way of a0.
    speeds = [8.0] * 100 + [0.0] * 50
    run = moving({(0, 2): (-9.0, speeds), (1, 3): (-60.0, [0.0] * 150)})
    pose = run.need("pose").copy()
    pose[:, 1] = pose[101, 0]
    pose[:, 1, :2] -= 0.05 * np.array([np.cos(pose[0, 0, 2]), np.sin(pose[0, 0, 2])])
    pose[:, 1, 2] += np.pi  # head on
    blocked = replace(run, pose=pose, collisions=None)
    assert contacts(blocked)[0].time == pytest.approx(1.0, abs=0.02)
    assert kpis(blocked).vehicles[0].deceleration == pytest.approx(0.0, abs=1e-6)
    assert kpis(replace(blocked, collisions=())).vehicles[0].deceleration == pytest.approx(80.0)


def test_delay_against_the_speed_limit() -> None:
    run = moving({(0, 2): (-5.0, [8.0] * 700)})
    way = find("stop4").movements[0, 2].length + 5.0
    (one,) = kpis(run).vehicles
    assert one.delay == pytest.approx(way / 8.0 - way / 11.176, abs=0.011), "up to one step"
    limited = replace(run, facts=replace(run.facts, speed_limit=8.0))
    assert kpis(limited).vehicles[0].delay == pytest.approx(0.0, abs=0.011)


def test_time_to_collision_of_a_follower_by_hand() -> None:
    # On the same approach, 10 m/s behind 5 m/s, bumper to bumper 20 m less a body of 4.6 m.
    run = moving({(0, 2): (-60.0, [10.0] * 10), (1, 3): (-60.0, [5.0] * 10)})
    pose = run.pose
    assert pose is not None
    pose = pose.copy()
    heading = pose[0, 0, 2]
    pose[:, 1] = pose[:, 0]
    pose[:, 1, 0] += 20.0 * np.cos(heading)
    pose[:, 1, 1] += 20.0 * np.sin(heading)
    pose = np.repeat(pose[:1], 10, axis=0)
    (pair,) = kpis(replace(run, pose=pose)).pairs
    # The discs of radius 1.206 m reach 0.439 m beyond either end of the body.
    assert pair.ttc == pytest.approx((20.0 - 4.6 - 2 * 0.4387) / 5.0, abs=0.01)
    apart = replace(run, pose=pose, speed=np.tile([5.0, 10.0], (10, 1)))
    assert kpis(apart).pairs[0].ttc is None


def test_excerpt_has_the_indicators_of_its_judged_vehicles() -> None:
    run = moving({(0, 2): (-60.0, [10.0] * 10), (1, 3): (-60.0, [5.0] * 10), (2, 0): (-60.0, [5.0] * 10)})
    names = [agent.name for agent in run.agents]
    parts = [kpis(replace(run, excerpt=Excerpt(judged=judged))) for judged in (tuple(names[:2]), tuple(names[2:]))]
    whole = kpis(run)
    assert [v for part in parts for v in part.vehicles] == list(whole.vehicles)
    told = [pair for part in parts for pair in part.pairs]
    assert sorted(told, key=lambda p: p.agents) == sorted(whole.pairs, key=lambda p: p.agents), "each pair in one of them"


def test_post_encroachment_time_by_hand() -> None:
    # Two crossing straight movements; the second starts 40 m further back at the same speed, that is 5 s later.
    near, far = (0, 2), (1, 3)
    run = moving({near: (-10.0, [8.0] * 1600), far: (-50.0, [8.0] * 1600)})
    shared = find("stop4").stretches
    assert shared is not None
    (_, end), (start, _), _ = shared[near, far]
    wanted = (50.0 + start) / 8.0 - (10.0 + end + 4.6) / 8.0
    assert kpis(run).pairs[0].pet == pytest.approx(wanted, abs=0.021)
    together = moving({near: (-10.0, [8.0] * 1600), far: (-10.0, [8.0] * 1600)})
    assert kpis(together).pairs[0].pet is not None
    assert kpis(together).pet < 0
    assert kpis(moving({(0, 2): (-10.0, [8.0] * 900), (2, 0): (-10.0, [8.0] * 900)})).pet is None, "they never meet"


def test_post_encroachment_time_of_a_vehicle_that_stays_in_the_conflict() -> None:
    # Both drive to the middle and stand there: the second enters the shared stretch with the first one in it.
    speeds = [8.0] * 340 + [0.0] * 110
    run = moving({(0, 2): (-10.0, speeds), (1, 3): (-16.0, speeds)})
    shared = find("stop4").stretches
    assert shared is not None
    start = shared[(0, 2), (1, 3)].yours.start
    entered = (16.0 + start) / 8.0
    assert kpis(run).pet == pytest.approx(entered - 4.5, abs=0.011), "at least as long as the run lasted"


def test_unavailable_indicators_are_named(topology: Callable[[Junction], Junction]) -> None:
    run = moving({(0, 2): (-16.5, [8.0] * 50), (1, 3): (-16.5, [8.0] * 50)})
    assert kpis(run).unavailable == ()
    lacking = {
        ("delay",): replace(run, facts=replace(run.facts, speed_limit=None)),
        ("ttc", "pet"): replace(run, agents=tuple(replace(agent, size=None) for agent in run.agents)),
        ("deceleration", "jerk", "ttc"): replace(run, speed=None),
        ("delay", "pet"): replace(run, station=None),
        ("ttc",): replace(run, pose=None),
        ("pet",): replace(run, junction=topology(run.junction)),
    }
    for names, lacks in lacking.items():
        assert kpis(lacks).unavailable == names
        assert kpis(lacks).record()["unavailable"] == list(names)


def test_indicators_are_told_in_words() -> None:
    speeds = [8.0] * 100 + [8.0 - 0.04 * k for k in range(200)] + [0.0] * 101
    run = moving({(0, 2): (-16.5, speeds), (1, 3): (-50.0, [0.0] * 401)})
    assert describe(kpis(run)) == [
        f"waiting [s]  a0 {kpis(run).vehicles[0].waiting:.2f}, a1 0.00",
        "braking [m/s^2]  a0 4.00, a1 0.00",
        "jerk [m/s^3]  a0 40.00, a1 0.00",
    ]
    assert describe(kpis(replace(run, speed=None)))[-1] == "not recorded: braking, jerk, time to collision"


def test_records_are_builtins(real: Run) -> None:
    assert json.loads(json.dumps(kpis(real).record())) == kpis(real).record()

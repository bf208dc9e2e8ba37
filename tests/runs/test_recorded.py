"""Reading recorded runs: what they say, what they don't, and every way in which a file can be wrong."""

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.kpis import kpis
from pytest_rvads.logic.conduct.standing import wt
from pytest_rvads.logic.conduct.validate import validate
from pytest_rvads.runs.readers import read_recorded
from pytest_rvads.runs.states import Colour, Kind, Zone
from pytest_rvads.support.errors import RunError


def vehicle(road: str, way: str, leaving: str, node: str, ticks: tuple[int, int, int]) -> dict[str, Any]:
    arrives, enters, leaves = ticks
    return {
        "itinerary": [road, way, leaving],
        "edge": [[0, road], [enters, way], [leaves, leaving]],
        "at_entrance": [[0, ""], [arrives, node], [enters, ""]],
    }


def document() -> dict[str, Any]:
    """A T with stop signs, written by hand: n1 is right of n0, n2 right of n1, n0 and n2 face each other; exits x0..x2."""
    ways = [
        ("e01", "n0", "x1", "right", 10.0),
        ("e02", "n0", "x2", "straight", 20.0),
        ("e12", "n1", "x2", "right", 10.0),
        ("e10", "n1", "x0", "left", 16.0),
        ("e20", "n2", "x0", "straight", 20.0),
        ("e21", "n2", "x1", "left", 16.0),
    ]
    return {
        "graph": {
            "junction": "T",
            "entrances": ["n2", "n0", "n1"],
            "exits": ["x1", "x0", "x2"],
            "edges": [dict(zip(("id", "source", "target", "turn", "length"), w, strict=True)) for w in ways],
            "signals": [{"id": f"s{k}", "kind": "stop_sign", "node": f"n{k}"} for k in range(3)],
        },
        "right_of": [["n1", "n0"], ["n2", "n1"]],
        "opposite": [["n0", "n2"], ["n2", "n0"]],
        "runs": [
            {
                "name": "hand_r=1",
                "ticks": 100,
                "dt": 0.01,
                "vehicles": {
                    "c0": vehicle("r0", "e02", "o2", "n0", (10, 30, 60)),
                    "c1": vehicle("r1", "e12", "o2", "n1", (20, 70, 90)),
                    "c2": vehicle("r2", "e21", "o1", "n2", (5, 95, 99)),
                },
                "lights": {},
                "verdicts": {},
            }
        ],
    }


def write(tmp_path: Path, data: object) -> Path:
    path = tmp_path / "runs.json"
    path.write_text(json.dumps(data))
    return path


def test_kind_and_size_of_a_vehicle_are_read(tmp_path: Path) -> None:
    told = document()
    told["runs"][0]["vehicles"]["c1"] |= {"kind": "cyclist", "size": [1.8, 0.6]}
    (run,) = read_recorded(write(tmp_path, told))
    assert [(a.kind, a.size) for a in run.agents] == [("car", None), ("cyclist", (1.8, 0.6)), ("car", None)]
    for wrong, says in (
        ({"kind": "tank"}, f"kind' must be {' or '.join(map(repr, sorted(map(str, Kind))))}, got 'tank'"),
        ({"size": [1.8, -0.6]}, r"size\[1\]' must be a number > 0"),
    ):
        told["runs"][0]["vehicles"]["c1"] |= {"kind": "cyclist", "size": [1.8, 0.6]} | wrong
        with pytest.raises(RunError, match=says):
            read_recorded(write(tmp_path, told))


def test_a_run_is_decoded(tmp_path: Path) -> None:
    (run,) = read_recorded(write(tmp_path, document()))
    junction = run.junction
    # Vehicle i stands at entrance (i + 1) mod 3 in rotation 1: n0 is entrance 1, n1 entrance 2, n2 entrance 0.
    assert [(a.name, a.entrance, a.exit, a.turn) for a in run.agents] == [
        ("c0", 1, 0, "straight"),
        ("c1", 2, 0, "right"),
        ("c2", 0, 2, "left"),
    ]
    assert (run.steps, run.dt, junction.ways, junction.control) == (100, 0.01, 3, JunctionControl.STOP)
    assert junction.right_of == {(2, 1), (0, 2)}
    assert junction.opposite == {(1, 0), (0, 1)}
    zones = [Zone.APPROACH] * 10 + [Zone.ENTRANCE] * 20 + [Zone.JUNCTION] * 30 + [Zone.EXIT] * 40
    assert run.zone[:, 0].tolist() == zones
    assert wt(run, 0)[30 - 1] == 20
    assert not run.lights.any()
    assert (run.station, run.speed, run.pose) == (None, None, None)


def test_unrecorded_quantities_are_unavailable(tmp_path: Path) -> None:
    (run,) = read_recorded(write(tmp_path, document()))
    assert validate(run) == ()
    found = kpis(run)
    assert [v.waiting for v in found.vehicles] == [0.2, 0.5, 0.9]
    assert {(v.delay, v.deceleration, v.jerk) for v in found.vehicles} == {(None, None, None)}
    assert {(p.ttc, p.pet) for p in found.pairs} == {(None, None)}
    assert run.collisions is None
    assert check(run, "no_collision").reason == "not recorded: the run holds no positions"
    assert check(run, "no_conflict").reason == "not recorded: the run holds no positions"


def test_without_a_rotation_the_chain_of_right_of_counts(tmp_path: Path) -> None:
    data = document()
    data["runs"][0]["name"] = "plain"
    (run,) = read_recorded(write(tmp_path, data))
    assert [a.entrance for a in run.agents] == [0, 1, 2]


def test_vehicles_are_counted_by_their_names(tmp_path: Path) -> None:
    data = document()
    data["runs"][0]["vehicles"] = dict(reversed(data["runs"][0]["vehicles"].items()))
    (run,) = read_recorded(write(tmp_path, data))
    assert [(a.name, a.entrance) for a in run.agents] == [("c2", 0), ("c1", 2), ("c0", 1)]


@pytest.mark.parametrize("there", [(0,), (1,), (2,), (0, 2), (1, 2), ()])
def test_a_run_may_lack_vehicles(tmp_path: Path, there: tuple[int, ...]) -> None:
    data = document()
    vehicles = data["runs"][0]["vehicles"]
    data["runs"][0]["vehicles"] = {name: v for name, v in vehicles.items() if int(name[1]) in there}
    (run,) = read_recorded(write(tmp_path, data))
    assert [(a.name, a.entrance) for a in run.agents] == [(f"c{i}", (i + 1) % 3) for i in there]
    assert check(run, "p1").status == ("NA" if len(there) < 2 else "PASS" if there == (0, 2) else check(run, "p1").status)


def test_several_runs_number_the_entrances_together(tmp_path: Path) -> None:
    # In a junction without right-of, such as a Y, only the vehicles tell.
    data = document()
    data["right_of"] = []
    (whole,) = data["runs"]
    vehicles = whole["vehicles"].items()
    data["runs"] = [{**whole, "name": f"{name}_r=1", "vehicles": {name: v}} for name, v in vehicles]
    assert [run.agents[0].entrance for run in read_recorded(write(tmp_path, data))] == [1, 2, 0]
    data["runs"] = [{**whole, "name": "untold"}]
    (run,) = read_recorded(write(tmp_path, data))
    # As in the file: n2, n0, n1.
    assert [a.entrance for a in run.agents] == [1, 2, 0]


def test_verdicts_may_be_absent(tmp_path: Path) -> None:
    data = document()
    del data["runs"][0]["verdicts"]
    (run,) = read_recorded(write(tmp_path, data))
    assert run.provenance["verdicts"] == {}


def test_lights(tmp_path: Path) -> None:
    data = document()
    for signal in data["graph"]["signals"]:
        signal["kind"] = "traffic_light"
    colours = {"s0": [[0, 1], [50, 2], [80, 3]], "s1": [[0, 3]], "s2": [[0, 1], [50, 2], [80, 3]]}
    data["runs"][0]["lights"] = {s: {"node": f"n{s[1]}", "color": c} for s, c in colours.items()}
    (run,) = read_recorded(write(tmp_path, data))
    assert run.junction.control is JunctionControl.LIGHTS
    assert run.junction.phase_groups == ({0, 1}, {2})
    assert run.lights[[0, 50, 79, 80], 1].tolist() == [Colour.GREEN, Colour.YELLOW, Colour.YELLOW, Colour.RED]
    assert (run.lights[:, 2] == Colour.RED).all()


def test_signs_of_the_minor_and_of_the_major_road(tmp_path: Path) -> None:
    data = document()
    for signal, kind in zip(data["graph"]["signals"], ("yield_sign", "priority_sign", "stop_sign"), strict=True):
        signal["kind"] = kind
    (run,) = read_recorded(write(tmp_path, data))
    assert sorted(lane.sign for lane in run.junction.entrances) == [Sign.PRIORITY, Sign.STOP, Sign.YIELD]
    assert run.junction.control is JunctionControl.PARTIAL, "and no lights are asked for"


def broken(*path: Any, value: Any = None, drop: bool = False) -> dict[str, Any]:
    data = copy.deepcopy(document())
    here: Any = data
    for key in path[:-1]:
        here = here[key]
    if drop:
        del here[path[-1]]
    else:
        here[path[-1]] = value
    return data


RUN = ("runs", 0)
C0 = (*RUN, "vehicles", "c0")
WRONG: list[tuple[dict[str, Any], str]] = [
    (broken("runs", drop=True), "the field 'runs' is missing"),
    (broken("graph", drop=True), "the field 'graph' is missing"),
    (broken("graph", "edges", 0, "turn", drop=True), "the field 'graph.edges[0].turn' is missing"),
    (
        broken("graph", "edges", 0, "turn", value="back"),
        "'graph.edges[0].turn' must be 'left' or 'right' or 'straight', got 'back'",
    ),
    (broken("graph", "edges", 0, "length", value=float("nan")), "'graph.edges[0].length' must be a number >= 0.0, got nan"),
    (broken("graph", "edges", 5, "target", value="x0"), "exit 'x1' must be reached from all entrances but one"),
    (broken("right_of", value=[["n1", "nope"]]), "must hold pairs of the entrances"),
    (broken(*RUN, "ticks", value=0), "'runs[0].ticks' must be a number >= 1.0, got 0"),
    (broken(*RUN, "ticks", value=1e8), "'runs[0].ticks' must be a number <= 10000000.0, got 100000000.0"),
    (broken(*RUN, "ticks", value=1.5), "'runs[0].ticks' must be a number that's a multiple of 1.0, got 1.5"),
    (broken(*RUN, "name", value=3), "'runs[0].name' must be a text, got 3"),
    (broken(*RUN, "ticks", value="many"), "'runs[0].ticks' must be a number, got 'many'"),
    (broken(*RUN, "dt", value=0), "'runs[0].dt' must be a number >= 1e-06, got 0"),
    (broken(*RUN, "dt", value=float("nan")), "'runs[0].dt' must be a number >= 1e-06, got nan"),
    (broken(*RUN, "vehicles", value=[]), "'runs[0].vehicles' must be an object, got []"),
    (broken("runs", 0, "vehicles", "c2", "edge", drop=True), "the field 'runs[0].vehicles.c2.edge' is missing"),
    (broken(*C0, "init_speed", value=float("inf")), "'runs[0].vehicles.c0.init_speed' must be a number"),
    (broken(*C0, "edge", value=[]), "run 'hand_r=1': vehicle 'c0': the series 'edge' must start at tick 0"),
    (broken(*C0, "edge", value=[[5, "r0"]]), "must start at tick 0"),
    (broken(*C0, "edge", value=[[0, "r0"], [9, "e02"], [8, "o2"]]), "increase"),
    (broken(*C0, "edge", value=[[0, "r0"], [100, "e02"]]), "stay below 100"),
    (broken(*C0, "edge", value=[[0, "r0"], ["x", "e02"]]), "c0.edge[1][0]' must be a whole number, got 'x'"),
    (
        broken(*C0, "edge", value=[[0, "r0"], [9, "zz"]]),
        "the series 'edge': 'zz' at tick 9 is not on its itinerary ['r0', 'e02', 'o2']",
    ),
    (broken(*C0, "itinerary", value=["r0", "o2"]), "must pass the junction once, it does 0 times"),
    (
        broken(*C0, "at_entrance", value=[[0, "n1"]]),
        "the series 'at_entrance': 'n1' at tick 0 is not on its itinerary ['', 'n0']",
    ),
    (
        broken(*RUN, "lights", value={"s0": {"node": "n0", "color": [[0, 7]]}}),
        "'runs[0].lights.s0.color[0][1]' must be a whole number <= 3, got 7",
    ),
]


def refusal(tmp_path: Path, data: dict[str, Any]) -> str:
    """Return the message with which a file is refused."""
    with pytest.raises(RunError) as caught:
        read_recorded(write(tmp_path, data))
    return str(caught.value)


@pytest.mark.parametrize(("data", "message"), WRONG, ids=[w[1] for w in WRONG])
def test_a_wrong_file_is_refused_by_name(tmp_path: Path, data: dict[str, Any], message: str) -> None:
    text = refusal(tmp_path, data)
    assert message in text
    assert text.startswith("runs.json: ")
    assert "\n" not in text


MANY = [{**document()["runs"][0], "name": f"r{k}", "ticks": 10_000_000} for k in range(60)]
HOSTILE: list[tuple[dict[str, Any], str]] = [
    (
        broken("runs", value=MANY),
        "600,000,000 ticks of so many vehicles and entrances are 21,600,000,000 pairs of them, at most 320,000,000 are read",
    ),
    (broken("runs", value=MANY * 40), "the field 'runs' must be a list of length <= 2000, got"),
    (
        broken(*RUN, "vehicles", value={f"c{k}": {} for k in range(101)}),
        "the field 'runs[0].vehicles.c0.itinerary' is missing",
    ),
    (
        broken(*RUN, "vehicles", value={f"c{k}": document()["runs"][0]["vehicles"]["c0"] for k in range(101)}),
        "101 vehicles at 3 entrances, at most 100 of either are read",
    ),
    (broken("graph", "entrances", value=["n"] * 101), "the field 'graph.entrances' must be a list of length <= 100, got"),
    (broken(*RUN, "name", value=""), "'runs[0].name' must be a text of length >= 1, got ''"),
    (broken(*RUN, "name", value="a\nb"), "'runs[0].name' must be a text without control characters, got 'a\\nb'"),
    (
        broken(*RUN, "vehicles", value={"": document()["runs"][0]["vehicles"]["c0"]}),
        "the name of a vehicle: it must be a text of",
    ),
    (broken(*RUN, "verdicts", value={"p1": float("nan")}), "not JSON: Out of range float values"),
    (broken(*RUN, "verdicts", value={"p1": "\ud800"}), "not JSON: 'utf-8' codec can't encode character"),
    (broken(*RUN, "dt", value=5e-324), "'runs[0].dt' must be a number >= 1e-06"),
    (broken(*C0, "itinerary", value=["r0"] * 100_000), "the itinerary ['r0', 'r0', 'r0', 'r0', 'r0', 'r0', ...] must pass"),
]


@pytest.mark.parametrize(("data", "message"), HOSTILE, ids=[h[1] for h in HOSTILE])
def test_what_would_take_too_much_or_has_no_proper_name_is_refused(tmp_path: Path, data: dict[str, Any], message: str) -> None:
    text = refusal(tmp_path, data)
    assert message in text
    assert len(text) < 500


def test_long_series_take_no_longer_than_their_length(tmp_path: Path) -> None:
    data = broken(*C0, "at_entrance", value=[[k, "" if k % 2 else "n0"] for k in range(200_000)])
    data["runs"][0]["ticks"] = 1_000_000
    (run,) = read_recorded(write(tmp_path, data))
    assert run.zone[:10, 0].tolist() == [Zone.ENTRANCE, Zone.APPROACH] * 5


def test_what_is_no_utf_8_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, document())
    path.write_bytes(path.read_bytes().replace(b"hand", b"h\xffnd"))
    with pytest.raises(RunError, match=r"runs\.json: not JSON: 'utf-8' codec can't decode byte 0xff"):
        read_recorded(path)


def paths(data: Any, here: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if here:
        yield here
    for key in range(len(data)) if isinstance(data, list) else data if isinstance(data, dict) else ():
        yield from paths(data[key], (*here, key))


@pytest.mark.parametrize("junk", [None, -1, 1.5, True, "", "zz", [], [[]], {}, {"a": 1}, 10**30], ids=repr)
def test_whatever_stands_in_a_field_is_read_or_refused(tmp_path: Path, junk: Any) -> None:
    def is_read(path: tuple[Any, ...]) -> bool:
        try:
            for run in read_recorded(write(tmp_path, broken(*path, value=junk))):
                validate(run)
                kpis(run)
                check(run, "p2")
        except RunError:
            return False
        return True

    outcomes = [is_read(path) for path in paths(document())]
    assert outcomes.count(False) > len(outcomes) / 3


def test_file_without_json_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "runs.json"
    for text in ("{", "[" * 100_000):
        path.write_text(text)
        with pytest.raises(RunError, match="not JSON"):
            read_recorded(path)
    path.write_text("[]")
    with pytest.raises(RunError, match=r"must be an object, got \[\]"):
        read_recorded(path)
    with pytest.raises(RunError, match="can't be read"):
        read_recorded(tmp_path / "absent.json")


def test_shared_recordings_are_valid(shared: Path) -> None:
    for path in sorted((shared / "runs").glob("*.json")):
        for run in read_recorded(path):
            assert validate(run) == (), run.label
            assert np.isin(run.zone[0], (Zone.APPROACH, Zone.ENTRANCE)).all()

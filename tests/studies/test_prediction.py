"""Junctions built from lengths, and runs at them: requests, answers, and the recorded T junctions."""

import io
import json
import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.segment import join
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.physics.engines import usual
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.lgsvl import frame
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.loop import Planar
from pytest_rvads.simulators.patience import Watch
from pytest_rvads.support.errors import MapError, ScenarioError
from studies import prediction
from studies.requests import Graph, answer, site_lengths
from studies.site import Lengths, build_junction

RULES = {"one-car-in-junction": "p1", "right-of-priority": "p2", "fifo-priority": "p3"}
RULES |= {"traffic-light": "p4", "right-turn-priority": "p5", "opposite-turn-priority": "p6"}
WORDS = {"True": "PASS", "False": "FAIL", "None": "NA"}

# A T whose stem is arm 1: from arm 0 right into it, from arm 2 left.
T: Lengths = {
    (0, 1): (Turn.RIGHT, 12.5),
    (0, 2): (Turn.STRAIGHT, 21.6),
    (1, 2): (Turn.RIGHT, 13.5),
    (1, 0): (Turn.LEFT, 23.5),
    (2, 0): (Turn.STRAIGHT, 21.5),
    (2, 1): (Turn.LEFT, 23.8),
}


def graph(lengths: Lengths) -> dict[str, Any]:
    edges = [
        {"id": f"e{i}{k}", "source": f"in{i}", "target": f"out{k}", "turn": str(turn), "length": length}
        for (i, k), (turn, length) in lengths.items()
    ]
    ways = 1 + max(i for i, _ in lengths)
    return {"entrances": [f"in{i}" for i in range(ways)], "exits": [f"out{i}" for i in reversed(range(ways))], "edges": edges}


EDGES = graph(T)["edges"]


def request(**changes: Any) -> dict[str, Any]:
    values = {
        "id": 7,
        "graph": graph(T),
        "order": ["in0", "in1", "in2"],
        "control": "stop",
        "directions": "112",
        "distances": [0.3, 0.3, 10],
        "speeds": [0, 0, 0],
        "rotation": 0,
        "autopilot": "lgsvl",
        "wait": None,
    }
    return {**values, **changes}


def test_a_built_junction_has_the_lengths_asked_for() -> None:
    junction = build_junction("t", JunctionControl.STOP, T, 3)
    for key, (turn, length) in T.items():
        assert junction.movements[*key].turn is turn
        assert junction.movements[key].length == pytest.approx(length, abs=0.05)
    assert junction.opposite == {(0, 2), (2, 0)}
    assert junction.right_of == find("stop3").right_of or junction.right_of == {(1, 0), (2, 1)}


def test_lanes_of_a_built_junction_meet_without_a_kink() -> None:
    junction = build_junction("t", JunctionControl.STOP, T, 3)
    assert junction.drivable
    for (i, k), movement in ((key, m.path) for key, m in junction.movements.items()):
        path = join((junction.way_in(i), movement, junction.way_out(k)))
        assert path is not None
        headings = [path.pose(float(s)).heading for s in range(100, 160)]
        assert max(abs(math.remainder(b - a, math.tau)) for a, b in pairwise(headings)) < 0.3


def test_the_lengths_of_a_drawn_junction_give_its_shape_back() -> None:
    drawn = find("paper_stop4")
    lengths = {key: (m.turn, m.length) for key, m in drawn.movements.items()}
    built = build_junction("x", JunctionControl.STOP, lengths, 4)
    assert drawn.drivable
    assert built.drivable
    for key, segment in ((key, m.path) for key, m in drawn.movements.items()):
        for station in (0.0, segment.length / 2, segment.length):
            assert built.way_through(*(key)).pose(station)[:2] == pytest.approx(segment.pose(station)[:2], abs=0.05)


def test_the_zone_of_a_t_follows_its_stem() -> None:
    order = (1, 2, 0)  # the same junction, counted from another arm
    turned = {(order.index(i), order.index(k)): value for (i, k), value in T.items()}
    one, two = (build_junction("t", JunctionControl.STOP, lengths, 3) for lengths in (T, turned))
    for junction, stem in ((one, 1), (two, 0)):
        assert junction.drivable
        away = junction.way_out(stem).pose(0.0).heading
        assert math.remainder(frame(junction).heading - away, math.tau) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("lengths", "message"),
    [
        ({**T, (0, 2): (Turn.STRAIGHT, 1.0)}, "no junction with arms at right angles has these lengths"),
        ({**T, (1, 2): (Turn.LEFT, 13.5)}, "do not go with arms at right angles"),
        ({(2 - i, 2 - k): value for (i, k), value in T.items()}, "counted counter-clockwise"),
        ({key: value for key, value in T.items() if key != (2, 1)}, "needs a movement from every entrance"),
    ],
)
def test_lengths_of_no_junction_are_refused(lengths: Lengths, message: str) -> None:
    with pytest.raises(MapError, match=message):
        build_junction("t", JunctionControl.STOP, lengths, 3)


def test_an_answer_names_verdicts_entries_and_a_hash() -> None:
    found = json.loads(answer(json.dumps(request())))
    assert list(found) == ["id", "verdicts", "entry", "hash"]
    assert found["id"] == 7
    assert list(found["verdicts"]) == ["p1", "p2", "p3"]
    assert found["entry"]["c0"] < found["entry"]["c1"] < found["entry"]["c2"], "first in, first out, by creation"
    assert found == json.loads(answer(json.dumps(request()))), "the same run again, bit for bit"


def test_c0_starts_at_the_entrance_that_the_rotation_says() -> None:
    # Alone near the line, c0 turns right into the stem from arm 0; in rotation 1 it comes from the stem.
    times = [json.loads(answer(json.dumps(request(rotation=r, distances=[0.3, 40, 40]))))["entry"] for r in (0, 1)]
    assert all(1.5 < t["c0"] < 2.0 < min(t["c1"], t["c2"]) for t in times)


def test_null_stands_for_a_draw_of_one_and_a_half_seconds() -> None:
    # Arm 0 and arm 2 have green at first, arm 1 turns right on red.
    lights = {"control": "lights", "directions": "211", "distances": [60, 0.3, 60]}
    none, same, longer = (json.loads(answer(json.dumps(request(**lights, wait=w)))) for w in (None, 1.5, 2.5))
    assert none == same
    assert longer["entry"]["c1"] - none["entry"]["c1"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("{", "JSON object in one line"),
        ("[]", "must be an object, got []"),
        (json.dumps(request(control="yield")), "the field 'control' must be 'lights' or 'stop'"),
        (json.dumps(request(autopilot="lgsv")), "did you mean 'lgsvl'"),
        (json.dumps(request(order=["in0", "in1"])), "order must name"),
        (json.dumps(request(directions="1123")), "describe 4 entrances, junction 'site' has 3"),
        (json.dumps(request(directions="11")), "11"),
        (json.dumps(request(distances=[1, 2])), "distance"),
        (json.dumps(request(distances=["a", 1, 1])), "'distances[0]' must be a number, got 'a'"),
        (json.dumps(request(graph={"edges": []})), "the field 'graph.entrances' is missing"),
        (json.dumps(request(graph=graph({**T, (0, 1): (Turn.RIGHT, 1e9)}))), "at most 500 m"),
        (json.dumps(request(rotation=9)), "rotation"),
        (json.dumps(request(distances=[500, 1, 1])), "does not fit"),
        (json.dumps(request(wait=-1)), "wait must be"),
        (json.dumps(request(speeds=[float("nan")] * 3)), "speed"),
        (json.dumps(request(id=float("inf"))), "the id of a request must be a JSON value"),
        (json.dumps(request(wait=10**400)), "too large"),
        (json.dumps(request(distances=20)), "'distances' must be a list, got 20"),
        (json.dumps(request(rotation=1.0)), "'rotation' must be a whole number or null, got 1.0"),
        (json.dumps(request(order=["in1", "in0", "in2"])), "counted counter-clockwise"),
        (json.dumps(request(order=["in0", "in0", "in2"])), "order must name"),
        (json.dumps(request(graph={**graph(T), "exits": ["out0", "out1"]})), "as many exits as entrances"),
        (json.dumps(request(graph={**graph(T), "edges": EDGES[:-1]})), "must lead to every exit"),
        (json.dumps(request(graph={**graph(T), "edges": [*EDGES, {**EDGES[0], "length": 30}]})), "two different edges"),
        (
            json.dumps(request(graph={**graph(T), "edges": [{**e, "length": "12"} for e in EDGES]})),
            "'graph.edges[0].length' must be a number, got '12'",
        ),
        (
            json.dumps(request(graph={**graph(T), "edges": [{**e, "turn": "back"} for e in EDGES]})),
            "turn' must be 'left' or 'right' or 'straight'",
        ),
        (json.dumps({"id": 7}), "the field 'graph' is missing"),
    ],
)
def test_what_cannot_be_simulated_is_answered_with_an_error(line: str, words: str) -> None:
    found = json.loads(answer(line))
    assert list(found) == ["id", "error"]
    assert words in found["error"]
    assert "could not be simulated" not in found["error"], "foreseen, not a mishap"


def test_the_command_answers_line_by_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    last = json.dumps(request(id="b", autopilot="reference"))
    lines = [json.dumps(request()).encode(), b"", b"{", b"\xff\xfe{}", last.encode()]
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"\n".join(lines))))
    assert prediction.main(["--jsonl"]) == 0
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [entry["id"] for entry in found] == [7, None, None, "b"]
    assert found[3]["verdicts"]["p1"] == "PASS"


def test_request_is_simulated_by_the_named_simulator() -> None:
    class Unwilling(Planar):
        def __call__(self, case: Case, watch: Watch | None = None) -> Run:
            raise ScenarioError("not today")

    assert json.loads(answer(json.dumps(request()), Unwilling(usual())))["error"] == "not today"


def test_a_mishap_does_not_keep_the_next_request_from_its_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("by accident")

    monkeypatch.setattr("studies.requests.simulate", fail)
    assert json.loads(answer(json.dumps(request()))) == {
        "id": 7,
        "error": "this request could not be simulated: ZeroDivisionError: by accident",
    }


def recorded(path: Path, control: str) -> Iterator[tuple[dict[str, Any], dict[str, str], dict[str, float]]]:
    """Requests that describe the runs of a file, with their verdicts and times of entry."""
    data = json.loads(path.read_text())
    sources = {edge["id"]: edge["source"] for edge in data["graph"]["edges"]}
    first = next(run for run in data["runs"] if run["name"].endswith("r=0"))
    order = [sources[first["vehicles"][f"c{i}"]["itinerary"][1]] for i in range(len(first["vehicles"]))]
    for run in data["runs"]:
        directions, distances, speeds, rotation = run["name"].split("_", 1)[1].rsplit("_", 3)
        yield (
            {
                "id": run["name"],
                "graph": data["graph"],
                "order": order,
                "control": control,
                "directions": "".join(d[2:] for d in directions.split(",")),
                "distances": [float(d) for d in distances.split(",")],
                "speeds": [float(v) for v in speeds.split(",")],
                "rotation": int(rotation[2:]),
                "autopilot": "lgsvl",
                "wait": None,
            },
            {RULES[name]: WORDS[value] for name, value in run["verdicts"].items()},
            {
                name: next(tick for tick, edge in v["edge"] if edge == v["itinerary"][1]) * run["dt"]
                for name, v in run["vehicles"].items()
            },
        )


@pytest.mark.extended
@pytest.mark.parametrize(("name", "control"), [("4-way-stop", "stop"), ("4-way-light", "lights")])
def test_the_recorded_xs_give_the_published_verdicts_at_their_own_lengths(shared: Path, name: str, control: str) -> None:
    # The constants were fitted on the built-in junctions, whose lengths are only about those of the recorded ones.
    for asked, verdicts, _ in recorded(shared / "runs" / f"{name}.json", control):
        if asked["rotation"] % 2 == 0:
            assert json.loads(answer(json.dumps(asked)))["verdicts"] == verdicts


def test_the_edges_of_a_recorded_graph_give_all_movements(shared: Path) -> None:
    data = json.loads((shared / "runs" / "4-way-stop.json").read_text())
    nodes, right_of = data["graph"]["entrances"], dict(map(tuple, map(reversed, data["right_of"])))
    order = [nodes[0]]
    while len(order) < 4:
        order.append(right_of[order[-1]])
    junction = build_junction("x", JunctionControl.STOP, site_lengths(msgspec.convert(data["graph"], Graph), order), 4)
    assert {(order[a], order[b]) for a, b in junction.right_of} == set(map(tuple, data["right_of"]))
    assert {(order[a], order[b]) for a, b in junction.opposite} == set(map(tuple, data["opposite"]))

"""Pedestrians in the protocol: stacks that read them are told of them, and all others get the bytes of before."""

import importlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.stacks import frames, messages
from pytest_rvads.drivers.stacks.child import StackError
from pytest_rvads.drivers.stacks.process import Process
from pytest_rvads.runs.run import Run
from tests.zebras import zebra

ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT / "clients" / "python"))
rvads_client = importlib.import_module("rvads_client")
sys.path.pop()
PLACE = zebra("light4", lit=True)
WALKERS = [
    rvads.Pedestrian(1, "near", "hidden", 1.0),
    rvads.Pedestrian(1, "far", "steady", -0.5),
    rvads.Pedestrian(3, "far", "waits", 2.0),
]
FORMATS = [messages.Json, frames.Binary]
SEEN: list[Observation] = []
PYTHON = """
import json, sys
import rvads_client
with open(sys.argv[1], "w") as out:
    for seen in rvads_client.connect("dump", rate=20, pedestrians=sys.argv[2] == "yes"):
        if seen.fresh:
            print(json.dumps(seen.scenario), file=out)
        gap = min(seen.gap_to_pedestrians(2.0), 1000.0)
        print(json.dumps([seen.pedestrians, seen.parked, seen.walks, gap]), file=out)
        seen.answer(target_speed=8.0)
"""
C = r"""
#include "rvads.h"
static void list(FILE *out, const rvads_pedestrian *people, uint32_t count) {
    for (uint32_t k = 0; k < count; ++k)
        fprintf(out, "%s[%u, \"%s\", %u, %u, %u, %u, %.17g, %.17g, %.17g, %.17g, %.17g, %.17g, %.17g, %.17g]", k ? ", " : "",
                people[k].id, people[k].name, people[k].kind, people[k].crosswalk, people[k].side, people[k].zone,
                people[k].station, people[k].x, people[k].y, people[k].heading, people[k].speed, people[k].acceleration,
                people[k].length, people[k].width);
}
int main(int, char **arguments) {
    static rvads_observation seen;
    rvads link;
    rvads_command command;
    FILE *out = fopen(arguments[1], "w");
    bool asks = arguments[2][0] == 'y';
    if (!(asks ? rvads_open_with_pedestrians : rvads_open)(&link, "dump", 20.0)) return 1;
    while (rvads_next(&link, &seen)) {
        if (link.fresh) {
            fprintf(out, "[[");
            for (uint32_t k = 0; k < link.scenario.crosswalks_count; ++k)
                fprintf(out, "%s[%u, %d, %.17g, %.17g, %.17g]", k ? ", " : "", link.crosswalks[k].arm, link.crosswalks[k].phase,
                        link.crosswalks[k].length, link.crosswalks[k].middle, link.crosswalks[k].island);
            fprintf(out, "], [");
            for (uint32_t k = 0; k < link.covers_count; ++k)
                fprintf(out, "%s[%u, %u, %.17g, %.17g, %.17g, %.17g]", k ? ", " : "", link.covers[k].crosswalk,
                        link.covers[k].movement, link.covers[k].start, link.covers[k].end, link.covers[k].walk_start,
                        link.covers[k].walk_end);
            fprintf(out, "]]\n");
        }
        fprintf(out, "[[");
        list(out, seen.pedestrians, seen.pedestrians_count);
        fprintf(out, "], [");
        list(out, seen.parked, seen.parked_count);
        fprintf(out, "], [");
        for (uint32_t k = 0; k < link.scenario.crosswalks_count; ++k) fprintf(out, "%s%u", k ? ", " : "", seen.walks[k]);
        fprintf(out, "], %.17g]\n", rvads_gap_to_pedestrians(&link, &seen, 2.0));
        rvads_target_speed(&command, 8.0);
        if (!rvads_answer(&link, &command)) return 1;
    }
    fclose(out);
    return 0;
}
"""


class Spy(rvads.Reference):
    """Notes what it sees."""

    def control(self, seen: Observation) -> Control:
        SEEN.append(seen)
        return super().control(seen)


@pytest.fixture(scope="module")
def look() -> list[Observation]:
    """What a1 sees of three pedestrians, a parked vehicle, and a2."""
    SEEN.clear()
    scenario = rvads.Scenario(PLACE, "0220", distance=20, speed=8, subject=1, pedestrians=WALKERS, duration=8)
    assert rvads.simulate(rvads.Case(scenario, Spy, traffic=rvads.Reference)).fault is None
    assert {other.name for other in SEEN[0].others} == {"a2", "p0", "parked0", "p1", "p2"}
    return SEEN[::50]


def without(seen: Observation) -> Observation:
    """Return the observation as if nobody walked at a junction without crosswalks."""
    place = replace(seen.junction, further=(), crossings=())
    vehicles = tuple(other for other in seen.others if other.name == "a2")
    return seen._replace(junction=place, others=vehicles, lights=seen.lights[:4])


@pytest.mark.parametrize("make", FORMATS)
def test_stack_that_does_not_read_pedestrians_gets_the_same_bytes_as_before(make: Any, look: list[Observation]) -> None:
    with_people, alone = make(), make()
    assert with_people.begin(messages.reset(look[0], 0.05)) == alone.begin(messages.reset(without(look[0]), 0.05))
    for step, seen in enumerate(look, 1):
        assert with_people.observe(seen, step) == alone.observe(without(seen), step)


def told(look: list[Observation]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    talk = messages.Json(pedestrians=True)
    content = json.loads(talk.begin(messages.reset(look[0], 0.05, pedestrians=True)))
    return content, [json.loads(talk.observe(seen, step)) for step, seen in enumerate(look, 1)]


def test_stack_that_reads_pedestrians_is_told_of_them(look: list[Observation]) -> None:
    content, observed = told(look)
    place = content["map"]
    assert [(one["arm"], one["phase"], one["length"], one["middle"]) for one in place["crosswalks"]] == [
        (k, 1 - k % 2, pytest.approx(7.0), pytest.approx(3.5)) for k in range(4)
    ]
    assert place["crosswalks"][1]["area"] == look[0].junction.crossings[1].area.tolist()
    straight = next(k for k, way in enumerate(place["movements"]) if (way["entrance"], way["exit"]) == (1, 3))
    first, last = [cover for cover in place["covers"] if cover["movement"] == straight]
    assert (first["crosswalk"], last["crosswalk"]) == (1, 3)
    # The painted area is 3 m wide and begins 1.2 m behind the line. The lane is 3.5 m wide, and vehicles take up 2.6 m of it.
    assert (first["start"], first["end"]) == (pytest.approx(1.2, abs=0.11), pytest.approx(4.2, abs=0.11))
    assert 0.0 < first["walk_start"] < first["walk_end"] < 3.5 < last["walk_start"] < last["walk_end"] < 7.0
    for seen, message in zip(look, observed, strict=True):
        assert [one["name"] for one in message["others"]] == [one.name for one in seen.others if one.name == "a2"]
        people = {one["name"]: one for one in message["pedestrians"]}
        assert people.keys() == {one.name for one in seen.others if one.kind is rvads.Kind.PEDESTRIAN}
        assert [one["name"] for one in message["parked"]] == ["parked0"]
        assert {name: (one["crosswalk"], one["side"], one["kind"]) for name, one in people.items()}.items() <= {
            "p0": (1, "near", "pedestrian"),
            "p1": (1, "far", "pedestrian"),
            "p2": (3, "far", "pedestrian"),
        }.items()
        for one in seen.others:
            if one.name in people:
                assert [people[one.name][name] for name in ("station", "x", "y", "speed")] == [
                    one.station,
                    one.x,
                    one.y,
                    one.speed,
                ]
        ids = [one["id"] for part in ("others", "pedestrians", "parked") for one in message[part]]
        assert len({*ids, 0}) == len(ids) + 1
        assert len(message["lights"]) == 4
        lights = {rvads.Colour(seen.lights[one.way.entrance]).name.lower() for one in look[0].junction.further[2:4]}
        assert {message["walks"][1]} == lights


def test_reader_is_told_of_crosswalks_where_nobody_walks() -> None:
    SEEN.clear()
    rvads.simulate(rvads.Case(rvads.Scenario(PLACE, "0220", distance=20, subject=1, duration=0.02), Spy))
    content, (seen, *_) = told(SEEN)
    assert len(content["map"]["crosswalks"]) == 4
    assert (seen["pedestrians"], seen["parked"], seen["walks"]) == ([], [], ["none"] * 4)


def drive(command: list[str], out: Path, asks: str) -> tuple[Run, list[Any]]:
    scenario = rvads.Scenario(PLACE, "0220", distance=20, speed=8, subject=1, pedestrians=WALKERS, duration=2.5)
    with Process([*command, str(out), asks], rate=20, timeout=60.0, startup=60.0) as stack:
        run = rvads.simulate(rvads.Case(scenario, stack, traffic=rvads.Reference))
    assert run.fault is None, run.fault
    return run, [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]


@pytest.fixture(scope="module")
def clients(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    folder = tmp_path_factory.mktemp("clients")
    (folder / "dump.cpp").write_text(C, encoding="utf-8")
    flags = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsanitize=address,undefined", f"-I{ROOT / 'clients' / 'c'}"]
    subprocess.run(["g++", *flags, "-o", str(folder / "dump"), str(folder / "dump.cpp")], check=True)
    code = f"import sys; sys.path.insert(0, {str(ROOT / 'clients' / 'python')!r})\n{PYTHON}"
    (folder / "dump.py").write_text(code, encoding="utf-8")
    return {"c": [str(folder / "dump")], "python": [sys.executable, str(folder / "dump.py")]}


def test_both_clients_read_the_same(clients: dict[str, list[str]], tmp_path: Path) -> None:
    run, (content, *python) = drive(clients["python"], tmp_path / "python", "yes")
    same, (head, *binary) = drive(clients["c"], tmp_path / "c", "yes")
    assert same.hash == run.hash
    place, sides, kinds = content["map"], ("near", "far"), [*rvads.Kind]
    assert head[0] == [[one["arm"], one["phase"], one["length"], one["middle"], one["island"]] for one in place["crosswalks"]]
    assert head[1] == [[*cover.values()] for cover in place["covers"]]
    assert len(binary) == len(python) == 50
    zones, colours = ("approach", "entrance", "junction", "exit"), ("none", "green", "yellow", "red")
    for (*people, walks, gap), (*rows, lights, same_gap) in zip(python, binary, strict=True):
        for part, other in zip(people, rows, strict=True):
            numbers = [
                [
                    *(one["id"], one["name"], kinds.index(rvads.Kind(one["kind"])), one["crosswalk"], sides.index(one["side"])),
                    *(zones.index(one["zone"]), *(one[name] for name in list(one)[6:])),
                ]
                for one in part
            ]
            assert numbers == other
        assert [colours.index(colour) for colour in walks] == lights
        assert gap == same_gap
    gaps = {gap for *_, gap in python}
    assert 1000.0 in gaps
    assert len(gaps) > 10, "p1 walks over the lane of a1"


@pytest.mark.parametrize("client", ["c", "python"])
def test_client_that_does_not_ask_is_told_of_nobody(client: str, clients: dict[str, list[str]], tmp_path: Path) -> None:
    _, (head, *rows) = drive(clients[client], tmp_path / "out", "no")
    assert all(row == [[], [], [], 1000.0] for row in rows)
    assert head == [[], []] if client == "c" else "crosswalks" not in head["map"]


def test_gap_ends_at_the_crosswalk_while_somebody_is_in_the_lane_or_due() -> None:
    """The strip of the lane is 1 to 3 m from the near kerb of a crosswalk of 7 m, whose area begins 10 m ahead.

    Within 1 s somebody walks 1.4 m. The rear of a body is 0.6 m behind its front.
    """
    scenario = {
        "map": {
            "movements": [{"entrance": 0, "exit": 2, "turn": "straight"}],
            "crosswalks": [{"length": 7.0}],
            "covers": [{"crosswalk": 0, "movement": 0, "start": 2.0, "end": 5.0, "walk_start": 1.0, "walk_end": 3.0}],
        },
        "itinerary": {"entrance": 0, "exit": 2},
    }

    def gap(side: str, station: float, speed: float, me: float = -8.0) -> float:
        person = {"crosswalk": 0, "side": side, "station": station, "speed": speed, "length": 0.6}
        content = {"time": 0.0, "me": {"station": me}, "others": [], "lights": [], "step": 1, "pedestrians": [person]}
        return float(rvads_client.Observation(content, scenario, True, None).gap_to_pedestrians(1.0))

    free = float("inf")
    assert [gap("near", at, 1.4) for at in (-0.5, -0.3, 1.1, 3.5, 3.7)] == [free, 10.0, 10.0, 10.0, free]
    assert [gap("near", at, 0.0) for at in (0.9, 1.1, 3.5, 3.7)] == [free, 10.0, 10.0, free]
    assert [gap("near", at, -1.4) for at in (0.9, 1.1, 4.9, 5.1)] == [free, 10.0, 10.0, free]
    assert [gap("far", at, 1.4) for at in (2.5, 2.7, 6.5, 6.7)] == [free, 10.0, 10.0, free]
    assert [gap("near", 2.0, 1.4, me) for me in (1.0, 4.0, 6.0)] == [1.0, -2.0, free]


@pytest.mark.parametrize("example", ["c", "python"])
def test_examples_stop_for_a_pedestrian(example: str, compiled: Path) -> None:
    """p0 comes to the lane 1 s before a1, which drives straight on. Then p0 stops in the middle of the road."""
    command = [str(compiled)] if example == "c" else [sys.executable, str(ROOT / "clients" / "python" / "example.py")]
    place = zebra("yield4")
    for behaviour in ("steady", "stops"):
        walkers = [rvads.Pedestrian(1, "far", behaviour, -1.0)]
        scenario = rvads.Scenario(place, "0200", distance=25, speed=8, subject=1, pedestrians=walkers)
        with Process(command, timeout=60.0, startup=60.0) as stack:
            run = rvads.simulate(rvads.Case(scenario, stack))
        assert run.fault is None
        assert run.collisions == ()
        assert run.provenance["end"] == "left"


def test_hello_says_whether_the_stack_reads_pedestrians() -> None:
    assert messages.read(b'{"type":"hello","version":2}', messages.Hello).pedestrians is False
    assert messages.read(b'{"type":"hello","version":2,"pedestrians":true}', messages.Hello).pedestrians is True
    with pytest.raises(StackError, match="its hello is not as the protocol has it") as caught:
        messages.read(b'{"type":"hello","version":2,"pedestrians":"yes"}', messages.Hello)
    assert "\n" not in str(caught.value)

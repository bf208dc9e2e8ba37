"""What a stack is told: the same in JSON and in frames, vehicles that keep their number, and room for queues."""

import importlib
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.stacks import frames, messages
from pytest_rvads.drivers.stacks.child import StackError
from pytest_rvads.drivers.stacks.process import Process

ROOT = Path(__file__).parents[3]
sys.path.append(str(ROOT / "clients" / "python"))
rvads_client = importlib.import_module("rvads_client")
sys.path.pop()
DUMP = r"""
#include "rvads.h"
int main(int, char **arguments) {
    rvads link;
    rvads_observation seen;
    rvads_command command;
    FILE *out = fopen(arguments[1], "w");
    if (!rvads_open(&link, "dump", 20.0)) return 1;
    while (rvads_next(&link, &seen)) {
        const rvads_scenario &now = link.scenario;
        if (link.fresh) {
            fprintf(out, "[%u, %u, %u, %.17g, %.17g]\n", now.arms_count, now.entrance, now.exit, now.line, now.steering_rate);
            for (uint32_t k = 0; k < now.entrances_count; ++k)
                fprintf(out, "[%u, %u, %u, %d, %.17g, %.17g]\n", now.entrances[k].arm, now.entrances[k].lane,
                        now.entrances[k].sign, now.entrances[k].phase, now.entrances[k].setback, now.entrances[k].sign_setback);
            for (uint32_t k = 0; k < now.exits_count; ++k) fprintf(out, "[%u, %u]\n", now.exits[k].arm, now.exits[k].lane);
            for (uint32_t i = 0; i < now.entrances_count; ++i)
                for (uint32_t k = 0; k < now.entrances_count; ++k)
                    fprintf(out, "[%d, %d]\n", now.right_of[i][k], now.opposite[i][k]);
            for (uint32_t k = 0; k < now.movements_count; ++k)
                fprintf(out, "[%u, %u, %u, %.17g]\n", link.movements[k].entrance, link.movements[k].exit, link.movements[k].turn,
                        link.movements[k].length);
            for (uint32_t k = 0; k < now.conflicts_count; ++k)
                fprintf(out, "[%u, %u]\n", link.conflicts[k].one, link.conflicts[k].other);
            for (uint32_t k = 0; k < now.yields_count; ++k)
                fprintf(out, "[%u, %u, %u]\n", link.yields[k].one, link.yields[k].other, link.yields[k].reason);
            const rvads_point &last = link.path[now.path_count - 1];
            fprintf(out, "[%.17g, %.17g, %.17g, %.17g]\n%s\n", last.station, last.x, last.y, last.heading, link.text);
        }
        for (uint32_t k = 0; k <= seen.others_count; ++k) {
            const rvads_vehicle &one = k ? seen.others[k - 1] : seen.me;
            fprintf(out, "[%u, %u, %u, %u, %u, %u, %.17g, %.17g, \"%s\"]\n", one.id, one.kind, one.entrance, one.lane, one.turn,
                    one.zone, one.station, one.width, one.name);
            fprintf(out, "[%d, %d]\n", rvads_conflicts_with(&link, &one), rvads_gives_way_to(&link, &one));
        }
        fprintf(out, "[%.17g]\n", rvads_gap_ahead(&seen));
        fprintf(out, "[%.17g, %u, %u]\n", seen.time, seen.entrances_count, seen.lights[0]);
        fflush(out);
        rvads_target_speed(&command, 5.0);
        rvads_answer(&link, &command);
    }
}
"""
LIMITS = r"""
#include "rvads.h"
int main(int, char **arguments) {
    rvads link;
    rvads_observation seen;
    rvads_command command;
    if (!rvads_open(&link, "limits", 20.0)) return 1;
    while (rvads_next(&link, &seen)) {
        const double limits[] = {ASKED};
        if (link.fresh) {
            FILE *out = fopen(arguments[1], "w");
            fprintf(out, "[%.17g", limits[0]);
            for (size_t k = 1; k < sizeof limits / sizeof limits[0]; ++k) fprintf(out, ", %.17g", limits[k]);
            fprintf(out, "]");
            fclose(out);
        }
        rvads_target_speed(&command, 5.0);
        rvads_answer(&link, &command);
    }
}
"""
TURNS, SIGNS, ZONES = ("right", "straight", "left"), ("none", "stop", "yield", "priority", "lights"), messages._ZONES


class Spy(rvads.Reference):
    """Keeps what it sees."""

    def __init__(self) -> None:
        super().__init__()
        SEEN.clear()

    def control(self, seen: rvads.Observation) -> rvads.Control:
        SEEN.append(seen)
        return super().control(seen)


SEEN: list[rvads.Observation] = []


def look(junction: str = "stop4", directions: Any = "1133", **more: Any) -> list[rvads.Observation]:
    rvads.simulate(
        rvads.Case(rvads.Scenario(rvads.find(junction), directions, distance=20, subject=0, **more), Spy, traffic=rvads.Reference)
    )
    return list(SEEN)


def told(seen: list[rvads.Observation]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the content of the reset, and the observations, as the format json has them."""
    talk = messages.Json()
    content = json.loads(talk.begin(messages.reset(seen[0], 0.05)))
    return content, [json.loads(talk.observe(one, step)) for step, one in enumerate(seen, 1)]


@pytest.mark.parametrize(
    ("junction", "directions", "followers"), [("stop4", "1133", 0), ("light3", "112", 0), ("lanes4", (1, 3, 2, 3, 1, 3, 2, 3), 1)]
)
def test_c_reads_what_json_says(tmp_path: Path, junction: str, directions: Any, followers: int) -> None:
    if shutil.which("g++") is None:
        pytest.skip("needs g++")
    (tmp_path / "dump.cpp").write_text(DUMP, encoding="utf-8")
    flags = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", f"-I{ROOT / 'clients' / 'c'}"]
    subprocess.run(["g++", *flags, "-o", str(tmp_path / "dump"), str(tmp_path / "dump.cpp")], check=True)
    more: dict[str, Any] = {"duration": 0.3, "followers": followers}
    with Process([str(tmp_path / "dump"), str(tmp_path / "out")]) as stack:
        scenario = rvads.Scenario(rvads.find(junction), directions, distance=20, subject=0, **more)
        assert rvads.simulate(rvads.Case(scenario, stack, traffic=rvads.Reference)).fault is None
    content, observed = told(look(junction, directions, **more)[:1])
    way, there = content["itinerary"], content["map"]
    numbers = range(len(there["entrances"]))
    expected: list[Any] = [[len(there["arms"]), way["entrance"], way["exit"], way["line"], content["vehicle"]["steering_rate"]]]
    for e in there["entrances"]:
        phase, back = (-1 if e["phase"] is None else e["phase"]), e["setback"]
        posted = back if e["sign_setback"] is None else e["sign_setback"]
        expected.append([e["arm"], e["lane"], SIGNS.index(e["sign"]), phase, back, posted])
    expected += [[e["arm"], e["lane"]] for e in there["exits"]]
    expected += [[int([i, k] in there[name]) for name in ("right_of", "opposite")] for i in numbers for k in numbers]
    expected += [[m["entrance"], m["exit"], TURNS.index(m["turn"]), m["length"]] for m in there["movements"]]
    reasons = map(("stated", "sign", "turn", "right", "merge", "undecided").index, there["reasons"])
    expected += [*there["conflicts"], *([*pair, reason] for pair, reason in zip(there["yields"], reasons, strict=True))]
    expected += [way["path"][-1], content]
    python = rvads_client.Observation(observed[0], content, True, None)
    for one in [observed[0]["me"], *observed[0]["others"]]:
        words = TURNS.index(one["turn"]), ZONES.index(one["zone"])
        expected.append([one["id"], 0, one["entrance"], one["lane"], *words, one["station"], one["width"], one["name"]])
        expected.append([int(python.conflicts_with(one)), int(python.gives_way_to(one))])
    expected.append([min(python.gap_ahead(), 1000.0)])
    expected.append([observed[0]["time"], len(numbers), messages._COLOURS.index(observed[0]["lights"][0])])
    lines = [json.loads(line) for line in (tmp_path / "out").read_text(encoding="utf-8").splitlines()]
    assert lines[: len(expected)] == expected


def test_clients_tell_who_is_in_the_way() -> None:
    """At lanes4 a0.0 turns right: in its way is only who turns left from the arm across, and it has the way there."""
    content, (seen, *_) = told(look("lanes4", (1, 3, 2, 3, 2, 3, 2, 3), followers=1, duration=0.02))
    mine = rvads_client.Observation(seen, content, True, None)
    assert [one["name"] for one in (mine.me, *mine.others)][:4] == ["a0.0", "a0.0+1", "a0.1", "a0.1+1"]
    # Into the lane out of arm 1 lead a0.0 from its right, a2.1 from its left, and a3.0 straight on.
    assert {one["name"] for one in mine.others if mine.conflicts_with(one)} == {"a2.1", "a2.1+1", "a3.0", "a3.0+1"}
    assert not any(map(mine.gives_way_to, mine.others))
    assert mine.gap_ahead() == float("inf"), "it is the first"
    leader = dict(mine.me, station=mine.me["station"] + 10.0)
    behind = rvads_client.Observation(seen | {"others": [leader]}, content, False, None)
    assert behind.gap_ahead() == pytest.approx(10.0 - leader["length"])
    assert (
        behind.gap_ahead()
        > rvads_client.Observation(
            seen | {"others": [leader, dict(leader, station=leader["station"] - 2.0)]}, content, False, None
        ).gap_ahead()
    )


def test_names_longer_than_a_frame_has_room_for_are_cut() -> None:
    seen = look(duration=0.02)[0]
    talk = frames.Binary()
    talk.begin(messages.reset(seen, 0.05))
    for name, shown in (("a0.1+1", "a0.1+1"), ("x" * 40, "x" * 23), ("\ud800", "?")):
        frame = talk.observe(seen._replace(me=replace_state(seen.me, name=name), others=()), 1)
        assert frame[-frames.NAME - 32 * 4 : -32 * 4].rstrip(b"\0").decode() == shown


def test_map_message_holds_arms_and_conflicts() -> None:
    content, _ = told(look(duration=0.02))
    there = content["map"]
    assert there["arms"] == [{"entrances": [k], "exits": [k]} for k in range(4)]
    assert [(e["arm"], e["lane"], e["sign"]) for e in there["entrances"]] == [(k, 0, "stop") for k in range(4)]
    assert {e["phase"] for e in there["entrances"]} == {None}
    lit, _ = told(look("light3", "112", duration=0.02))
    assert [e["phase"] for e in lit["map"]["entrances"]] == [e.phase for e in rvads.find("light3").entrances] != [None] * 3
    ways = [(m["entrance"], m["exit"]) for m in there["movements"]]
    pairs = {(ways[one], ways[other]) for one, other in there["conflicts"]}
    assert ((0, 2), (1, 3)) in pairs, "two that go straight on cross"
    assert ((0, 2), (2, 0)) not in pairs, "opposite ones pass"
    assert {(b, a) for a, b in pairs} == pairs


def test_a_vehicle_keeps_its_number_while_others_come_and_go() -> None:
    seen = look()[0]
    behind = replace_state(seen.others[0], name="a1+1")
    talk = messages.Json()
    talk.begin(messages.reset(seen, 0.05))

    def ids(others: tuple[rvads.values.VehicleState, ...]) -> list[int]:
        content = json.loads(talk.observe(seen._replace(others=others), 1))
        assert {one["kind"] for one in (content["me"], *content["others"])} == {"car"}
        return [one["id"] for one in (content["me"], *content["others"])]

    first, second, third = seen.others
    assert ids((first, third)) == [0, 1, 2]
    assert ids((first, behind, second, third)) == [0, 1, 3, 4, 2], "two of one entrance are told apart"
    assert ids((behind,)) == [0, 3]
    talk.begin(messages.reset(seen, 0.05))
    assert ids((third,)) == [0, 1], "numbers begin anew with every scenario"


def replace_state(state: rvads.values.VehicleState, **values: Any) -> rvads.values.VehicleState:
    return state._replace(**values)


def test_binary_frame_refuses_more_vehicles_than_its_room() -> None:
    seen = look()[0]
    talk = frames.Binary()
    content = messages.reset(seen, 0.05)
    talk.begin(content)
    crowd = tuple(replace_state(seen.others[0], name=f"a1+{k}") for k in range(64))
    assert len(talk.observe(seen._replace(others=crowd[:63]), 1)) > len(talk.observe(seen, 1))
    with pytest.raises(StackError, match="there are 64 other vehicles, a binary frame has room for 63: let the stack say"):
        talk.observe(seen._replace(others=crowd), 1)
    content["map"] = content["map"] | {"entrances": content["map"]["entrances"] * 9}
    with pytest.raises(StackError, match="the junction has 36 entrances and 4 exits, a binary frame has room for 32"):
        frames.Binary().begin(content)


@pytest.mark.extended
def test_every_format_tells_the_speed_limits_of_the_way(tmp_path: Path) -> None:
    if shutil.which("g++") is None:
        pytest.skip("needs g++")
    light = rvads.find("light4")
    stated = ((0.0, 20.0), (70.0, 8.0), (110.0, None))  # 120 m of approach
    lanes = tuple(replace(lane, approach=replace(light.way_in(k), limits=stated)) for k, lane in enumerate(light.entrances))
    case = rvads.Case(rvads.Scenario(replace(light, entrances=lanes), "2000", distance=119, duration=0.1), Spy)
    rvads.simulate(case)
    scenario = json.loads(json.dumps(messages.reset(SEEN[0], 0.05)))
    assert scenario["speed_limit"] == 20.0, "where the vehicle starts: what stacks knew before"
    assert [*chain(*scenario["itinerary"]["speed_limits"])] == pytest.approx([-120.0, 20.0, -50.0, 8.0, -10.0, 11.176])
    stations = (-500.0, -50.1, -49.9, -10.1, -9.9, 60.0)
    wanted = [20.0, 20.0, 8.0, 8.0, 11.176, 11.176]
    assert [rvads_client.limit_at(scenario, station) for station in stations] == wanted
    asked = ", ".join(f"rvads_limit_at(&link, {station})" for station in stations)
    (tmp_path / "limits.cpp").write_text(LIMITS.replace("ASKED", asked), encoding="utf-8")
    include = f"-I{ROOT / 'clients' / 'c'}"
    subprocess.run(["g++", "-Wall", "-Werror", include, "-o", tmp_path / "limits", tmp_path / "limits.cpp"], check=True)
    with Process([str(tmp_path / "limits"), str(tmp_path / "out")]) as stack:
        assert rvads.simulate(rvads.Case(case.scenario, stack)).fault is None
    assert json.loads((tmp_path / "out").read_text(encoding="utf-8")) == wanted

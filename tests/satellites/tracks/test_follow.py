"""``rvads check --follow``: verdicts on traffic that is still being recorded."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.tracks.importing import Intake
from pytest_rvads.satellites.tracks.streaming import GONE_AFTER, LONGEST, Stream
from pytest_rvads.support.errors import RunError

RVADS = str(Path(sys.executable).with_name("rvads"))
FOLLOW = [RVADS, "check", "--follow", "--junction", "stop4", "--rules", "full_stop", "--rules", "p1"]

# The reckless one drives on at 8 m/s and is at the vertex after 5 s; the careful one stands 0.5 m before it from 4 s to 11 s.
RECKLESS, CAREFUL = (0, 2), (2, 0)


def place(name: str, age: float) -> dict[str, Any]:
    """Return what is seen of a vehicle, this long after it appeared, without its speed."""
    entrance, exit = RECKLESS if name.startswith("reckless") else CAREFUL
    way = itinerary(find("stop4"), entrance, exit)
    moving = age if name.startswith("reckless") else min(age, 4.0) + max(age - 11.0, 0.0)
    x, y, heading = way.pose(-40.0 + 8.0 * moving if name.startswith("reckless") else -28.5 + 7.0 * moving)
    return {"id": name, "x": x, "y": y, "heading": heading, "length": 4.6, "width": 1.8}


def log(begins: dict[str, float], until: float, step: float = 0.1) -> list[str]:
    """Return lines of vehicles that appear at these times and are seen for 12 s, or 18 s where they stop."""
    lines = []
    for k in range(round(until / step)):
        now = k * step
        ages = {name: now - begin for name, begin in begins.items()}
        seen = [place(n, age) for n, age in ages.items() if 0.0 <= age <= (8.0 if n.startswith("reckless") else 16.0)]
        lines.append(json.dumps({"t": round(100.0 + now, 3), "vehicles": seen}))
    return lines


def judge(lines: Sequence[str], *options: str, status: int) -> tuple[list[dict[str, Any]], str]:
    """Return what is told about lines on standard input, and what is said beside it."""
    text = "\n".join(lines).encode() + b"\n"
    ended = subprocess.run([*FOLLOW, *options, "-"], input=text, capture_output=True, timeout=60, check=False)
    assert ended.returncode == status, ended.stderr.decode()
    return [json.loads(line) for line in ended.stdout.splitlines()], ended.stderr.decode()


@pytest.mark.extended
def test_followed_log_fails_the_reckless_vehicle() -> None:
    told, beside = judge(log({"reckless": 0.0, "careful": 0.0}, 18.0), status=1)
    stops = {answer["binding"]["a"]: answer for answer in told if answer["rule"] == "full_stop"}
    assert {name: answer["status"] for name, answer in stops.items()} == {"reckless": "FAIL", "careful": "PASS"}
    # It is at the vertex 40 m / 8 m/s after it appeared, on the clock of the log; the first state beyond is a hundredth later.
    assert stops["reckless"]["time"] == pytest.approx(105.01, abs=0.011)
    # It has left the junction long before the careful one enters after 11 s.
    assert [answer["status"] for answer in told if answer["rule"] == "p1"] == ["PASS"]
    assert "2 vehicles: 1 FAIL, 2 PASS" in beside


@pytest.mark.extended
def test_at_half_the_rate_and_at_unequal_times_it_is_the_same() -> None:
    lines = log({"reckless": 0.0, "careful": 0.0}, 18.0)
    thinned = [line for k, line in enumerate(lines) if k % 5 not in (1, 2)]
    told, _ = judge(thinned, status=1)
    assert {(a["rule"], a["status"]) for a in told} == {("full_stop", "FAIL"), ("full_stop", "PASS"), ("p1", "PASS")}


def test_followed_log_of_unsure_verdicts_is_no_success() -> None:
    # 3 m leave open whether it stood before the line or rolled, and a speed that is worked out from such places is as vague.
    told, beside = judge(log({"careful": 0.0}, 18.0), "--accuracy", "3", status=5)
    assert {answer["status"] for answer in told} == {"UNSURE"}
    assert "every verdict that applies is UNSURE" in beside


@pytest.mark.extended
def test_bad_lines_are_told_and_left_out() -> None:
    lines = log({"reckless": 0.0}, 12.0)
    lines[3:3] = [
        "{",
        '{"t": 100.25, "vehicles": [{"id": "x", "x": "east"}]}',
        '{"t": 90}',
        '{"t": 100.26, "lights": {"9": "red"}}',
    ]
    told, beside = judge(lines, status=1)
    assert [answer["status"] for answer in told] == ["FAIL"]
    assert "standard input, line 4: not JSON" in beside
    assert "standard input, line 5: the field 'vehicles[0].x' must be a number" in beside
    assert "standard input, line 6: the time must be later than" in beside
    assert "standard input, line 7: the name of a light must be of 0, 1, 2, 3, entrance 0," in beside
    _, beside = judge(lines, "--strict", status=2)
    assert "line 4: not JSON" in beside


def test_of_many_bad_lines_the_first_are_told_and_then_their_number() -> None:
    _, beside = judge(["{"] * 500, status=5)
    assert beside.count("not JSON") == 20
    assert "500 lines are left out" in beside


def test_followed_log_without_verdicts_is_no_success() -> None:
    told, beside = judge(['{"t": 1}', '{"t": 2, "vehicles": [{"id": "x", "x": 900, "y": 900, "heading": 0}]}'], status=5)
    assert told == []
    assert "1 left out, it never comes near the junction" in beside
    assert "nothing was judged" in beside


@pytest.mark.extended
def test_a_growing_file_is_followed_until_ctrl_c(tmp_path: Path) -> None:
    lines = log({"reckless-1": 0.0, "reckless-2": 20.0}, 25.0)
    file = tmp_path / "states.jsonl"
    file.write_text("".join(f"{line}\n" for line in lines[:150]), encoding="utf-8")
    bounded = partial(signal.alarm, 60)  # it would follow the file for ever
    with subprocess.Popen(
        [*FOLLOW, str(file)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=bounded
    ) as running:
        assert running.stdout is not None
        first = json.loads(running.stdout.readline())
        assert (first["binding"]["a"], first["status"]) == ("reckless-1", "FAIL"), "told while the file still grows"
        with file.open("a", encoding="utf-8") as more:
            more.write("".join(f"{line}\n" for line in lines[150:-1]) + lines[-1][:20])
            more.flush()
            time.sleep(0.5)
            more.write(lines[-1][20:] + "\n")
        time.sleep(1.0)
        running.send_signal(signal.SIGINT)
        rest, beside = running.communicate(timeout=30)
    # Was at the vertex at 125.0 s, the file ends at 124.9 s; its last line was written in two parts.
    assert [json.loads(line)["status"] for line in rest.splitlines()] == []
    assert "interrupted" in beside
    assert "2 vehicles" in beside
    assert running.returncode == 1


def test_lights_hold_until_they_change() -> None:
    stream = Stream("log", find("light4"))
    junction = find("light4")
    way = itinerary(junction, *min(junction.movements))
    runs: list[Run] = []
    for k in range(120):
        x, y, heading = way.pose(-30.0 + 0.5 * k)
        lights = {0: {"0": "green"}, 40: {"0": "red", "1": "green"}}.get(k, {})
        seen = [{"id": "a", "x": x, "y": y, "heading": heading}]
        state = {"t": round(k * 0.1, 1), "vehicles": seen, "lights": lights}
        runs += stream.read(json.dumps(state).encode(), "here")
    runs += stream.end()
    (run,) = runs
    changes = [(round(run.start + k * run.dt, 2), run.lights[k].tolist()) for k in (0, 399, 400, run.steps - 1)]
    assert [colours for _, colours in changes] == [[1, 0, 0, 0], [1, 0, 0, 0], [3, 1, 0, 0], [3, 1, 0, 0]]


def test_standing_vehicle_does_not_delay_verdicts() -> None:
    stream, junction = Stream("log", find("stop4")), find("stop4")
    way = itinerary(junction, *RECKLESS)
    x, y, heading = way.pose(-80.0)
    kept = []
    for k in range(int(LONGEST) * 4):
        seen = [{"id": "parked", "x": x + 50.0, "y": y + 50.0, "heading": heading}]
        if k % 30 < 12:
            seen.append(place(f"reckless-{k // 30}", float(k % 30)))
        list(stream.read(json.dumps({"t": float(k), "vehicles": seen}).encode(), "here"))
        kept.append(sum(len(s.times) for s in (*stream._departed, *stream._present.values())))
    assert stream.judged >= 0.5 * LONGEST * 4 / 30
    assert max(kept) <= 3 * (LONGEST + GONE_AFTER)


def test_memory_is_bounded_beside_a_standing_vehicle() -> None:
    stream = Stream("log", find("stop4"))
    x, y, heading = itinerary(find("stop4"), *RECKLESS).pose(-80.0)
    for k in range(int(LONGEST) * 4):
        seen = [{"id": "parked", "x": x + 50.0, "y": y + 50.0, "heading": heading}, *([place("reckless", k)] if k < 9 else [])]
        list(stream.read(json.dumps({"t": float(k), "vehicles": seen, "lights": {"0": "red"}}).encode(), "here"))
        assert stream.judged == 1 or k < LONGEST + 20.0
    assert len(stream._present["parked"].times) <= 2 * LONGEST + 20.0
    assert len(stream._lights["0"]) <= 2 * LONGEST + 20.0


def test_two_of_one_name_are_refused() -> None:
    stream = Stream("log", find("stop4"))
    twice = [place("careful", 0.0)] * 2
    with pytest.raises(RunError, match="here: two vehicles have the same id"):
        list(stream.read(json.dumps({"t": 0.0, "vehicles": twice}).encode(), "here"))


def test_clock_may_count_from_1970() -> None:
    stream = Stream("drive", find("stop4"), Intake("center"))
    runs: list[Run] = []
    for line in log({"reckless": 0.0}, 12.0):
        state = json.loads(line) | {"t": json.loads(line)["t"] + 1.7e9}
        runs += stream.read(json.dumps(state).encode(), "line")
    runs += stream.end()
    (run,) = runs
    assert run.start == pytest.approx(1.7e9 + 100.0, abs=0.011)

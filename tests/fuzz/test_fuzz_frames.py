"""Messages between us and a stack, damaged on their way, in both directions and both formats.

What comes from a stack is a command, or an error of that stack; what a client reads leaves it whole, or ends it in a sentence.
"""

import json
import math
import os
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.drivers.stacks import frames, messages
from pytest_rvads.drivers.stacks.child import Child, StackError
from pytest_rvads.drivers.stacks.process import Connection
from pytest_rvads.runs.run import Halt
from pytest_rvads.simulators.seat import Seat

from .mutations import LONG, QUICK, damaged

CLIENTS = Path(__file__).parents[2] / "clients"
FEW = settings(QUICK, max_examples=40 * LONG)
"""Each is a process."""
TALKS: dict[str, Callable[[], messages.Format]] = {"json": messages.Json, "binary": frames.Binary}


SCENARIO = rvads.Scenario(rvads.find("stop4"), "1133", distance=20, duration=0.02)


class Says:
    """An autopilot that gives one command, and keeps what it sees."""

    def __init__(self, command: Any) -> None:
        self._command = command
        self.seen: list[rvads.Observation] = []

    def control(self, seen: rvads.Observation) -> Any:
        self.seen.append(seen)
        return self._command


@cache
def observation() -> rvads.Observation:
    made = [Says(rvads.Control()) for _ in range(4)]
    vacant = iter(made)
    rvads.simulate(rvads.Case(SCENARIO, lambda: next(vacant)))
    return made[0].seen[0]


@cache
def told(form: str) -> tuple[bytes, bytes, bytes]:
    """Return reset, observe and bye."""
    talk = TALKS[form]()
    return talk.begin(messages.reset(observation(), 0.05)), talk.observe(observation(), 1), talk.bye


def answered(**command: Any) -> bytes:
    """Return what the client in Python sends."""
    return json.dumps({**command, "type": "command", "step": 1, "compute": 1e-06}).encode() + b"\n"


def framed(kind: int, count: int, *values: float) -> bytes:
    """Return what the client in C sends."""
    points = struct.pack("<192d", *(float(k) for k in range(192)))
    return frames.HEADER.pack(frames.COMMAND, 48 + len(points)) + struct.pack("<4I4d", kind, count, 1, 0, *values, 1e-6) + points


HELLO = '{"type":"hello","version":2,"name":"fuzz","format":"%s","rate":20}\n'
ANSWERS = {
    "json": [
        answered(throttle=0.5, brake=0.0, steering=0.1),
        answered(target_speed=5.0),
        answered(acceleration=1.0, steering=0.1),
        answered(trajectory=[(0.0, 1.0, 2.0), (1.0, 2.0, 3.0)]),
    ],
    "binary": [framed(kind, count, 0.5, 0.1, 0.1) for kind, count in ((0, 0), (1, 0), (2, 0), (3, 0), (4, 64))],
}


class Scripted(Child):
    """Answers every message with the next piece of what is prepared, and then has ended."""

    def __init__(self, pieces: list[bytes]) -> None:
        self._buffer, self._pieces = bytearray(), pieces

    def send(self, data: bytes, limit: float) -> None:
        self._buffer += self._pieces.pop(0) if self._pieces else b""

    def pending(self) -> bytes:
        return bytes(self._buffer)

    def tail(self) -> str:
        return ""

    def close(self, farewell: bytes = b"") -> None:
        self._pieces.clear()

    def _fill(self, deadline: float, limit: float) -> None:
        raise StackError("it exited with status 0 before it answered")


@st.composite
def conversations(draw: st.DrawFn, form: str) -> list[bytes]:
    ready = frames.HEADER.pack(frames.READY, 0) if form == "binary" else b'{"type":"ready"}\n'
    pieces = [(HELLO % form).encode(), ready, draw(st.sampled_from(ANSWERS[form]))]
    hurt = draw(st.sampled_from((0, 1, 2, 2, 2)))
    pieces[hurt] = draw(damaged(pieces[hurt]) | overwritten(pieces[hurt]))
    return pieces


@st.composite
def overwritten(draw: st.DrawFn, seed: bytes) -> bytes:
    """Draw a message in which some numbers of a frame are others: counts, sizes, indices, values that are not finite."""
    data = bytearray(seed)
    for _ in range(draw(st.integers(1, 3))):
        at = 4 * draw(st.integers(0, 30) | st.integers(0, max(len(data) - 8, 0) // 4))
        words = st.sampled_from((0, 1, 4, 5, 31, 32, 33, 63, 64, 65, 2**31, 2**32 - 1)).map(struct.Struct("<I").pack)
        reals = st.sampled_from((-1.0, 1e308, float("nan"), float("inf"))).map(struct.Struct("<d").pack)
        word = draw(words | reals)
        data[at : at + len(word)] = word
    return bytes(data)


@pytest.mark.parametrize("form", TALKS)
@QUICK
@given(data=st.data())
def test_stack_output_is_a_command_or_a_stack_error(form: str, data: st.DataObject) -> None:
    pieces = data.draw(conversations(form))
    try:
        connection = Connection(lambda: Scripted(pieces), 1.0, 1.0)
        connection.reset(messages.reset(observation(), 0.05))
        command, compute = connection.ask(observation())
        driven = Seat(rvads.Case(SCENARIO, rvads.Reference).agents()[0], Says(command)).command(0, observation())
    except (StackError, Halt) as error:
        said = str(error)
    else:
        said = ""
        assert 0.0 <= compute <= 86400.0
        assert all(map(math.isfinite, driven))
    assert len(said) < 1500
    assert said.isprintable()


READER = r"""
#include "rvads.h"
int main(void) {
    rvads link;
    rvads_observation seen;
    rvads_command command;
    volatile double sum = 0;
    if (!rvads_open(&link, "fuzz \"\\", 20.0)) return 0;
    while (rvads_next(&link, &seen)) {
        const rvads_scenario *now = &link.scenario;
        uint32_t k;
        for (k = 0; k < now->entrances_count; ++k) sum += now->entrances[k].setback + now->right_of[k][now->entrance];
        for (k = 0; k < now->exits_count; ++k) sum += now->exits[k].lane;
        for (k = 0; k < now->movements_count; ++k) sum += now->entrances[link.movements[k].entrance].setback;
        for (k = 0; k < now->conflicts_count; ++k) sum += link.movements[link.conflicts[k].one].length + link.conflicts[k].other;
        for (k = 0; k < now->yields_count; ++k) sum += link.movements[link.yields[k].other].length;
        for (k = 0; k < now->path_count; ++k) sum += link.path[k].x;
        sum += (double)strlen(link.text) + now->exits[now->exit].arm + seen.lights[seen.me.entrance];
        for (k = 0; k < seen.others_count; ++k) sum += now->opposite[seen.others[k].entrance][seen.me.entrance];
        rvads_target_speed(&command, rvads_stopping_speed(now->line - seen.me.station, 2.0));
        rvads_answer(&link, &command);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile a stack that uses all that the C client gives it, with what watches its memory."""
    if shutil.which("gcc") is None:
        pytest.skip("needs gcc")
    folder = tmp_path_factory.mktemp("reader")
    (folder / "reader.c").write_text(READER, encoding="utf-8")
    flags = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", f"-I{CLIENTS / 'c'}"]
    built = subprocess.run(["gcc", *flags, "-o", "reader", "reader.c"], cwd=folder, capture_output=True, text=True, check=False)
    if "sanitize" in built.stderr or "asan" in built.stderr:
        pytest.skip("needs the sanitizers of gcc")
    assert built.returncode == 0, built.stderr
    return folder / "reader"


def fed(command: list[str], data: bytes) -> tuple[int, str]:
    """Return how a client ends that reads this, and what it says."""
    watch = "max_allocation_size_mb=256:allocator_may_return_null=1:detect_leaks=0"
    env = {**os.environ, "ASAN_OPTIONS": watch, "UBSAN_OPTIONS": "print_stacktrace=1"}
    done = subprocess.run(
        command, input=data, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=env, timeout=60, check=False
    )
    return done.returncode, done.stderr.decode(errors="replace")


@pytest.mark.extended
@pytest.mark.parametrize("hurt", ["reset", "observe"])
@FEW
@given(data=st.data())
def test_the_client_in_c_reads_within_bounds(reader: Path, hurt: str, data: st.DataObject) -> None:
    pieces = list(told("binary"))
    number = ("reset", "observe").index(hurt)
    pieces[number] = data.draw(overwritten(pieces[number]) | damaged(pieces[number]))
    status, says = fed([str(reader)], messages.hello() + b"".join(pieces))
    said = [
        line
        for line in says.splitlines()
        if not line.startswith("rvads: ") and "WARNING: AddressSanitizer failed to allocate" not in line
    ]
    assert (status, said) == (0, [])


def test_the_client_in_c_reads_what_is_whole(reader: Path) -> None:
    assert fed([str(reader)], messages.hello() + b"".join(told("binary"))) == (0, "")


@pytest.mark.extended
@FEW
@given(data=st.data())
def test_the_client_in_python_ends_in_a_sentence(data: st.DataObject) -> None:
    pieces = [messages.hello(), *told("json")]
    number = data.draw(st.sampled_from((0, 1, 2)))
    pieces[number] = data.draw(damaged(pieces[number]))
    script = f"import sys; sys.path.insert(0, {str(CLIENTS / 'python')!r}); import rvads_client\n"
    script += "for seen in rvads_client.connect('fuzz', rate=20): seen.answer(target_speed=5.0)"
    status, says = fed([sys.executable, "-I", "-S", "-c", script], b"".join(pieces))
    assert (status, says) == (0, "") or (status == 1 and says.startswith("rvads: ") and says.count("\n") == 1)

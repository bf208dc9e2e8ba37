"""The end of a stack: all that it started ends with it, in bounded time, and what can't be found is said."""

import fcntl
import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from pytest_rvads.drivers.stacks import descendants
from pytest_rvads.drivers.stacks.child import Child
from pytest_rvads.drivers.stacks.process import Process
from pytest_rvads.geometry.finder import find
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate

from .conftest import CLINGING, Find, wait_for

SCENARIO = Scenario(find("stop4"), "2000", distance=20, speed=5, duration=0.1)
Cling = Callable[..., Process]


@pytest.fixture
def tag(tmp_path: Path) -> str:
    return str(tmp_path / "tag")


@pytest.fixture
def cling(tag: str) -> Cling:
    """Return a function that makes a stack which clings to life, and has it drive."""

    def make(how: str, grace: float = 0.3) -> Process:
        stack = Process([sys.executable, "-I", "-S", str(CLINGING), how, tag], timeout=60.0, startup=60.0, grace=grace)
        assert simulate(Case(SCENARIO, stack)).fault is None
        return stack

    return make


def free(tag: str) -> bool:
    """Tell whether nobody holds the lock; who is always another is on no list of processes for long."""
    with open(tag, "w", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="elsewhere only the process group is known")


@linux
@pytest.mark.parametrize(
    "how",
    [
        "leaves sessions",
        "leaves stubborn sessions",
        "leaves a daemon",
        "leaves a daemon that holds the pipes",
        "leaves a child without environment",
        "leaves who is always another",
        "ignores bye",
        "ignores SIGTERM",
        "is stopped",
    ],
)
def test_processes_of_a_stack_end_with_the_stack(cling: Cling, marked: Find, tag: str, how: str) -> None:
    stack = cling(how)
    began = time.monotonic()
    stack.close()
    assert time.monotonic() - began < 10.0
    assert marked(tag) == []
    assert wait_for(lambda: free(tag), 5.0)


@linux
def test_nor_where_the_stack_fails(cling: Cling, marked: Find, tag: str) -> None:
    stack = cling("leaves stubborn sessions")
    assert len(marked(tag)) == 5
    stack.drop(stack.connections[0])
    assert marked(tag) == []


def test_a_stack_may_end_in_its_own_way(cling: Cling, tag: str) -> None:
    stack = cling("ends by SIGTERM", grace=20.0)
    stack.drop(stack.connections[0])
    assert Path(tag).read_text(encoding="utf-8") == "SIGTERM"


def test_a_stack_that_drove_can_be_sent_to_another_process(cling: Cling) -> None:
    stack = cling("ends by SIGTERM")
    stack.close()
    assert pickle.loads(pickle.dumps(stack)).command == stack.command


@pytest.mark.extended
@linux
def test_hidden_process_of_a_stack_is_warned_about(cling: Cling, marked: Find, tag: str) -> None:
    stack = cling("hides")
    with pytest.warns(RuntimeWarning, match="a process that the stack .* started holds its standard output and can't be found"):
        stack.close()
    (hidden,) = marked(tag)
    os.kill(hidden, 9)


@pytest.mark.extended
@linux
def test_what_can_t_be_ended_is_said(cling: Cling, monkeypatch: pytest.MonkeyPatch) -> None:
    stack = cling("ignores bye")
    process = stack.connections[0].child._process
    with monkeypatch.context() as immortal:
        immortal.setattr(descendants, "_PATIENCE", 0.1)
        immortal.setattr("os.kill", lambda *_: None)
        with pytest.warns(
            RuntimeWarning, match=rf"the processes \[{process.pid}\] of the stack .* can't be ended: end them by hand"
        ):
            stack.close()
    process.kill()
    process.wait()


def test_interrupted_close_leaves_no_process(cling: Cling, marked: Find, tag: str, monkeypatch: pytest.MonkeyPatch) -> None:
    stack = cling("ignores SIGTERM", grace=600.0)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Child, "_exited", interrupted)
    with pytest.raises(KeyboardInterrupt):
        stack.close()
    assert marked(tag) == []


def test_endless_standard_error_keeps_nobody_waiting_and_is_forgotten_but_for_its_end() -> None:
    before = set(threading.enumerate())
    child = Child(["sh", "-c", "head -c 100000000 /dev/zero >&2; printf 'last\\033[2J words' >&2; echo done; exec sleep 50"])
    assert child.line(60.0) == b"done"
    assert child.tail().endswith(r"\x00last\x1b[2J words")
    assert len(child.tail()) < 20_000
    child.close()
    assert child.tail().endswith("words"), "it is remembered"
    assert set(threading.enumerate()) <= before, "of earlier threads some may have ended"


KILLED = """
import os, sys
from pytest_rvads.drivers.stacks.child import Child
from pytest_rvads.drivers.stacks.descendants import Guard
guard = Guard()
first = Child([sys.executable, "-I", "-S", *sys.argv[1:]], grace=0.1, guard=guard)
first.send(b'{"type": "hello"}\\n', 60.0)
first.line(60.0)
guard._process.kill()
guard._process.wait()
second = Child(["sleep", "50"], guard=guard)
print(flush=True)
sys.stdin.read()
"""


@pytest.mark.extended
@linux
def test_nothing_outlives_us_when_we_are_killed_and_a_guard_was_before(marked: Find, tag: str) -> None:
    command = [sys.executable, "-c", KILLED, str(CLINGING), "leaves stubborn sessions", tag]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as session:
        assert session.stdout.readline() == b"\n"
        assert len(marked(tag)) == 6
        session.kill()
    assert wait_for(lambda: not marked(tag), 20.0)


LEFT_OPEN = """
import sys
from pytest_rvads.drivers.stacks.process import Process
stack = Process([sys.executable, "-I", "-S", *sys.argv[1:]], timeout=60.0, startup=60.0, grace=0.3)
stack.autopilots(("any vehicle",))
"""


@pytest.mark.extended
@linux
def test_script_that_leaves_its_stack_open_ends_it_without_a_word(marked: Find, tag: str) -> None:
    command = [sys.executable, "-c", LEFT_OPEN, str(CLINGING), "ignores bye", tag]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert (done.stdout, done.stderr) == ("", "")
    assert marked(tag) == []

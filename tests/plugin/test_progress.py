"""Progress of a long collection shows on terminals, and nowhere else."""

import os
import pty
import sys

import pytest

TEST = """
    import pytest_rvads as rvads

    @rvads.scenario("stop4", classes=1, distances=[float(d) for d in range(1, 7)], speeds=[0.0, 1.0], rules="p1")
    def test_it(run, rule, monitor): ...
"""


def on_a_terminal(*command: str) -> str:
    child, terminal = pty.fork()
    if child == 0:
        os.execv(command[0], command)
    said = b""
    while True:
        try:
            piece = os.read(terminal, 65536)
        except OSError:  # the terminal is closed when the command ends
            piece = b""
        if not piece:
            os.waitpid(child, 0)
            return said.decode()
        said += piece


@pytest.mark.extended
def test_terminals_see_progress_and_pipes_do_not(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(TEST)
    command = (sys.executable, "-m", "pytest", "--collect-only")
    shown = on_a_terminal(*command)
    assert "rvads: v(d)max of point 0/12" in shown
    assert "rvads: v(d)max of point 11/12" in shown
    assert "12 tests collected" in shown
    assert "rvads: v(d)max" not in on_a_terminal(*command, "-q")
    assert "rvads: v(d)max" not in pytester.runpytest("--collect-only").stdout.str()


@pytest.mark.extended
def test_terminals_see_how_far_a_draw_is(pytester: pytest.Pytester) -> None:
    grid = "cover='rotation', distances=[k * 0.1 for k in range(60)], rules='p1'"
    pytester.makepyfile(f"import pytest_rvads as rvads\n\n\n@rvads.scenario('stop4', {grid})\ndef test_it(run, rule): ...\n")
    command = (sys.executable, "-m", "pytest", "--collect-only", "--rvads-sample=5")
    shown = on_a_terminal(*command)
    assert "rvads: runs of test_it to draw from 0/5,760" in shown
    assert "5 tests collected" in shown

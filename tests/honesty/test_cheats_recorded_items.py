"""Sessions that judge recordings: too inexact ones, ones that can't be read, and none at all."""

from collections.abc import Callable

import pytest

import pytest_rvads as rvads

from .attempts import NOTHING, Session, statuses
from .shown import shows

Make = Callable[..., rvads.Run]
TESTS = """
@rvads.recorded({files}, rules="full_stop")
def test_drives(monitor, rule):
    monitor.{ask}(rule)
"""


@pytest.fixture
def kept(pytester: pytest.Pytester, drive: Make) -> None:
    """A recording of a vehicle that stands at the stop sign for 3 s and goes."""
    rvads.files.save_run(drive("stop4", {0: (2, -0.5, [(0, 0.0), (300, 8.0)])}, 900), pytester.path / "drives" / "mon.npz")


@shows("nothing_but_unsure")
@pytest.mark.usefixtures("kept", "doubted")
def test_unsure_recordings_are_no_success(session: Session, pytester: pytest.Pytester) -> None:
    result = session(TESTS.format(files='"drives"', ask="check"), driver=None)
    result.assert_outcomes(skipped=1)
    assert (result.ret, statuses(pytester)) == (NOTHING, ["UNSURE"])
    result.stdout.fnmatch_lines(["*a0 stood for 0.02 s, known to 0.05 s*", "*nothing was judged*"])


@shows("pass_over_what_is_unsure")
@pytest.mark.usefixtures("kept", "doubted")
def test_unsure_verdict_of_a_passing_test_is_no_success(session: Session, pytester: pytest.Pytester) -> None:
    result = session(TESTS.format(files='"drives"', ask="verdict"), driver=None)
    assert (result.ret, statuses(pytester)) == (NOTHING, ["UNSURE"])


@shows("one_file_is_no_recording")
@pytest.mark.usefixtures("kept")
def test_a_damaged_file_is_not_left_out(session: Session, pytester: pytest.Pytester) -> None:
    (pytester.path / "drives" / "bad.npz").write_bytes(b"no archive")
    result = session(TESTS.format(files='"drives/*.npz"', ask="check"), driver=None)
    result.assert_outcomes(passed=1, errors=1)
    assert statuses(pytester) == ["ERROR", "PASS"]
    result.stdout.fnmatch_lines(["*drives/bad.npz: *"])


@shows("no_recordings_at_all")
def test_missing_recordings_are_an_error(session: Session) -> None:
    result = session(TESTS.format(files='"drives/*.npz"', ask="check"), driver=None)
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["test_it.py:*: no file matches 'drives/[*].npz', looked for in *"])

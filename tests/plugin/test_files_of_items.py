"""What items leave behind, kept runs and pictures, lies in files of their own, whoever else writes there."""

import subprocess
import sys
from pathlib import Path

import pytest

from pytest_rvads.runs.runfile import load_run
from pytest_rvads.support.storage import slug

TESTS = """
import pytest_rvads as rvads

@rvads.scenario("stop3", classes=(1, 2), grid="E", rules=("p1", "p3"))
def {name}(run, rule, monitor):
    monitor.check(rule)
"""
KEEP = ("-q", "-p", "no:cacheprovider", "--rvads-autopilot=reference", "--rvads-keep=kept")


@pytest.mark.parametrize(
    ("nodeid", "name"),
    [
        ("test_it.py::test_rules[stop4-class07-as1133-cfgD-p1]", "test_it.test_rules-stop4-class07-as1133-cfgD-p1"),
        ("tests/deep/test_it.py::test_rules", "tests-deep-test_it.test_rules"),
        ("test_it.py::TestStop::test_rules[stop4-cfgD.r1]", "test_it.TestStop-test_rules-stop4-cfgD.r1"),
    ],
)
def test_an_item_is_called_in_files_as_in_the_session(nodeid: str, name: str) -> None:
    assert slug(nodeid) == name


def test_no_two_items_share_a_file() -> None:
    ids = [
        *("a/b.py::t", "a-b.py::t", "a.b.py::t", "a/b.py::t[x]", "a/b.py::t[x y]", "a/b.py::t[x-y]", "a/b.py::t[x/y]"),
        *("a/b.py::t[x-]", "a/b.py::t[x/]", "a/b.py::t[ü]", "a/b.py::t[ä]", "a/b.py::t[]", "a/b.py::t[\ud800]"),
        *(f"a/b.py::{'t' * 245}[{k}]" for k in range(3)),
    ]
    names = [slug(nodeid) for nodeid in ids]
    assert len(set(names)) == len(ids)
    assert all(name.isascii() and len(name) <= 190 and "/" not in name for name in names)
    assert [slug(nodeid) for nodeid in ids] == names


def test_runs_of_tests_with_long_names_are_kept(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=TESTS.format(name="test_" + "x" * 240))
    pytester.runpytest(*KEEP).assert_outcomes(passed=4)
    assert len({load_run(path).hash for path in Path("kept").iterdir()}) == 2


@pytest.mark.slow
@pytest.mark.parametrize("workers", [(), ("-n", "2", "--dist", "load")])
def test_sessions_may_keep_the_same_runs_at_once(pytester: pytest.Pytester, workers: tuple[str, ...]) -> None:
    pytester.makepyfile(test_it=TESTS.format(name="test_rules"))
    command = [sys.executable, "-m", "pytest", *KEEP, *workers]
    sessions = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) for _ in range(3)]
    told = [session.communicate(timeout=120)[0].decode() for session in sessions]
    assert [session.returncode for session in sessions] == [0, 0, 0], told
    assert len({load_run(path).hash for path in Path("kept").iterdir()}) == 2
    assert len(list(Path("kept").iterdir())) == 2

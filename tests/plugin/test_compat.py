"""The same session beside other plugins: same verdicts, and no warning even where warnings are errors."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.inner_sessions import driven_by, records_of

TESTS = driven_by(
    'Racer if "racer" in request.function.__name__ else rvads.Reference',
    """
    here = rvads.scenario("stop4", classes=(1, 7), grid="B", rules=("p1", "p4"), duration=4)

    @here
    def test_reference(run, rule, monitor):
        monitor.check(rule)

    @rvads.known("races", rule="p1", cls=7)
    @here
    def test_racer(run, rule, monitor):
        monitor.check(rule)

    def test_plain(): ...
""",
)
WANTED = {"PASS": 2, "FAIL": 2, "NA": 4}
OTHERS = {
    "sugar": ("pytest_sugar", ()),
    "html": ("pytest_html", ("--html=out.html", "--self-contained-html")),
    "reportlog": ("pytest_reportlog", ("--report-log=out.jsonl",)),
    "rerunfailures": ("pytest_rerunfailures", ("--reruns", "1")),
    "timeout": ("pytest_timeout", ("--timeout=300",)),
    "randomly": ("pytest_randomly", ("-p", "randomly")),
}
_PLAIN: dict[str, tuple[str, str, str]] = {}
"""The same for all tests of this file, worked out by the first."""


def verdicts(path: Path) -> dict[str, tuple[str, str, str]]:
    return {r["nodeid"]: (r["status"], r["outcome"], r["hash"]) for r in records_of(path.parent, path.name)}


@pytest.fixture
def plain(pytester: pytest.Pytester) -> dict[str, tuple[str, str, str]]:
    """The verdicts of a session with nothing but this plugin and the workers' one."""
    pytester.makepyfile(test_it=TESTS)
    if _PLAIN:
        return _PLAIN
    off = [f"-pno:{name}" for name in (*OTHERS, "benchmark")]
    result = pytester.runpytest_subprocess("-W", "error", "--rvads-report=plain.json", *off)
    result.assert_outcomes(passed=3, failed=1, skipped=4, xfailed=1)
    found = verdicts(pytester.path / "plain.json")
    counts = {status: sum(v[0] == status for v in found.values()) for status in WANTED}
    assert counts == WANTED
    _PLAIN.update(found)
    return found


@pytest.mark.extended
@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("workers", [(), ("-n", "1")], ids=["alone", "workers"])
def test_other_plugins(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, plain: object, other: str, workers: tuple[str, ...]
) -> None:
    module, options = OTHERS[other]
    if find_spec(module) is None:
        pytest.skip(f"{module} is not installed: pip install pytest-rvads[compat]")
    # Where all are installed, they are all at work, too: each is only told to do its work here.
    if other == "html":
        monkeypatch.delenv("PYTEST_ADDOPTS")  # by which tests/conftest.py puts it away, and the plugin of Hypothesis
    result = pytester.runpytest_subprocess("-W", "error", "--rvads-report=out.json", *options, *workers)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    assert verdicts(pytester.path / "out.json") == plain
    result.stdout.no_fnmatch_line("*warning*")

"""Annotations of GitHub Actions: few, one per cause, and no text in them is taken for a command."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.report.record import Record, conclude, planned_record
from pytest_rvads.report.session_report import Report
from pytest_rvads.session.outputs import annotate
from tests.inner_sessions import FAILING

ROOT = Path("/work/repo/sub")
HOSTILE = st.one_of(
    st.text(),
    st.lists(
        st.sampled_from(["::", "\n", "\r", "%0A", "%", ",", "=", ":", "::error::", "\n::add-mask::x", "##[set-env]", "]"])
    ).map("".join),
)


def failed(run: str, rule: str, cause: str, file: str = "t.py", line: int = 3) -> Record:
    keys = {"junction": "stop4", "cls": 1, "scenario": "1111", "cfg": "C", "rotation": 0, "rule": rule}
    record = planned_record(f"{file}::test[{run}-{rule}]", line, "test", keys, 4)
    verdict = Verdict("", Status.FAIL, "", violated=cause, time=1.0)
    return conclude(replace(record, hash=run), [verdict], "call", "failed", text=cause)


def told(*records: Record, ended: int = 1, workspace: str = "/work/repo") -> list[str]:
    return annotate(Report(records, exitstatus=ended, again="pytest --rvads-grid=C"), ROOT, Path(workspace))


def understood(line: str) -> tuple[str, dict[str, str], str]:
    """Command, properties and message of a line, as GitHub's runner takes it apart: ActionCommand.TryParseV2."""
    assert line.startswith("::")
    assert line.splitlines() == [line]
    info, _, data = line[2:].partition("::")
    name, _, rest = info.partition(" ")
    properties = dict(part.split("=", 1) for part in rest.split(",") if "=" in part)

    def plain(text: str, *escapes: tuple[str, str]) -> str:
        for escaped, sign in (("%0D", "\r"), ("%0A", "\n"), *escapes, ("%25", "%")):
            text = text.replace(escaped, sign)
        return text

    return name, {key: plain(value, ("%3A", ":"), ("%2C", ",")) for key, value in properties.items()}, plain(data)


def test_a_cause_is_told_once_at_its_first_test_from_the_repository() -> None:
    lines = told(failed("one", "p1", "both in"), failed("two", "p1", "both in", line=9), failed("three", "p3", "too early"))
    assert lines == [
        "::error file=sub/t.py,line=4,title=p1%2C 2 items::both in, in 2 runs"
        '%0Arerun: pytest --rvads-grid=C "t.py::test[one-p1]"',
        '::error file=sub/t.py,line=4,title=p3%2C 1 item::too early%0Arerun: pytest --rvads-grid=C "t.py::test[three-p3]"',
    ]


def test_what_the_session_lets_pass_is_a_warning() -> None:
    (line,) = told(failed("one", "p1", "both in"), ended=0)
    assert understood(line)[0] == "warning"


def test_passing_session_has_no_annotations() -> None:
    passed = replace(failed("one", "p1", "x"), outcome="passed")
    assert told(passed, ended=1) == []


@pytest.mark.parametrize(
    ("count", "last"), [(10, "cause 9"), (11, "2 more causes, of 2 items"), (25, "16 more causes, of 16 items")]
)
def test_at_most_ten_annotations_and_a_count_of_the_rest(count: int, last: str) -> None:
    lines = told(*(failed(f"run{n:02}", f"rule{n:02}", f"cause {n}") for n in range(count)))
    assert len(lines) == 10
    assert last in lines[-1]


@pytest.mark.parametrize(
    ("file", "workspace"), [("../../else/t.py", "/work/repo"), ("/usr/t.py", "/work/repo"), ("t.py", "/other")]
)
def test_what_lies_outside_of_the_repository_has_no_file(file: str, workspace: str) -> None:
    (line,) = told(failed("one", "p1", "both in", file), workspace=workspace)
    assert understood(line)[1] == {"title": "p1, 1 item"}


@settings(max_examples=40)
@given(HOSTILE, HOSTILE, HOSTILE)
def test_no_text_ends_its_value_or_its_line(cause: str, rule: str, file: str) -> None:
    """Each line is one command with the properties that were meant; what was said comes out again, on its lines."""
    for line in told(failed("one", rule, cause, f"folder/{file.replace('/', '').replace('..', '')}.py")):
        name, properties, message = understood(line)
        assert name == "error"
        assert set(properties) <= {"file", "line", "title"}
        assert properties.get("line", "4") == "4"
        assert properties["title"].endswith(", 1 item")
        assert len(message.split("\n")) == 2
        line.encode()
        assert "\x1b" not in line


def test_they_are_long_but_bounded() -> None:
    (line,) = told(failed("one", "r" * 10_000, "x" * 1_000_000))
    assert len(line) < 5_000


@pytest.mark.parametrize("options", [(), ("-q", "--color=yes")])
def test_a_session_prints_them_in_a_job_of_github(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_WORKSPACE", str(pytester.path.parent))
    pytester.makepyfile(FAILING)
    result = pytester.runpytest("--rvads-artefacts=none", *options)
    (line,) = [line for line in result.outlines if line.startswith("::")]
    place = f"{pytester.path.name}/test_a_session_prints_them_in_a_job_of_github.py"
    assert understood(line)[1] == {"file": place, "line": "8", "title": "p3 (first come, first served), 1 item"}


def test_annotations_require_github_actions(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)
    pytester.makepyfile(FAILING)
    assert not [line for line in pytester.runpytest("--rvads-artefacts=none").outlines if "::error" in line]

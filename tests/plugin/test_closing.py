"""The end of a session in the terminal: pytest's blocks and lines of failures folded per cause, then the causes."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

from tests.inner_sessions import driven_by

RUDE = driven_by(
    "Racer",
    """
    @rvads.scenario("stop4", classes=(1, 2, 7), grid="E", rules=("p1", "p3", "full_stop"), duration=10)
    def test_rules(run, rule, monitor):
        monitor.check(rule)

    def test_of_something_else():
        assert 1 + 1 == 3

    @pytest.fixture
    def broken():
        raise OSError("no disk")

    def test_with_a_broken_fixture(broken): ...

    @pytest.mark.xfail
    def test_known(): assert False
""",
)


def named(result: pytest.RunResult, word: str = "FAILED") -> list[str]:
    """The items that have a line in pytest's short summary."""
    lines = result.outlines[result.outlines.index(next(line for line in result.outlines if "short test summary" in line)) :]
    return [line.split()[1].partition("::")[2] for line in lines if line.startswith(f"{word} ")]


def sections(result: pytest.RunResult) -> list[str]:
    """The titles of sections, in order."""
    return [found[1] for line in result.outlines if (found := re.fullmatch(r"=+ (.*?) =+", line))]


@pytest.mark.parametrize(
    "options", [(), pytest.param(("-n", "2"), marks=pytest.mark.slow), ("-p", "no:cacheprovider", "--tb=no")]
)
def test_failures_are_folded_per_cause_and_causes_come_last(pytester: pytest.Pytester, options: tuple[str, ...]) -> None:
    pytester.makepyfile(RUDE)
    result = pytester.runpytest("-rfEx", *options)
    titles = sections(result)
    assert titles[-4:-1] == ["rvads verdicts", "short test summary info", "rvads causes"]
    counts = result.parseoutcomes()
    assert counts["failed"] > 4, "the closing line counts all"
    causes = len([line for line in result.outlines if re.match(r" +6 x p1 ", line)])
    assert causes == 1
    first = next(line for line in result.outlines if "first: pytest " in line).partition("::")[2].rstrip('"')
    assert sorted(named(result)) == sorted([first, "test_of_something_else"])
    assert named(result, "ERROR") == ["test_with_a_broken_fixture"]
    (note,) = [line for line in result.outlines if "per cause; -vv lists all" in line]
    blocks = [line.strip("_ ") for line in result.outlines if re.fullmatch(r"_+ test_.* _+", line)]
    if "--tb=no" in options:
        assert (note.split(" per ")[0], blocks) == ("one line", [])
    else:
        assert (note.split(" per ")[0], sorted(blocks)) == ("one block and one line", sorted([first, "test_of_something_else"]))
    assert f" all {counts['failed']} failures" in note
    assert result.outlines.index(note) < result.outlines.index(next(line for line in result.outlines if "rvads causes" in line))
    explained = [line for line in result.outlines if "entrance +1: " in line]
    assert len(explained) == 1, "causes name entrances by numbers with a plus"
    assert result.outlines.index(next(line for line in result.outlines if line.startswith("XFAIL"))) > 0
    assert result.ret == pytest.ExitCode.TESTS_FAILED


def test_causes_that_are_not_listed_keep_the_line_of_their_first_item(pytester: pytest.Pytester, reference: None) -> None:
    pytester.makepyfile(
        """
        import pytest
        import pytest_rvads as rvads

        @pytest.mark.parametrize("kind", "abcdefghijkl")
        @rvads.scenario("stop4", classes=1, grid="E", rules=("p1", "p4"), duration=0.1)
        def test_many_faults(run, rule, monitor, kind):
            raise ValueError(f"fault {kind}")
        """
    )
    result = pytester.runpytest("--tb=no")
    assert result.parseoutcomes() == {"failed": 24}
    result.stdout.fnmatch_lines(["one line per cause; -vv lists all 24 failures", "  ... and 2 more: *"])
    told = [found[1] for name in named(result) if (found := re.search(r"-([a-l])\]$", name))]
    assert sorted(told) == list("abcdefghijkl"), "also those of the two causes that are not listed"


@pytest.mark.extended
def test_a_session_started_from_python_with_paths_is_summed_up(pytester: pytest.Pytester) -> None:
    """Some seconds, in which Python starts."""
    path = pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=1, grid="E", rules="p1", duration=0.1)
        def test_rules(run, rule, monitor):
            raise ValueError("a fault")
        """
    )
    given = f"[pathlib.Path({str(path)!r}), '--tb=no', '--rvads-autopilot=reference']"
    result = pytester.runpython(pytester.makepyfile(main=f"import pathlib, pytest; pytest.main({given})"))
    result.stdout.no_fnmatch_line("*could not be summed up*")
    result.stdout.fnmatch_lines(["*= rvads causes =*", "causes of failures"])


def test_verbose_session_shows_every_failure(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    result = pytester.runpytest("--tb=short", "-vv")
    failed = result.parseoutcomes()["failed"]
    assert len(named(result)) == failed
    assert sum(bool(re.fullmatch(r"_+ test_.* _+", line)) for line in result.outlines) == failed, "and its block"
    result.stdout.no_fnmatch_line("*per cause; -vv*")
    assert sections(result)[-2] == "rvads causes"


@pytest.mark.extended
def test_note_on_left_out_failures_requires_a_short_summary(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    for options in (("-rN",), ("--no-summary",), ("-q", "-rx")):
        result = pytester.runpytest("--tb=no", *options)
        result.stdout.no_fnmatch_line("*per cause; -vv*")
        result.stdout.fnmatch_lines(["*= rvads causes =*", "causes of failures", "*first: pytest *"])


@pytest.mark.extended
def test_who_sees_no_terminal_sees_no_summary(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    result = pytester.runpytest("-p", "no:terminal")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    assert "rvads" not in result.stdout.str()
    quiet = pytester.runpytest("-qq", "--tb=no")
    quiet.stdout.fnmatch_lines(["*= rvads verdicts =*", "FAILED *", "*= rvads causes =*", "causes of failures"])


def test_other_plugins_see_all_reports_at_the_end(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    pytester.makeconftest(
        """
        import pytest

        class Outermost:
            @pytest.hookimpl(wrapper=True, tryfirst=True)
            def pytest_terminal_summary(self, terminalreporter):
                before = {kind: len(found) for kind, found in terminalreporter.stats.items()}
                yield
                after = {kind: len(found) for kind, found in terminalreporter.stats.items()}
                terminalreporter.write_line(f"the same: {before == after}")

        def pytest_sessionstart(session):
            session.config.pluginmanager.register(Outermost())

        def pytest_terminal_summary(terminalreporter):
            terminalreporter.write_line(f"inside: {len(terminalreporter.stats['failed'])} failed")
        """
    )
    result = pytester.runpytest("--tb=no")
    result.stdout.fnmatch_lines(["inside: *", "*= rvads causes =*", "the same: True"])
    assert f"inside: {result.parseoutcomes()['failed']} failed" in result.outlines


def test_a_plugin_that_raises_costs_neither_the_causes_nor_the_counts(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    pytester.makeconftest("def pytest_terminal_summary(): raise OSError('a plugin is broken')")
    result = pytester.runpytest("--tb=no")
    result.stdout.fnmatch_lines(["*= rvads verdicts =*", "*= rvads causes =*", "causes of failures"])
    assert "a plugin is broken" in result.stdout.str() + result.stderr.str()


def test_a_session_where_all_is_well_has_no_section_of_causes(pytester: pytest.Pytester, reference: None) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=1, grid="E", rules="p1")
        def test_rules(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest()
    assert sections(result)[1:-1] == ["rvads verdicts"]
    assert "1 run, 1 verdict: 1 pass" in result.stdout.str()


@pytest.mark.skipif(importlib.util.find_spec("pytest_sugar") is None, reason="pytest-sugar is not installed")
def test_it_works_with_sugar(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    result = pytester.runpytest_subprocess("-p", "pytest_sugar", "--tb=no")
    result.stdout.fnmatch_lines(["*rvads verdicts*", "*rvads causes*", "causes of failures"])


CRASH = """
    import pytest
    import pytest_rvads as rvads

    class Broken(rvads.Follower):
        def control(self, seen):
            if seen.me.zone > 0:  # another vehicle at another time, by scenario
                raise ValueError(f"no gap for {seen.me.name} after {seen.time:.2f} s")
            return super().control(seen)

    @pytest.fixture
    def rvads_autopilot():
        return Broken

    @rvads.scenario("stop4", classes=(1, 2, 7), distances=[(9, 5, 3, 1), (1, 4, 8, 6)], speeds=0, rules=("p1", "full_stop"))
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""


def test_driver_crash_is_one_cause_over_rules_runs_and_times(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(CRASH)
    result = pytester.runpytest("--tb=no", "-rE", "-vv")
    messages = {line.partition(" - ")[2] for line in result.outlines if line.startswith("ERROR ")}
    assert len(messages) > 1, "what this is about: they differ"
    result = pytester.runpytest("--tb=no")
    result.assert_outcomes(errors=12)
    assert sum("first: pytest" in line for line in result.outlines) == 1
    result.stdout.fnmatch_lines(["  *12 x full_stop, p1: ERROR: Broken driving a? raised ValueError: no gap for *"])
    assert len(named(result, "ERROR")) == 1


STACK = """
    import os, sys
    sys.path.insert(0, {folder!r})
    import rvads_client

    for seen in rvads_client.connect("dying", rate=20):
        if seen.time > 0.3 + seen.me["entrance"] / 10 + seen.me["speed"] / 50:
            os._exit(7)
        seen.answer(target_speed=5.0)
"""


def test_dying_stack_is_one_cause(pytester: pytest.Pytester) -> None:
    client = Path(__file__).parents[2] / "clients" / "python"
    pytester.makefile(".py", stack=STACK.format(folder=str(client)))
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=(1, 2), grid="CE", rules=("p1", "full_stop"))
        def test_rules(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest("--tb=no", f"--rvads-sut={sys.executable} stack.py")
    result.assert_outcomes(errors=8)
    result.stdout.re_match_lines(
        [r"rvads: driven by --rvads-sut=.* stack\.py \([0-9a-f]{8}\)", r"driven by stack .* \([0-9a-f]{8}\): "]
    )
    assert [line for line in result.outlines if re.match(r" +\d+ x ", line)] == [
        line for line in result.outlines if re.match(r" +8 x full_stop, p1: ERROR: stack .* exited ", line)
    ]
    assert len(named(result, "ERROR")) == 1

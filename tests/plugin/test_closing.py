"""The end of a session in the terminal: pytest's list of failures, with one explanation per signature, then the causes."""

import importlib.util
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

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


def texts(result: pytest.RunResult) -> dict[str, list[str]]:
    """By name of a failed item, the lines of its block."""
    blocks: dict[str, list[str]] = {}
    lines: list[str] = []
    for line in result.outlines[result.outlines.index(next(line for line in result.outlines if " FAILURES =" in line)) :]:
        if re.fullmatch(r"=+ (?!FAILURES).* =+", line):
            break
        if found := re.fullmatch(r"_+ (test_.*?) _+", line):
            lines = blocks.setdefault(found[1], [])
        elif not line.startswith("[gw"):  # the worker
            lines.append(line)
    return blocks


@pytest.mark.parametrize("options", [(), pytest.param(("-n", "2"), marks=pytest.mark.slow), ("-p", "no:cacheprovider")])
def test_every_failure_is_listed_and_one_of_a_kind_is_explained(pytester: pytest.Pytester, options: tuple[str, ...]) -> None:
    pytester.makepyfile(RUDE)
    result = pytester.runpytest("-rfEx", *options)
    titles = sections(result)
    assert titles[-4:-1] == ["rvads verdicts", "short test summary info", "rvads causes"]
    failed = result.parseoutcomes()["failed"]
    assert (len(named(result)), len(set(named(result)))) == (failed, failed)
    assert named(result, "ERROR") == ["test_with_a_broken_fixture"]
    blocks = texts(result)
    assert sorted(blocks) == sorted(named(result))
    short = {name: text for name, text in blocks.items() if len(text) == 1}
    whole = {name for name in blocks if name not in short}
    assert len(whole) == 3, "a collision, a missing stop, and the test of something else"
    for name, (text,) in short.items():
        rule = name.rpartition("-")[2].removesuffix("]")
        found = re.fullmatch(rf"{rule} at t=\d.*; see test_\w+\.py::(.*)", text)
        assert found, text
        assert found[1] in whole
        assert found[1].endswith(f"-{rule}]")
    assert len([line for line in result.outlines if re.match(r" +6 x p1 ", line)]) == 1
    first = next(line for line in result.outlines if "first: pytest " in line).partition("::")[2].rstrip('"')
    assert first in blocks
    explained = [line for line in result.outlines if "entrance +1: " in line]
    assert len(explained) == 1, "causes name entrances by numbers with a plus"
    assert result.outlines.index(next(line for line in result.outlines if line.startswith("XFAIL"))) > 0
    assert result.ret == pytest.ExitCode.TESTS_FAILED


def test_other_plugins_get_every_failure_with_what_pytest_captured(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE.replace("monitor.check(rule)", "print('printed by the test'); monitor.check(rule)"))
    result = pytester.runpytest("--junitxml=out.xml", "-o", "junit_logging=all")
    cases = list(ElementTree.parse(pytester.path / "out.xml").iter("testcase"))
    failures = [case for case in cases if case.find("failure") is not None]
    assert len(failures) == result.parseoutcomes()["failed"] == 7
    messages = [failure.get("message", "") for case in failures for failure in case.iter("failure")]
    assert sum("; see test_" in message for message in messages) == 4
    printed = [case for case in failures if "printed by the test" in (case.findtext("system-out") or "")]
    assert len(printed) == 6


def test_debugger_shows_every_failure_whole(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    pytester.makeconftest("""
        import pytest

        @pytest.hookimpl(tryfirst=True)
        def pytest_exception_interact(report):
            print("shown:", "; see test_" in report.longreprtext)
    """)
    result = pytester.runpytest("--pdb", "--pdbcls=tests.plugin.test_closing:Quiet", "-k", "p1")
    assert [text.partition("\n")[0] for text in result.stdout.str().split("shown: ")[1:]] == ["False"] * 3


class Quiet:
    """A debugger that continues at once."""

    quitting = False

    def __init__(self, *_: object, **__: object) -> None: ...

    def reset(self) -> None: ...

    def interaction(self, *_: object) -> None: ...


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


def test_verbose_session_explains_every_failure(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    result = pytester.runpytest("--tb=short", "-vv")
    failed = result.parseoutcomes()["failed"]
    blocks = texts(result)
    assert len(named(result)) == len(blocks) == failed
    assert min(map(len, blocks.values())) > 1
    assert sections(result)[-2] == "rvads causes"


@pytest.mark.extended
def test_causes_stand_below_whatever_pytest_is_told_to_print(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    for options in (("-rN",), ("--no-summary",), ("-q", "-rx"), ("-qq",)):
        result = pytester.runpytest("--tb=no", *options)
        result.stdout.fnmatch_lines(["*= rvads causes =*", "causes of failures", "*first: pytest *"])


@pytest.mark.extended
def test_who_sees_no_terminal_sees_no_summary(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    result = pytester.runpytest("-p", "no:terminal")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    assert "rvads" not in result.stdout.str()
    quiet = pytester.runpytest("-qq", "--tb=no")
    quiet.stdout.fnmatch_lines(["*= rvads verdicts =*", "FAILED *", "*= rvads causes =*", "causes of failures"])


def test_statistics_of_pytest_are_left_alone(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(RUDE)
    pytester.makeconftest(
        """
        import pytest

        class Outermost:
            @pytest.hookimpl(wrapper=True, tryfirst=True)
            def pytest_terminal_summary(self, terminalreporter):
                before = {kind: list(found) for kind, found in terminalreporter.stats.items()}
                yield
                terminalreporter.write_line(f"the same: {before == terminalreporter.stats}")

        def pytest_sessionstart(session):
            session.config.pluginmanager.register(Outermost())

        def pytest_terminal_summary(terminalreporter):
            terminalreporter.write_line(f"inside: {len(terminalreporter.stats['failed'])} failed")
        """
    )
    result = pytester.runpytest("--tb=no")
    result.stdout.fnmatch_lines(["*= rvads verdicts =*", "inside: *", "*= rvads causes =*", "the same: True"])
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
    assert len(named(result, "ERROR")) == 12


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

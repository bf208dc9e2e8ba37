"""A subject among traffic, as a user of the plugin meets it."""

import pytest

from tests.inner_sessions import driven_by, records_of
from tools.crossings import Layout, opendrive

from .conftest import Lines


def test_ids_name_the_seat_and_the_traffic(pytester: pytest.Pytester, brackets: Lines) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        class Mine(rvads.Reference): ...

        @rvads.scenario("stop4", subject=0, scenarios="1133", grid="D", rules="p1", traffic=("reference", "hesitant", Mine))
        def test_one(run, rule, monitor): ...

        @rvads.scenario("stop3", subject="all", grid="C")
        def test_all(run): ...
        """
    )
    found = brackets(pytester.runpytest("--collect-only", "-q"))
    assert found[:3] == [
        "stop4-class07-as1133-s0-cfgD-p1",
        "stop4-class07-as1133-s0-cfgD-hesitant-p1",
        "stop4-class07-as1133-s0-cfgD-Mine-p1",
    ]
    # 8 classes of (scenario, seat) at three ways: 111 and 222 have one seat, 112 and 122 three.
    assert [id[len("stop3-class01-") : -len("-cfgC")] for id in found[3:]] == [
        "as111-s0",
        *(f"as112-s{seat}" for seat in range(3)),
        *(f"as122-s{seat}" for seat in range(3)),
        "as222-s0",
    ]


def test_grid_of_a_subject_has_both_orders_of_arrival_in_five_runs(pytester: pytest.Pytester, brackets: Lines) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", subject="all")
        @rvads.scenario("light4", subject=1, scenarios="2222")
        def test_subject(run): ...

        @rvads.scenario("stop4", classes=7)
        def test_paper(run): ...
        """
    )
    found = brackets(pytester.runpytest("--collect-only", "-q"))
    stop, light, paper = (
        [id for id in found if at in id] for at in ("stop4-class01-as1111-s0", "light4", "stop4-class07-as1133-cfg")
    )
    assert sum("stop4" in id and "-s" in id[5:] for id in found) == 81 * len("ABCDE")
    assert [id.rpartition("cfg")[2] for id in stop] == ["C", "S21", "S46", "S26_56_56", "S56_56_26"]
    assert [id.rpartition("cfg")[2] for id in light] == ["H", "S31", "S42", "S53", "S64"]
    assert [id.rpartition("cfg")[2] for id in paper] == [*"ABCDE"]


def test_staggered_grid_without_a_subject_is_refused(pytester: pytest.Pytester) -> None:
    pytester.makepyfile('import pytest_rvads as rvads\n\n@rvads.scenario("stop4", grid="staggered")\ndef test_it(run): ...\n')
    result = pytester.runpytest("--collect-only", "-q")
    result.stdout.fnmatch_lines(["*configuration S21 is staggered around a subject, and there is none: say subject=0 or 'all'*"])


def test_traffic_need_not_be_hashable(pytester: pytest.Pytester, reference: None) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        class Parked(list):
            def __call__(self):
                return rvads.traffic("stopped")()

        @rvads.scenario("stop3", subject=0, classes=1, grid="C", duration=0.1, traffic=[Parked()])
        def test_it(run): ...
        """
    )
    pytester.runpytest().assert_outcomes(passed=1)


def test_the_road_rulebook_is_the_default_with_a_subject(pytester: pytest.Pytester, brackets: Lines) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop3", subject=1, scenarios="111", grid="C")
        def test_it(run, rule, monitor): ...
        """
    )
    rules = [id.rpartition("-")[2] for id in brackets(pytester.runpytest("--collect-only", "-q"))]
    assert rules[:3] == ["full_stop", "first_come", "right_first"]
    assert "p1" not in rules


TRAFFIC = driven_by(
    'Racer if "rude" in request.function.__name__ else rvads.Reference',
    """
    @rvads.scenario("stop3", subject=0, scenarios="111", grid="C", rules="full_stop", traffic=Racer)
    def test_mine(run, rule, monitor):
        verdict = monitor.check(rule)
        assert verdict.provoked
        assert set(verdict.responsible) == {"a1", "a2"}

    @rvads.scenario("stop3", subject=0, scenarios="111", grid="C", rules=("full_stop", "p3"))
    def test_rude(run, rule, monitor):
        monitor.check(rule)
""",
)


@pytest.mark.parametrize("options", [(), pytest.param(("-n", "1"), marks=pytest.mark.slow)])
def test_violations_of_traffic_are_provoked_and_those_of_the_subject_fail(
    pytester: pytest.Pytester, options: tuple[str, ...]
) -> None:
    pytester.makepyfile(TRAFFIC)
    result = pytester.runpytest("--rvads-report=out.json", "--rvads-report=out.md", "--junitxml=out.xml", *options)
    outcomes = result.parseoutcomes()
    assert (outcomes["passed"], outcomes["failed"]) == (1, 1)
    result.stdout.fnmatch_lines(
        [
            "*RuleViolation: full_stop at t=*: a0 entered the junction before it had stopped at the line",
            "stop3 among Racer traffic *test_mine*",
            "*provoked*",
            "stop3 among reference traffic *test_rude*",
            "stop3: 1/4 classes, 1/8 classes with a subject, 1/8 scenarios, 2 runs, 3 verdicts: *1 provoked by traffic*",
            "provoked by traffic",
            "*1 x full_stop: *",
        ]
    )
    records = records_of(pytester.path)
    assert [(r["status"], r["outcome"], r["seat"], r["traffic"]) for r in records][:2] == [
        ("PROVOKED", "passed", 0, "Racer"),
        ("FAIL", "failed", 0, "reference"),
    ]
    assert "## Provoked by traffic" in (pytester.path / "out.md").read_text(encoding="utf-8")
    xml = (pytester.path / "out.xml").read_text(encoding="utf-8")
    assert '<property name="traffic" value="Racer"' in xml
    assert '<property name="verdict" value="PROVOKED"' in xml


def test_seats_and_traffic_select(pytester: pytest.Pytester, ids: Lines) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.known("X", seat=0, traffic="hesitant")
        @rvads.scenario("stop3", subject="all", grid="C", rules="p1", traffic=("reference", "hesitant"))
        def test_it(run, rule, monitor): ...
        """
    )
    assert len(ids(pytester.runpytest("--collect-only", "-q"))) == 16
    assert len(ids(pytester.runpytest("--collect-only", "-q", "-m", "rvads(seat=2, traffic='hesitant')"))) == 2
    assert len(ids(pytester.runpytest("--collect-only", "-q", "-k", "hesitant and s2-cfg"))) == 2


def test_senses_are_an_axis(pytester: pytest.Pytester, brackets: Lines) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        axes = {"delay": [0, 0.5], "range": 30}

        @rvads.scenario("stop3", subject=0, scenarios="111", grid="C", rules="no_collision", senses=axes)
        def test_it(run, rule, monitor):
            monitor.check(rule)
        """
    )
    assert brackets(pytester.runpytest("--collect-only", "-q")) == [
        "stop3-class01-as111-s0-cfgC.range30.00-no_collision",
        "stop3-class01-as111-s0-cfgC.delay00.50.range30.00-no_collision",
    ]
    result = pytester.runpytest()
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["*#1 = C.delay00.50.range30.00", "*#2 = C.range30.00"])
    assert len(brackets(pytester.runpytest("--collect-only", "-q", "-m", "rvads(cfg='C.range30.00')"))) == 1


def test_session_of_runs_cut_off_before_the_crossing_is_not_green(pytester: pytest.Pytester, reference: None) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", subject=0, scenarios="1133", grid="D", duration=1)
        def test_it(monitor, rule):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest("-rs")
    result.assert_outcomes(skipped=10)
    assert result.ret == pytest.ExitCode.NO_TESTS_COLLECTED
    result.stdout.fnmatch_lines(["*NA: cut off: the run reached its duration before the subject had left the junction*"])


def test_staggered_starts_on_short_approaches_are_told(pytester: pytest.Pytester, reference: None) -> None:
    approaches = opendrive(Layout(approach=40.0, stop=20.0))
    (pytester.path / "short.xodr").write_text(approaches, encoding="utf-8")
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("1", map="short.xodr", subject=0, scenarios="2200", grid=("S31", "S56"), duration=0.1)
        def test_it(run):
            assert run.provenance["scenario"]["distances"][1] in (31.0, 40.0)
        """
    )
    result = pytester.runpytest()
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["1 junction with an approach too short for a staggered start, where vehicles start *: short.1"])

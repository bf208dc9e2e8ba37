"""Wrong use gives one sentence that helps, and hides nothing else."""

import pytest

BODY = """
    import pytest_rvads as rvads

    @rvads.scenario({arguments})
    def test_it(run, rule, monitor):
        monitor.check(rule)
"""


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ('"stop5"', "*stop5*stop4*"),
        ('"stop4", rules="p9"', "*p9*"),
        ('"stop4", distances=-3', "*distances must be 0 or more and finite, got -3*"),
        ('"stop4", distances=float("nan")', "*distances must be 0 or more and finite, got nan*"),
        ('"stop4", distances=500', "*distance 500 m does not fit on entrance 0 of junction 'stop4'*"),
        ('"stop4", distances=1, speeds=11', "*too fast to stop before the line*"),
        ('"stop4", speeds=3', "*give either grid=, or distances= with speeds=*"),
        ('"stop4", grid="Q"', "*unknown configuration 'Q'*"),
        ('"stop4", cover="all"', "*cover must be one of class, scenario, rotation*"),
        ('"stop4", classes=25', "*a 4-way junction has classes 1..24, got 25*"),
        ('"stop4", scenarios="112"', "*scenario '112' names 3 entrances, junction 'stop4' has 4*"),
        ('"stop4", scenarios="1144"', "*1144*"),
        ('"1", map="nowhere.xodr"', "*nowhere.xodr*"),
        ('"stop4", duration=0', "*duration must lie above 0*"),
    ],
)
def test_collection_says_what_is_wrong(pytester: pytest.Pytester, arguments: str, says: str) -> None:
    pytester.makepyfile(BODY.format(arguments=arguments))
    result = pytester.runpytest()
    assert result.ret == pytest.ExitCode.INTERRUPTED
    result.stdout.fnmatch_lines([f"*test_it: {says.lstrip('*')}" if not says.startswith("*") else says])
    result.stdout.no_fnmatch_line("*Traceback*")
    result.stdout.no_fnmatch_line("*expansion.py*")


def test_known_with_a_wrong_keyword(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.known("I1", klass=3)
        @rvads.scenario("stop4")
        def test_it(run): ...
        """
    )
    result = pytester.runpytest()
    result.stdout.fnmatch_lines(
        ["*@rvads.known selects by junction, cls, scenario, cfg, rotation, seat, traffic, rule, got 'klass'*"]
    )


@pytest.mark.parametrize(
    ("signature", "mark", "says"),
    [
        ("run", "", "*asks for a run, but no @rvads.scenario(...) says which*"),
        ("", '@rvads.scenario("stop4")', "*takes neither run nor monitor*"),
    ],
)
def test_half_a_use(pytester: pytest.Pytester, signature: str, mark: str, says: str) -> None:
    pytester.makepyfile(f"import pytest_rvads as rvads\n\n{mark}\ndef test_it({signature}): ...\n")
    result = pytester.runpytest()
    result.stdout.fnmatch_lines([says])
    result.stdout.no_fnmatch_line("*Traceback*")


@pytest.mark.parametrize(
    ("option", "says"), [("--rvads-max-items=0", "*whole number above 0, got '0'*"), ("--rvads-grid=Q", "*unknown conf*")]
)
def test_wrong_options(pytester: pytest.Pytester, option: str, says: str) -> None:
    pytester.makepyfile(BODY.format(arguments='"stop4"'))
    result = pytester.runpytest(option)
    assert result.ret in (pytest.ExitCode.USAGE_ERROR, pytest.ExitCode.INTERRUPTED)
    assert any(pytest.LineMatcher([line]).str() and says.strip("*") in line for line in result.outlines + result.errlines)


def test_wrong_ini(pytester: pytest.Pytester) -> None:
    pytester.makeini("[pytest]\nrvads_cover = everything\n")
    pytester.makepyfile("def test_nothing(): ...")
    result = pytester.runpytest()
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*rvads_cover must be one of class, scenario, rotation, got 'everything'*"])


AUTOPILOTS = """
    import math
    import pytest
    import pytest_rvads as rvads

    class Raises:
        def control(self, seen):
            if seen.time > 0.5 and seen.me.name == "a2":
                raise ZeroDivisionError("no gap found")
            return rvads.Control()

    class Nan:
        def control(self, seen):
            return rvads.Control(throttle=math.nan)

    class Nothing:
        def control(self, seen):
            return None

    @pytest.fixture
    def rvads_autopilot(request):
        return {"raises": Raises, "nan": Nan, "nothing": Nothing, "good": rvads.Reference}[request.function.__name__[5:]]

    mark = rvads.scenario("stop4", classes=1, grid="C", rules="p1")

    @mark
    def test_raises(run, rule, monitor):
        monitor.check(rule)

    @mark
    def test_nan(run, rule, monitor):
        monitor.check(rule)

    @mark
    def test_nothing(run, rule, monitor):
        monitor.check(rule)

    @mark
    def test_good(run, rule, monitor):
        monitor.check(rule)
"""


def test_a_faulty_autopilot_is_an_error_and_hides_nothing(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(AUTOPILOTS)
    result = pytester.runpytest("-rE")
    result.assert_outcomes(errors=3, passed=1)
    result.stdout.fnmatch_lines(["*test_raises*Raises*a2*ZeroDivisionError*no gap found*"])
    result.stdout.fnmatch_lines(["*test_nan*Nan*nan*"])
    result.stdout.fnmatch_lines(["*test_nothing*Nothing*None*"])
    result.stdout.fnmatch_lines(["stop4: *4 verdicts: 1 pass, 3 error*"])


def test_a_monitor_that_never_judged_is_an_error(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=1, grid="C")
        def test_forgot(monitor): ...
        """
    )
    result = pytester.runpytest()
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["*NotJudged: nothing was judged: call monitor.check(rule)"])
    result.stdout.fnmatch_lines(["stop4: *1 not judged*"])

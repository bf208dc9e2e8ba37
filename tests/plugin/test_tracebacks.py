"""Errors in code of users: their own frames in the report and in the debugger, and what they printed."""

import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Write = Callable[..., None]
DRIVER = """
    import logging
    import sys
    import numpy as np
    import pytest
    import pytest_rvads as rvads
    from library import deep

    class Odd(rvads.Follower):
        def target_speed(self, seen):
            if seen.time == 0.0 and seen.me.name == "a0":
                print("printed by the driver")
                print("told as an error", file=sys.stderr)
                logging.warning("logged by the driver")
            secret = "a secret local"
            if seen.time >= 0.5:
                return self.decide(seen)
            return 5.0

        def decide(self, seen):
            {does}

    @pytest.fixture
    def rvads_autopilot():
        return Odd

    @rvads.scenario("stop4", subject=0, scenarios="2222", distances=20, duration=1.5, rules=("full_stop", "no_collision"))
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""
LINE = 20
"""Line of what the driver does."""
LIBRARY = "def deep(seen):\n    deeper(seen)\n\ndef deeper(seen):\n    raise KeyError('deep')\n"
RAISES = 'raise ValueError("an odd moment")'
HELD = "{1: 2}[3]"
IN_A_LIBRARY = "np.linalg.inv(np.zeros((2, 2)))"
IN_AN_INSTALLED_PACKAGE = "deep(seen)"
IN_THIS_PACKAGE = "return self.stopping_speed('far')"
IN_PYTHON = 'import json; json.loads("{")'


@pytest.fixture
def write(pytester: pytest.Pytester) -> Write:
    """Return a function that writes a test file whose driver does something, beside an installed package."""
    installed = pytester.mkdir("site-packages")
    (installed / "library.py").write_text(LIBRARY, encoding="utf-8")
    pytester.makeini("[pytest]\npythonpath = site-packages")

    def written(does: str, text: str = DRIVER) -> None:
        pytester.makepyfile(test_it=text.format(does=does))

    return written


@pytest.mark.parametrize(
    ("does", "says"),
    [
        (RAISES, "raised ValueError: an odd moment"),
        (HELD, "raised KeyError: 3"),
        (IN_A_LIBRARY, "raised LinAlgError: Singular matrix"),
        (IN_AN_INSTALLED_PACKAGE, "raised KeyError: 'deep'"),
        (IN_THIS_PACKAGE, "raised TypeError: * not supported between instances of 'str' and *"),
        (IN_PYTHON, "raised JSONDecodeError: *"),
    ],
)
def test_every_item_shows_the_frames_of_the_driver_and_names_its_line(
    pytester: pytest.Pytester, write: Write, does: str, says: str
) -> None:
    write(does)
    result = pytester.runpytest("-vv", "-p", "no:cacheprovider")
    result.assert_outcomes(errors=2)
    told = [f"*{does}".replace("[", "[[]"), f"E *ERROR: Odd driving a0 {says} (test_it.py:{LINE}) at 0.50 s"]
    result.stdout.fnmatch_lines(["*ERROR at setup of *full_stop*", *told, "*ERROR at setup of *no_collision*", *told])
    output = result.stdout.str()
    assert "secret = " in output, "the caller within the driver is shown"
    assert "follower.py" not in output
    assert "seat.py" not in output
    assert "running.py" not in output


@pytest.mark.parametrize("workers", [(), pytest.param(("-n", "2"), marks=pytest.mark.extended)])
def test_options_of_pytest_choose_what_is_shown(pytester: pytest.Pytester, write: Write, workers: tuple[str, ...]) -> None:
    write(RAISES)
    where = f"test_it.py:{LINE}"
    shown = {how: pytester.runpytest(f"--tb={how}", *workers).stdout for how in ("short", "line", "no", "native")}
    shown["short"].fnmatch_lines(["test_it.py:*: in target_speed", f"{where}: in decide", "E *(test_it.py:*) at 0.50 s"])
    shown["line"].fnmatch_lines([f"E *NoVerdict: ERROR: Odd driving a0 raised ValueError: an odd moment ({where})*"])
    shown["native"].fnmatch_lines([f'  File "*test_it.py", line {LINE}, in decide'])
    assert where not in shown["no"].str().partition("rvads verdicts")[0]


def debugged(pytester: pytest.Pytester, commands: str) -> pytest.LineMatcher:
    """Return the output of a session with ``--pdb`` whose debugger gets commands."""
    return pytester.run(sys.executable, "-m", "pytest", "--pdb", "-p", "no:cacheprovider", stdin=commands.encode()).stdout


@pytest.mark.parametrize(
    "does",
    [
        IN_A_LIBRARY,
        pytest.param(RAISES, marks=pytest.mark.extended),
        pytest.param(IN_AN_INSTALLED_PACKAGE, marks=pytest.mark.extended),
        pytest.param(IN_THIS_PACKAGE, marks=pytest.mark.extended),
    ],
)
def test_the_debugger_stops_in_the_line_of_the_driver(pytester: pytest.Pytester, write: Write, does: str) -> None:
    write(does)
    stops = ["*entering PDB*", f"> *test_it.py({LINE})decide()", "*'a secret local'*"]
    debugged(pytester, "up\np secret\nc\n" * 2).fnmatch_lines(stops * 2)


def test_the_cause_that_a_driver_names_is_shown(pytester: pytest.Pytester, write: Write) -> None:
    write('raise ValueError("no plan") from KeyError("the lane")')
    result = pytester.runpytest("-k", "full_stop")
    result.stdout.fnmatch_lines(["KeyError: 'the lane'", "*direct cause*", "E *raised ValueError: no plan*"])


def test_a_test_that_names_its_rules_shows_the_frames_too(pytester: pytest.Pytester, write: Write) -> None:
    text = DRIVER.replace(', rules=("full_stop", "no_collision")', "").replace("run, rule, monitor", "run, monitor")
    write(RAISES, text.replace("monitor.check(rule)", 'monitor.check("progress")'))
    result = pytester.runpytest()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [f">*{RAISES}", f"E *ERROR: Odd driving a0 raised ValueError: an odd moment (test_it.py:{LINE})*"]
    )


def test_an_error_while_an_autopilot_is_made_shows_its_frames(pytester: pytest.Pytester, write: Write) -> None:
    text = DRIVER.replace(
        "    class Odd(rvads.Follower):\n", "    class Odd(rvads.Follower):\n        def __init__(self):\n            len(5)\n\n"
    )
    write("pass", text)
    result = pytester.runpytest()
    result.stdout.fnmatch_lines([">*len(5)", "E *ERROR: making Odd for a0 raised TypeError: * (test_it.py:10)"])


@pytest.mark.extended
def test_a_driver_that_hangs_in_a_library_is_told_by_its_own_line(pytester: pytest.Pytester, write: Write) -> None:
    installed = Path("site-packages/library.py")
    installed.write_text("def deep(seen):\n    while True:\n        pass\n", encoding="utf-8")
    write(IN_AN_INSTALLED_PACKAGE)
    result = pytester.runpytest("-o", "rvads_decision_limit=0.3", "-k", "full_stop")
    result.stdout.fnmatch_lines([f"*{IN_AN_INSTALLED_PACKAGE}", f"E *no answer within 0.3 s *, it was at test_it.py:{LINE}"])


WORD = """
    import numpy as np
    import pytest
    import pytest_rvads as rvads

    @rvads.predicate("odd", "agent")
    def odd(run, a):
        return np.linalg.inv(np.zeros((2, 2)))

    RULE = rvads.rule("mine", "forall a. G !odd(a)")
    rvads_autopilot = pytest.fixture(lambda: rvads.Reference)

    @rvads.scenario("stop4", subject=0, scenarios="1000", grid="C", duration=0.5, rules=[RULE])
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""


def test_an_error_in_a_word_is_told_by_its_own_line(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=WORD)
    result = pytester.runpytest()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["test_it.py:7: in odd", "E *LinAlgError: Singular matrix"])
    result.stdout.fnmatch_lines(["*1 x mine: LinAlgError: Singular matrix (test_it.py:7)"])
    assert "judge.py" not in result.stdout.str()
    debugged(pytester, "q\n").fnmatch_lines(["> *test_it.py(7)odd()"])


@pytest.mark.parametrize("hook", ["rules", "junctions", "grids"])
def test_an_error_in_a_hook_shows_the_frames_of_the_hook(pytester: pytest.Pytester, hook: str) -> None:
    pytester.makepyfile(test_it=WORD)
    pytester.makeconftest(f"def pytest_rvads_{hook}(config):\n    return made()\n\ndef made():\n    raise KeyError('a name')\n")
    result = pytester.runpytest()
    result.stdout.fnmatch_lines([f"conftest.py:2: in pytest_rvads_{hook}", "conftest.py:5: in made", "E   KeyError: 'a name'"])
    assert "extensions.py" not in result.stdout.str()
    assert "expansion.py" not in result.stdout.str()


def test_an_error_in_the_hook_of_verdicts_is_told_with_its_frames(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=WORD.replace("return np.linalg.inv(np.zeros((2, 2)))", "return run.speed[:, a] > 99"))
    pytester.makeconftest("def pytest_rvads_verdict(record):\n    made()\n\ndef made():\n    raise KeyError('a name')\n")
    result = pytester.runpytest()
    result.stdout.fnmatch_lines(
        [
            "rvads: a hook pytest_rvads_verdict raised KeyError: 'a name' (conftest.py:5)",
            '  File "*conftest.py", line 2, in pytest_rvads_verdict',
            '  File "*conftest.py", line 5, in made',
        ]
    )
    assert "main_process.py" not in result.stdout.str()


def test_a_stack_in_python_shows_its_traceback(pytester: pytest.Pytester) -> None:
    client = Path(__file__).parents[2] / "clients" / "python"
    pytester.makepyfile(
        stack=f"""
        import sys
        sys.path.insert(0, {str(client)!r})
        import json
        import rvads_client

        def decide(seen):
            return json.loads("5.0" if seen.time < 0.5 else "no number")

        for seen in rvads_client.connect("mine"):
            seen.answer(target_speed=decide(seen))
        """,
        test_it="""
        import pytest_rvads as rvads

        @rvads.scenario("stop4", subject=0, scenarios="1000", grid="C", duration=1.5, rules=("full_stop", "no_collision"))
        def test_rules(run, rule, monitor):
            monitor.check(rule)
        """,
    )
    result = pytester.runpytest("-vv", "--rvads-sut", f"{sys.executable} stack.py", "test_it.py")
    result.assert_outcomes(errors=2)
    told = [
        "*its standard error ends with: json.decoder.JSONDecodeError: * (stack.py:7)",
        '  File "*stack.py", line 7, in decide',
    ]
    result.stdout.fnmatch_lines(["*ERROR at setup*full_stop*", *told, "*ERROR at setup*no_collision*", *told])


SPEEDS = "return 5.0"
"""The driver breaks `full_stop`, and prints."""
PRINTS = [
    "*Captured stdout of the run*",
    "printed by the driver",
    "*Captured stderr of the run*",
    "told as an error",
    "*Captured log of the run*",
    "*logged by the driver",
]


@pytest.mark.parametrize(
    "options", [("-vv",), ("-vv", "--capture=sys"), pytest.param(("-vv", "-n1"), marks=pytest.mark.extended)]
)
def test_every_failing_item_shows_what_the_driver_printed(
    pytester: pytest.Pytester, write: Write, options: tuple[str, ...]
) -> None:
    write(RAISES)
    result = pytester.runpytest(*options)
    result.stdout.fnmatch_lines(["*ERROR at setup*full_stop*", *PRINTS, "*ERROR at setup*no_collision*", *PRINTS])
    assert result.stdout.str().count("printed by the driver\n") == 2


@pytest.mark.parametrize("takes", ["", ", capsys", ", capfd"])
def test_what_was_printed_for_an_item_that_did_not_fail_is_shown_by_one_that_fails(
    pytester: pytest.Pytester, write: Write, takes: str
) -> None:
    text = DRIVER.replace('("full_stop", "no_collision")', '("speed_limit", "full_stop")').replace("duration=1.5", "duration=6")
    text = text.replace("def test_rules(run,", f"def test_rules({takes.lstrip(', ')}{', ' if takes else ''}run,")
    write(SPEEDS, text)
    result = pytester.runpytest()
    result.assert_outcomes(skipped=1, failed=1)
    result.stdout.fnmatch_lines(["*test_rules*full_stop*", *PRINTS])
    lines = result.stdout.lines
    assert sum("printed by the driver" in line for line in lines) == 1, "the repetition of the failed run leaves nothing"
    (dots,) = (line for line in lines if re.match(r"test_it.py \S+ +\[", line))
    assert dots.split()[1].endswith("F")


def test_rp_shows_what_was_printed_for_an_item_that_passed(pytester: pytest.Pytester, write: Write) -> None:
    text = DRIVER.replace("monitor.check(rule)", "pass").replace("run, rule, monitor", "run")
    write(SPEEDS, text.replace(', rules=("full_stop", "no_collision")', ""))
    result = pytester.runpytest("-rP")
    result.assert_outcomes(passed=1)
    result.stdout.fnmatch_lines(PRINTS)


def test_with_s_the_driver_prints_at_once(pytester: pytest.Pytester, write: Write) -> None:
    write(RAISES)
    result = pytester.runpytest("-s")
    before, _, after = result.stdout.str().partition("ERROR at setup")
    assert before.count("printed by the driver\n") == 2, "the failed run is simulated once more"
    assert "\nprinted by the driver\n" not in after


def test_what_a_fixture_printed_before_stays_where_pytest_shows_it(pytester: pytest.Pytester, write: Write) -> None:
    before = '@pytest.fixture(autouse=True)\n    def before():\n        print("printed by a fixture")\n\n    '
    write(RAISES, DRIVER.replace("@pytest.fixture", f"{before}@pytest.fixture"))
    result = pytester.runpytest("-k", "full_stop")
    result.stdout.fnmatch_lines_random(["printed by a fixture", "printed by the driver"])
    result.stdout.fnmatch_lines(["*Captured stdout setup*", "printed by a fixture"])

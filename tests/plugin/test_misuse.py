"""Wrong use gives one sentence that helps, and hides nothing else."""

import inspect
import re
from collections.abc import Callable, Sequence
from dataclasses import fields

import pytest

import pytest_rvads as rvads
from pytest_rvads.runs.readers import READERS
from pytest_rvads.runs.run import Run
from pytest_rvads.session.collection.ask import Ask
from pytest_rvads.support.errors import ScenarioError

Make = Callable[..., Run]

BODY = """import pytest_rvads as rvads


@rvads.scenario(
    {arguments}
)
def test_it(run, rule, monitor):
    monitor.check(rule)
"""
LINE = 4
"""Of the mark in BODY."""


def refused(pytester: pytest.Pytester, cases: Sequence[tuple[str, int, str]]) -> None:
    """Check that each file is refused in one sentence that begins with the line of the mark, and nothing of the inside shows.

    cases: content of the file, line of the mark, part of the sentence, in which FILE stands for the name of the file.
    """
    pytester.makepyfile(**{f"test_{number}": code for number, (code, _, _) in enumerate(cases)})
    # Where it interrupts a session, pytest parses its own sources for a traceback that nobody sees, which takes half of the time.
    result = pytester.runpytest("--continue-on-collection-errors")
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    for number, (code, line, says) in enumerate(cases):
        file = f"test_{number}.py"
        (sentence,) = [text for text in result.outlines if text.startswith(f"{file}:{line}: ")]
        assert says.replace("FILE", file) in sentence, code
    result.stdout.no_fnmatch_line("*Traceback*")
    result.stdout.no_fnmatch_line("*/pytest_rvads/session/collection/*")
    result.assert_outcomes(errors=len(cases))


ARGUMENTS = [
    ("3", "write @rvads.scenario('stop4', ...) with the name of a junction in quotes, got 3"),
    ("", "name a junction, several junctions, or '*' for all junctions of a map"),
    ('["stop4", 3]', "junction takes names, ids or types of junctions, one or several, got ['stop4', 3]"),
    ("[]", "junction is empty: name names, ids or types of junctions, or leave it out"),
    ('"*", limit=0', "limit must be a whole number of junctions, 1 or more, got 0"),
    ('"*", limit="2"', "limit must be a whole number of junctions, 1 or more, got '2'"),
    ('"*", junctions="stop"', "kinds of junctions are a dict such as {'control': 'stop', 'arms': (3, 4)}, got 'stop'"),
    ('junctions={"control": "sign"}', "control of kinds of junctions must be one or several of stop, lights, none, yield, "),
    ('"stop4", map=3', "map must be the path of a map file, got 3"),
    ('"stop4", clases=3', "@rvads.scenario takes junction, map, junctions, limit, classes, "),
    ('"stop4", clases=3', "got 'clases'; did you mean 'classes'"),
    ('"stop4", cover="all"', "cover must be one of class, scenario, rotation, partial, pairs, conflicts, got 'all'"),
    ('"stop4", probe="no"', "probe must be True or False, got 'no'"),
    ('"stop4", classes=1.0', "classes takes class numbers, one or several, got 1.0"),
    ('"stop4", classes=True', "classes takes class numbers, one or several, got True"),
    ('"stop4", classes="7"', "classes takes class numbers, one or several, got '7'"),
    ('"stop4", classes=(1, None)', "classes takes class numbers, one or several, got (1, None)"),
    ('"stop4", classes=[]', "classes is empty: name class numbers, or leave it out"),
    ('"stop4", classes=1, scenarios="1133"', "give classes= or scenarios=, not both: a scenario names its class"),
    ('"stop4", scenarios=[]', "scenarios is empty: name direction strings"),
    ('"stop4", scenarios=1133', "scenarios takes direction strings such as '1133', one or several, got 1133"),
    ('"stop4", grid=()', "grid is empty: name letters of configurations or names of grids, or leave it out"),
    ('"stop4", grid=4', "grid takes letters of configurations or names of grids, one or several, got 4"),
    ('"stop4", grid="C", distances=3', "give either grid=, or distances= with speeds="),
    ('"stop4", speeds=3', "give either grid=, or distances= with speeds="),
    ('"stop4", distances=-3', "distances must be 0 or more and finite, got -3"),
    ('"stop4", distances=[1, (1, 2, 3, "4")]', "distances must be 0 or more and finite, got '4'"),
    ('"stop4", distances=float("nan")', "distances must be 0 or more and finite, got nan"),
    ('"stop4", distances="far"', "distances takes numbers, got 'far'"),
    ('"stop4", distances=[]', "distances is an empty list: give at least one value"),
    ('"stop4", distances=1, speeds={}', "speeds takes numbers, got {}"),
    ('"stop4", rules=()', "rules is empty: name rules or names of rules or rulebooks, or leave it out"),
    ('"stop4", rules=3', "rules takes rules or names of rules or rulebooks, one or several, got 3"),
    ('"stop4", duration=0', "duration must lie above 0 and up to 3600 s, got 0"),
    ('"stop4", duration="long"', "duration must be a number of seconds, got 'long'"),
    ('"stop4", aggression=4', "aggression must be 1, 2 or 3, got 4"),
    ('"stop4", followers=10', "followers must be a whole number from 0 to 9, got 10"),
    ('"stop4", followers="x"', "followers takes numbers of vehicles that queue behind each, one or several, got 'x'"),
    ('"stop4", occupancy="all"', "occupancy must be one of arms, lanes, got 'all'"),
    ('"stop4", cover="pairs", classes=3', "cover='pairs' chooses scenarios itself: leave classes= and scenarios= out"),
    ('"stop4", cover="partial", scenarios="1020"', "cover='partial' chooses scenarios itself: leave classes= and"),
    ('"stop4", wait=-1', "wait must be 0 s or more, got -1"),
    ('"stop4", requirement=7', "requirement takes identifiers of requirements, one or several, got 7"),
]


def test_invalid_argument_is_an_error_at_the_line_of_the_mark(pytester: pytest.Pytester) -> None:
    codes = [BODY.format(arguments=arguments) for arguments, _ in ARGUMENTS]
    refused(pytester, [(code, LINE, says) for code, (_, says) in zip(codes, ARGUMENTS, strict=True)])
    for code, (_, says) in zip(codes, ARGUMENTS, strict=True):
        with pytest.raises(ScenarioError, match=re.escape(says)):  # where pytest does not run the file
            exec(compile(code, "a.py", "exec"), {})


def test_parameters_of_the_mark_stand_once_and_type_checkers_know_them() -> None:
    parameters = inspect.signature(rvads.scenario).parameters
    described = re.findall(r"^    (\w+): ", (inspect.getdoc(rvads.scenario) or "").partition("Args:")[2], re.MULTILINE)
    assert described == [*parameters, "ScenarioError"]
    assert [*parameters] == [argument.name for argument in fields(Ask)][1:]
    with pytest.raises(ScenarioError, match="clases"):
        rvads.scenario("stop4", clases=3)  # type: ignore[call-arg]
    with pytest.raises(ScenarioError, match="limit must be"):
        rvads.scenario("*", limit="2")  # type: ignore[arg-type]
    with pytest.raises(ScenarioError, match="place"):
        rvads.scenario("stop4", place="here")  # type: ignore[call-arg]


SESSIONS = [
    ('"stop5"', "unknown junction 'stop5': the built-in ones are stop4"),
    ('"1", map="nowhere.xodr"', "map file /"),
    ('"stop4", rules="p9"', "unknown rule 'p9'"),
    ('"stop4", distances=500', "distance 500 m does not fit on entrance 0 of junction 'stop4'"),
    ('"stop4", distances=(1, 2)', "distances needs one value, or one per entrance (4), got 2: (1, 2)"),
    ('"stop4", distances=1, speeds=11', "every point of distances=[1], speeds=[11] is too fast to stop before the line"),
    ('"stop4", grid="Q"', "unknown configuration 'Q'"),
    ('"stop4", classes=25', "a 4-way junction has classes 1..24, got 25"),
    (
        '"stop4", scenarios="1144"',
        "direction 4 is none of entrance 2 of junction 'stop4', its movements lead into 1, 2, 3, and 0 is",
    ),
    ('"stop4", scenarios="1a11"', "direction 10 is none of entrance 1 of junction 'stop4'"),
    ('"stop4", followers=9, distances=70', "distance 122.8 m does not fit on entrance 0 of junction 'stop4', where a0+8"),
    ('"stop4", scenarios="113"', "scenario '113' names 3 entrances, junction 'stop4' has 4"),
    (
        '"stop4", cover="rotation", classes=range(1, 25), distances=list(range(40)), probe=True',
        "would expand to 11,520 items",
    ),
]


def test_session_errors_name_the_line_of_the_mark(pytester: pytest.Pytester) -> None:
    refused(pytester, [(BODY.format(arguments=asked), LINE, f": FILE::test_it: {says}") for asked, says in SESSIONS])


SEARCHES = [
    ('3, rule="p1"', "junction must be a name in quotes or what rvads.find returns, got 3"),
    ('"stop9", rule="p1"', "unknown junction 'stop9': the built-in ones are stop4"),
    ('"1", rule="p1", map="nowhere.xodr"', "map file nowhere.xodr"),
    ('"stop4", rule=3', "rule must be the name of a rule in quotes, or a rule, got 3"),
    ('"stop4", rule="p1", autopilot=3', "an autopilot must be a class or a callable that makes one, got 3"),
    ('"stop4", rule="p1", budget=True', "budget must be a number of simulations, at least 1, got True"),
    ('"stop4", rule="p1", seed="x"', "seed must be a whole number, got 'x'"),
    ('"stop4", rule="p1", subjct=0', "must be map, subject, partial, near, "),
    ('"stop4", rule="p1", subjct=0', "got 'subjct'; did you mean 'subject'"),
    ('"stop4", rule="p1", subject=9', "subject must be an entrance of 'stop4', 0 to 3, got 9"),
    ('"stop4", rule="p1", partial=1', "partial must be True or False, got 1"),
    ('"stop4", rule="p1", near="x"', "near must be a distance of 0 m or more, got 'x'"),
    ('"stop4", rule="p1", far=float("inf")', "far must be a distance of 0 m or more, got inf"),
    ('"stop4", rule="p1", near=20, far=5', "near must be less than far, got 20 and 5 m: vehicles start between them"),
    ('"stop4", rule="p1", near=30', "near must be less than far, got 30 and 30.0 m"),
    ('"stop4", rule="p1", near=900, far=1000', "near must be less than the shortest approach of 'stop4', "),
    (
        'rvads.find("stop4"), rule="p1", map="x.xodr"',
        "map= names the map of a junction given by id, got map= with junction 'stop4'",
    ),
    ('"stop4", rule=rvads.Rule("p1", "forall a. F a@j & true")', "'p1' is a shipped rule and "),
    ('"stop4", rule="p1", pace=2', "pace must be a share of v(d)max, from 0 to 1, got 2"),
    ('"stop4", rule="p1", wait=3', "wait must be the least and the greatest number of seconds, such as (0, 4), got 3"),
    ('"stop4", rule="p1", aggression=4', "aggression must be 1, 2 or 3, got 4"),
    ('"stop4", rule="p1", duration=0', "duration must lie above 0 and up to 3600 s, got 0"),
    ('"stop4", rule="p1", traffic="hesitant"', "traffic= drives the vehicles around a subject: add subject=0, or leave"),
    ('"stop4", rule="p1", subject=0, traffic=3', "traffic takes names of policies or classes of autopilots, got 3"),
]


def test_invalid_search_is_an_error_at_its_line(pytester: pytest.Pytester) -> None:
    search = "import pytest_rvads as rvads\n\n@rvads.falsify({})\ndef test_it(): ..."
    refused(pytester, [(search.format(asked), 3, says) for asked, says in SEARCHES])


SUBJECTS = [
    ('"stop4", subject=7', "subject must be an entrance, 0 to 3, or 'all', got 7"),
    ('"stop4", traffic="hesitant"', "traffic= drives the vehicles beside a subject"),
    ('"stop4", subject=0, traffic="polite"', "unknown traffic 'polite', there are reference, hesitant"),
    ('"stop4", subject=0, traffic=()', "traffic is empty"),
    ('"stop4", subject=0, traffic=3', "traffic takes names of policies or classes of autopilots, got 3"),
    ('"stop4", subject=1, scenarios="1033"', "subject must be an occupied entrance of 1033, got 1"),
    ('"stop4", subject="all", cover="rotation", rules="road"', "would expand to 19,200 items (384 scenarios × 5 points ×"),
    ("'stop4', subject=0, senses={'dely': 1}", "got 'dely'; did you mean 'delay'"),
    ("'stop4', subject=0, senses=0.2", "senses takes rvads.Senses(...) or a dict of their fields, one or several, got 0.2"),
    ("'stop4', subject=0, senses=[]", "senses is empty"),
]


def test_invalid_subject_traffic_and_senses_are_errors_at_the_line_of_the_mark(pytester: pytest.Pytester) -> None:
    refused(pytester, [(BODY.format(arguments=asked), LINE, says) for asked, says in SUBJECTS])


def test_two_searches_of_a_session_do_not_call_different_rules_by_one_name(pytester: pytest.Pytester) -> None:
    code = 'import pytest_rvads as rvads\n\n@rvads.falsify("stop4", rule=rvads.Rule("mine", "{}"))\ndef test_it(): ...'
    pytester.makepyfile(test_a=code.format("forall a. F a@j"))
    pytester.makepyfile(test_b=code.format("forall a. G !a@j"))
    result = pytester.runpytest("--collect-only", "-p", "no:cacheprovider")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(
        ["test_b.py:3: 'mine' is registered at * and says something else at *: give each a name of its own"]
    )


def test_search_must_be_a_plain_function(pytester: pytest.Pytester) -> None:
    head = "import pytest_rvads as rvads\n\n@rvads.falsify('stop4', rule='p1')\n"
    unread = "@rvads.falsify calls the body of a test, got test_it, whose body a call would not run: write it as a plain def"
    odd = ("async def test_it(): ...", "async def test_it(): yield", "def test_it(): yield")
    item = ("class TestIt:\n    def test_it(self): ...", "@rvads.falsify makes a test of a function or method, got <class '")
    refused(pytester, [(head + code, 3, says) for code, says in (*((code, unread) for code in odd), item)])


RECORDED = """import pytest
import pytest_rvads as rvads
"""
"""The code of the next tests goes on in line 3."""


RECORDINGS = [
    ("@rvads.recorded()\ndef test_it(run): ...", 3, "@rvads.recorded needs files to judge: give it one or several, such as"),
    ("@rvads.recorded(3)\ndef test_it(run): ...", 3, "write @rvads.recorded('drives/*.npz', ...) with files, folders or"),
    ("@rvads.recorded('')\ndef test_it(run): ...", 3, "patterns in quotes, got ''"),
    ("@rvads.recorded('a\\0b')\ndef test_it(run): ...", 3, "patterns in quotes, got 'a\\x00b'"),
    ("@rvads.recorded\ndef test_it(run): ...", 3, "patterns in quotes, got <function test_it"),
    (
        "@rvads.recorded('a.json', rule='p1')\ndef test_it(run): ...",
        3,
        "got 'rule'; did you mean 'rules'",
    ),
    ("@rvads.recorded('a.json', rules=[])\ndef test_it(run): ...", 3, "rules is empty: name rules or names of rules or"),
    ("@rvads.recorded('a.json', requirement=3)\ndef test_it(run): ...", 3, "requirement takes identifiers of requirements,"),
    ("@rvads.recorded('no/*.npz')\ndef test_it(run): ...", 3, "test_it: no file matches 'no/*.npz', looked for in "),
    ("@rvads.recorded('x' * 999)\ndef test_it(run): ...", 3, "test_it: no file matches 'xxx"),
    ("@rvads.recorded('no[*')\ndef test_it(run): ...", 3, "test_it: no file matches 'no[*'"),
    ("@rvads.recorded('a.json', rules='p0')\ndef test_it(run, rule): ...", 3, "test_it: unknown rule 'p0'"),
    (
        "@rvads.recorded('a.json', rules='p1')\ndef test_it(run): ...",
        3,
        "test_it: rules= is what the argument `rule` of a test runs over: add that argument, or leave rules= out",
    ),
    (
        "@rvads.recorded('a.json', 'b/*.json')\ndef test_it(run): ...",
        3,
        "b/a.json would both be called 'a' in ids: ",
    ),
    (
        "@rvads.recorded('a.json')\ndef test_it(): ...",
        3,
        "test_it has @rvads.recorded(...) but takes neither run nor ",
    ),
    (
        "@rvads.recorded('a.json')\n@rvads.scenario('stop3')\ndef test_it(run): ...",
        3,
        "test_it has @rvads.recorded(...) and @rvads.scenario(...), but a run is one or the other: make two tests of it",
    ),
    (
        "@pytest.mark.parametrize('run', [1])\n@rvads.recorded('a.json')\ndef test_it(run, monitor): ...",
        4,
        "test_it has @rvads.recorded(...), which gives it its `run`: parametrize another argument",
    ),
    ("def test_it(rvads_recorded): ...", 3, "test_it asks for a run, but no @rvads.recorded(...) says which: add the mark"),
    (
        "@rvads.scenario('stop3')\ndef test_it(rvads_recorded): ...",
        3,
        "test_it has @rvads.scenario(...) but takes rvads_recorded, a run that nobody simulated: take run instead",
    ),
    (
        "@pytest.mark.rvads_recorded('a')\ndef test_it(run): ...",
        3,
        "write @rvads.recorded(...) instead of pytest.mark.",
    ),
    (
        "@rvads.known('I1', recording='b')\n@rvads.recorded('a.json')\ndef test_it(run): ...",
        3,
        "test_it: @rvads.known('I1', recording=('b',)) matches none of the 1 cells of this test",
    ),
]


def test_invalid_recorded_mark_is_an_error_at_its_line(
    pytester: pytest.Pytester, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = make("stop4", {0: (2, 10, 20, None)}, 30)
    monkeypatch.setitem(READERS, ".json", lambda _: [run])
    (pytester.path / "b").mkdir()
    for name in ("a.json", "b/a.json"):
        (pytester.path / name).touch()
    refused(pytester, [(RECORDED + code, line, says) for code, line, says in RECORDINGS])


HEAD = """import pytest
import unittest
import pytest_rvads as rvads
mine = rvads.scenario("stop3", grid="C", classes=1)
"""
"""The code of the next tests goes on in line 5."""


MARKS = [
    ("@rvads.scenario\ndef test_it(run): ...", 5, "write @rvads.scenario('stop4', ...) with the name of a junction in quotes"),
    ("def test_it(run): ...", 5, "test_it asks for a run, but no @rvads.scenario(...) says which: add the mark"),
    ("@mine\ndef test_it(): ...", 4, "test_it has @rvads.scenario(...) but takes neither run nor monitor: add an argument"),
    (
        "@pytest.fixture\ndef run(): ...\n@rvads.scenario('stop3')\ndef test_it(run): ...",
        7,
        "test_it has @rvads.scenario(...) but its `run` is a fixture of yours: rename your fixture",
    ),
    (
        "@mine\n@pytest.mark.parametrize('x, run', [(1, 1)])\ndef test_it(x, run, monitor): ...",
        4,
        "test_it has @rvads.scenario(...), which gives it its `run`: parametrize another argument",
    ),
    (
        "pytestmark = [mine,\n    rvads.scenario('stop3', classes=9)]\ndef test_it(run): ...",
        6,
        "test_it: a 3-way junction has classes 1..4, got 9",
    ),
    (
        "@rvads.scenario('stop3', rules='p9')\ndef test_it(run): ...",
        5,
        "test_it: rules= is what the argument `rule` of a test runs over: add that argument, or leave rules= out",
    ),
    (
        "far = rvads.scenario('stop5')\n@far\nclass TestIt:\n    def test_it(self, run): ...",
        5,
        "TestIt::test_it: unknown junction 'stop5'",
    ),
    (
        "@rvads.scenario('stop3', grid='C', classes=1, duration=5)\n@mine\ndef test_it(run): ...",
        5,
        "two different scenarios have the id 'stop3-class01-as111-cfgC': they differ in duration,",
    ),
    (
        "@rvads.known('I1', klass=3)\n@mine\ndef test_it(run): ...",
        5,
        "selects by junction, cls, scenario, cfg, rotation, seat,",
    ),
    ("@rvads.known('I1', clas=3)\n@mine\ndef test_it(run): ...", 5, "got 'clas'; did you mean 'cls'"),
    ("@rvads.known('I1', cls=[])\n@mine\ndef test_it(run): ...", 5, "cls is empty: name words or numbers, or leave it out"),
    (
        "@rvads.known('I1', cls=None)\n@mine\ndef test_it(run): ...",
        5,
        "cls takes words or numbers, one or several, got (None,)",
    ),
    ("@rvads.known('I1', cls=1.5)\n@mine\ndef test_it(run): ...", 5, "cls takes words or numbers, one or several, got 1.5"),
    ("@rvads.known(1, cls=3)\n@mine\ndef test_it(run): ...", 5, "name of @rvads.known must be a text in quotes, got 1"),
    (
        "@rvads.known('I1', reason=2)\n@mine\ndef test_it(run): ...",
        5,
        "reason of @rvads.known must be a text in quotes, got 2",
    ),
    (
        "@mine\n@rvads.known('I1', cls=(1, 2), rule='p1')\ndef test_it(run): ...",
        6,
        "test_it: @rvads.known('I1', cls=(1, 2), rule=('p1',)) matches none of the 1 cells of this test",
    ),
]


def test_invalid_mark_is_an_error_at_its_line(pytester: pytest.Pytester) -> None:
    refused(pytester, [(HEAD + code, line, says) for code, line, says in MARKS])


@pytest.mark.parametrize(
    ("code", "line", "says"),
    [
        (
            "@rvads.known('I1', cls=4)\n@mine\nclass TestIt:\n    def test_it(self, run): ...",
            5,
            "TestIt: @rvads.known('I1', cls=(4,)) matches no cell of any of its tests",
        ),
        (
            "@rvads.known('I1', cls=4)\ndef test_it(): ...",
            5,
            "test_it: @rvads.known('I1', cls=(4,)) matches no cell of any of its tests",
        ),
        (
            "class TestIt(unittest.TestCase):\n    @mine\n    def test_it(self): ...",
            4,
            "TestIt::test_it has @rvads.scenario(...), which works on functions and classes of pytest only",
        ),
        (
            "@mine\nclass TestIt(unittest.TestCase):\n    def test_it(self): ...",
            4,
            "TestIt::test_it has @rvads.scenario(...), which works on functions and classes of pytest only",
        ),
    ],
)
def test_marks_without_effect_end_the_session(pytester: pytest.Pytester, code: str, line: int, says: str) -> None:
    file = pytester.makepyfile(HEAD + code)
    result = pytester.runpytest()
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([f"ERROR: {file.name}:{line}: {file.name}::{says}"])


def test_mark_in_another_file_is_reported_by_that_file(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(marks="import pytest_rvads as rvads\n\nfar = rvads.scenario('stop3', classes=9)\n")
    pytester.makepyfile("from marks import far\n\n@far\ndef test_far(run): ...\n")
    pytester.syspathinsert()
    pytester.runpytest().stdout.fnmatch_lines(["marks.py:3: *::test_far: a 3-way junction has classes 1..4, got 9"])


@pytest.mark.parametrize("name", ["scenario", "known"])
def test_marks_of_pytests_own_making_are_refused(pytester: pytest.Pytester, name: str) -> None:
    pytester.makepyfile(f"{HEAD}@mine\n@pytest.mark.rvads_{name}('stop4')\ndef test_it(run): ...\n")
    pytester.runpytest().stdout.fnmatch_lines(
        [f"*.py:5: *::test_it: write @rvads.{name}(...) instead of pytest.mark.rvads_{name}(...)"]
    )


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ("--rvads-max-items=0", "*must be a whole number from 1 to 999999999, got '0'*"),
        (f"--rvads-max-items={'9' * 5000}", "*must be a whole number from 1 to 999999999, got '999*"),
        ("--rvads-grid=Q", "*unknown conf*"),
        ("--rvads-autopilot=", "*--rvads-autopilot needs a value, got ''*"),
        ("--rvads-sut= ", "*--rvads-sut needs a value, got ' '*"),
        ("--rvads-baseline=", "*--rvads-baseline needs a value, got ''*"),
        ("--rvads-sut-rate=33", "*rvads_sut_rate must divide 100, such as 10, 20, 25 or 50, got '33'*"),
        ("--rvads-sut-rate=0", "*rvads_sut_rate must divide 100, such as 10, 20, 25 or 50, got '0'*"),
        ("--rvads-sut-timeout=0", "*rvads_sut_timeout must be a number above 0, at most 3600, got '0'*"),
    ],
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
    result.stderr.fnmatch_lines(
        ["*rvads_cover must be one of class, scenario, rotation, partial, pairs, conflicts, got 'everything'*"]
    )


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


@pytest.mark.extended
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


def test_invalid_vehicle_names_its_fixture(pytester: pytest.Pytester) -> None:
    pytester.makeconftest("import pytest\n\n@pytest.fixture\ndef rvads_vehicle():\n    return 3\n")
    pytester.makepyfile(BODY.format(arguments='"stop4", classes=1, grid="C", rules="p1"'))
    result = pytester.runpytest()
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*a fleet, as the fixture rvads_vehicle, needs a rvads.Vehicle(...), got 3"])
    result.stdout.no_fnmatch_line("*Traceback*")
    result.stdout.no_fnmatch_line("*AttributeError*")

"""What a conftest or helper registers is for all test files, what a test file registers for that file, whatever the order."""

import re

import pytest

pytestmark = pytest.mark.usefixtures("reference")

ASKS = """
@rvads.scenario("stop4", scenarios="1000", distances=0.3, rules={rules})
def test_{name}(monitor, rule):
    monitor.check(rule)
"""
MINE = "rvads.rule('mine', 'forall a. F a@j')\n"
OTHER = "rvads.rule('mine', 'forall a. G a@j')\n"
KNOWN = "from pytest_rvads.logic.rules.book import current_book\nknown = lambda: sorted(r.name for r in current_book().own)\n"


def write(pytester: pytest.Pytester, **files: str) -> None:
    """Write files that begin with what all of them import."""
    pytester.makepyfile(**{name: f"import pytest\nimport pytest_rvads as rvads\n{KNOWN}{text}" for name, text in files.items()})


def asks(rules: str = "'mine'", name: str = "asked") -> str:
    return ASKS.format(rules=rules, name=name)


@pytest.mark.parametrize("order", [("test_a.py", "test_c.py"), ("test_c.py", "test_a.py")])
def test_what_a_test_file_registers_is_unknown_in_another(pytester: pytest.Pytester, order: tuple[str, str]) -> None:
    write(pytester, test_a=MINE + asks(), test_c=asks())
    result = pytester.runpytest("--collect-only", "-q", *order)
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*test_a.py::test_asked?*mine?", "*test_c.py:*unknown rule 'mine'*"])
    if order[0] == "test_a.py":
        told = "registers it for that file or test alone: move it to a conftest, or into a module that is no test file"
        result.stdout.fnmatch_lines([f"*; *test_a.py:5 {told}"])


def test_registrations_of_conftest_and_helpers_reach_every_file(pytester: pytest.Pytester) -> None:
    """A helper is imported once, by whichever file comes first."""
    helper = "rvads.rule('helped', 'forall a. F a@j')\n"
    importing = "import helper\n" + asks("['mine', 'helped']")
    write(pytester, conftest=MINE, helper=helper, test_a=importing, test_b=importing)
    result = pytester.runpytest("--collect-only", "-q")
    result.assert_outcomes()
    assert [sum(f"{file}.py::test_asked" in line for line in result.outlines) for file in ("test_a", "test_b")] == [2, 2]


REGISTERED = {
    "rule": (MINE, OTHER),
    "predicate": tuple(
        f"@rvads.predicate('mine', 'agent')\ndef fast(run, a):\n    return run.speed[:, a] > {limit}\n" for limit in (3, 300)
    ),
    "global": tuple(
        f"LIMIT = {limit}\n@rvads.predicate('mine', 'agent')\ndef fast(run, a):\n    return run.speed[:, a] > LIMIT\n"
        for limit in (3, 300)
    ),
    "value": tuple(asks(f"rvads.Rule('mine', 'forall a. {text}')") for text in ("F a@j", "G a@j")),
    "one of each": (MINE, asks("rvads.Rule('mine', 'forall a. G a@j')")),
}
"""Under one name, what two files say differently."""


@pytest.mark.parametrize("said", REGISTERED.values(), ids=REGISTERED)
@pytest.mark.parametrize("turned", [False, True])
def test_one_name_for_two_things_is_told_with_both_places(pytester: pytest.Pytester, said: tuple[str, str], turned: bool) -> None:
    one, two = reversed(said) if turned else said
    write(pytester, test_a=one, test_b=two)
    result = pytester.runpytest("--collect-only", "-q", "--continue-on-collection-errors")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*'mine' is registered at *test_a.py:* and says something else at *test_b.py:*"])


def test_a_wrong_formula_is_told_at_the_line_that_registers_it(pytester: pytest.Pytester) -> None:
    write(pytester, test_a="rvads.rule('mine', 'forall a. G(')\n")
    shown = pytester.runpytest("--collect-only", "-q").stdout.str()
    places = re.findall(r"^(\S+\.py):\d+: in ", shown, re.MULTILINE)
    assert places == ["test_a.py"]


@pytest.mark.extended
def test_one_name_for_two_rules_is_told_by_workers(pytester: pytest.Pytester) -> None:
    write(pytester, test_a=MINE, test_b=OTHER)
    result = pytester.runpytest("-q", "-n", "1")
    result.stdout.fnmatch_lines(["*'mine' is registered at *test_a.py:* and says something else at *test_b.py:*"])


def test_the_same_in_two_files_is_fine(pytester: pytest.Pytester) -> None:
    fast = "@rvads.predicate('fast', 'agent')\ndef fast(run, a):\n    return run.speed[:, a] > LIMIT\n"
    rule = "rvads.rule('calm', 'forall a. G !fast(a)')\n" + asks("'calm'")
    write(pytester, test_a=f"LIMIT = 30\n{fast}{rule}", test_b=f"LIMIT = 30\nFURTHER = 'down'\n{fast}{rule}")
    result = pytester.runpytest("-q")
    result.assert_outcomes(passed=2)


CONFTEST = """
rvads.rule("everywhere", "forall a. F a@j")

@pytest.fixture
def register():
    return lambda name, text: rvads.rule(name, text)
"""
BODIES = """
rvads.rule("mine", "forall a. F a@j")

@pytest.fixture(scope="module", autouse=True)
def set_up():
    rvads.rule("set_up", "forall a. F a@j")

@pytest.mark.parametrize("text", ["F a@j", "G a@j"])
def test_registers(text, register):
    rvads.rule("body", f"forall a. {text}")
    register("by_helper", f"forall a. {text}")
    import lazy
    assert known() == ["body", "by_helper", "everywhere", "imported", "mine", "set_up"]

class TestAfter:
    def test_after(self):
        assert known() == ["everywhere", "imported", "mine", "set_up"]
"""


def test_registrations_of_a_test_end_with_the_test(pytester: pytest.Pytester) -> None:
    """What fixtures of its file register stays in the file, and what it imports for all."""
    after = "def test_elsewhere():\n    assert known() == ['everywhere', 'imported']\n"
    write(pytester, conftest=CONFTEST, lazy="rvads.rule('imported', 'forall a. F a@j')", test_a=BODIES, test_b=after)
    pytester.runpytest("-q").assert_outcomes(passed=4)


def test_a_file_that_is_collected_for_its_examples_as_well_keeps_its_rules(pytester: pytest.Pytester) -> None:
    """It is imported once, by whichever of the two comes first."""
    test = 'def test_knows():\n    """\n    >>> known()\n    [\'mine\']\n    """\n    assert known() == ["mine"]\n'
    write(pytester, test_a=MINE + test, test_b="def test_elsewhere():\n    assert known() == []\n")
    pytester.runpytest("-q", "--doctest-modules").assert_outcomes(passed=3)


def test_later_global_registrations_reach_collected_files(pytester: pytest.Pytester) -> None:
    helper = "rvads.rule('helped', 'forall a. F a@j')\n"
    test = "def test_knows():\n    assert known() == ['helped']\n"
    write(pytester, helper=helper, test_a=test, test_b=f"import helper\n{test}")
    pytester.runpytest("-q").assert_outcomes(passed=2)


def test_a_monitor_knows_the_rules_of_the_file_and_of_the_test(pytester: pytest.Pytester) -> None:
    test = """
@rvads.scenario("stop4", scenarios="1000", distances=0.3)
def test_asked(monitor):
    rvads.rule("body", "forall a. F a@j")
    assert (monitor.verdict("mine").status, monitor.verdict("body").status) == ("PASS", "PASS")
"""
    write(pytester, test_a=MINE + test)
    pytester.runpytest("-q").assert_outcomes(passed=1)


@pytest.mark.parametrize("made", ["rvads.rule", "rvads.Rule"])
def test_rule_name_has_one_meaning_per_session(pytester: pytest.Pytester, made: str) -> None:
    """Reports would take both for one; what a test registers and nobody is judged by is its own affair."""
    test = f"""
@pytest.mark.parametrize("text", ["F a@j", "F a@j", "G a@j"])
@rvads.scenario("stop4", scenarios="1000", distances=0.3)
def test_asked(monitor, text):
    monitor.check({made}("body", f"forall a. {{text}}"))
"""
    write(pytester, test_a=test)
    result = pytester.runpytest("-q")
    result.assert_outcomes(passed=2, failed=1)
    told = "'body' is registered at *test_a.py:9 and says something else at *test_a.py:9: give each a name of its own"
    result.stdout.fnmatch_lines([f"*FormulaError: {told}*"])


FIXTURES = """
@pytest.fixture(params=["F a@j", "G a@j"])
def limit(request):
    return rvads.rule("limit", f"forall a. {request.param}")

@pytest.fixture(scope="module")
def lasting():
    return rvads.rule("lasting", "forall a. F a@j")

def test_limit(limit):
    assert known() == ["limit"]

def test_none():
    assert known() == []

def test_asks_in_its_body(request, limit):
    request.getfixturevalue("lasting")
    assert known() == ["lasting", "limit"]

def test_asks_again(lasting):
    assert known() == ["lasting"]
"""


def test_what_a_fixture_registers_lives_as_long_as_its_scope(pytester: pytest.Pytester) -> None:
    write(pytester, test_a=FIXTURES)
    pytester.runpytest("-q").assert_outcomes(passed=6)


def test_inner_session_does_not_see_registrations_of_its_test(pytester: pytest.Pytester) -> None:
    inner = "def test_knows_nothing(pytester):\n    assert known() == ['mine']\n" + (
        "    pytester.makepyfile('from pytest_rvads.logic.rules.book import current_book\\n'\n"
        "        'def test_inner():\\n    assert current_book().own == ()')\n"
        "    pytester.inline_run('-q').assertoutcome(passed=1)\n"
    )
    write(pytester, conftest="pytest_plugins = ['pytester']\n", test_a=MINE + inner)
    pytester.runpytest("-q").assert_outcomes(passed=1)


def test_a_module_that_is_collected_for_its_examples_alone_registers_for_all(pytester: pytest.Pytester) -> None:
    """What its examples register ends with them."""
    helper = 'rvads.rule("helped", "forall a. F a@j")\n\ndef example():\n    """\n    >>> known()\n    [\'helped\']\n'
    helper += '    >>> rvads.rule("mine", "forall a. F a@j")\n    <Rule mine: forall a. F a@j>\n    """\n'
    write(pytester, arules=helper, test_b="import arules\ndef test_knows():\n    assert known() == ['helped']\n")
    pytester.runpytest("-q", "--doctest-modules").assert_outcomes(passed=2)


LAZY = """
class Rules:
    rvads.rule("in_class", "forall a. F a@j")

def register():
    rvads.rule("in_function", "forall a. F a@j")

register()
"""


def test_module_imported_in_a_test_registers_globally(pytester: pytest.Pytester) -> None:
    test = "def test_{}():\n    import lazy\n    assert known() == ['in_class', 'in_function']\n"
    write(pytester, lazy=LAZY, test_a=test.format("imports") + test.format("again"))
    pytester.runpytest("-q").assert_outcomes(passed=2)

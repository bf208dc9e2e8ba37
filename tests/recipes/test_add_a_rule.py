"""The recipe "Add a rule" of CONTRIBUTING.md, done from outside."""

import pytest


@pytest.mark.extended
@pytest.mark.parametrize("how", ["conftest", "test file", "file of rules"])
def test_a_rule_of_ones_own_judges_like_a_shipped_one(pytester: pytest.Pytester, how: str) -> None:
    defined = 'import pytest_rvads as rvads\n\nrvads.rule("gets_in", "forall a. F a@j", title="gets in", requirement="REQ-7")\n'
    test = """
    import pytest_rvads as rvads

    @rvads.scenario("stop4", classes=1, grid="B", rules=("gets_in", "p1"), duration=60)
    def test_it(run, rule, monitor):
        assert monitor.check(rule) == rvads.check(run, rule.name)
        assert monitor.verdicts[0].requirement == ("REQ-7" if rule.name == "gets_in" else None)
    """
    if how == "conftest":
        pytester.makeconftest(defined)
    elif how == "file of rules":
        pytester.makefile(".rules", own="[gets_in]\ntext = forall a. F a@j\ntitle = everybody gets in\nrequirement = REQ-7\n")
        pytester.makeini("[pytest]\nrvads_rules = own.rules\n")
    pytester.makepyfile(test)
    if how == "test file":
        file = next(pytester.path.glob("test_*.py"))
        file.write_text(defined + file.read_text(encoding="utf-8"), encoding="utf-8")
    pytester.runpytest("--rvads-autopilot=reference").assert_outcomes(passed=2)

    pytester.path.joinpath("conftest.py").unlink(missing_ok=True)
    pytester.makeini("[pytest]\n")
    pytester.makepyfile(test)
    result = pytester.runpytest("--rvads-autopilot=reference")
    result.stdout.fnmatch_lines(["*unknown rule 'gets_in'*"])  # what one session registers is unknown to the next

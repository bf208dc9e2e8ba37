"""What drives: how it is named, and that whoever reads a result is told."""

import csv
import json
import re
import xml.etree.ElementTree as ET

import pytest

STACK = """
    import pytest_rvads as rvads

    class Racer(rvads.Follower):
        def target_speed(self, seen):
            return 8.0

    class Makers:
        racer = Racer

    PLAN = [8.0]
"""
TESTS = """
    import pytest_rvads as rvads

    @rvads.scenario("stop4", classes=7, grid="B", rules="p1", duration=5)
    def test_rules(run, rule, monitor):
        monitor.check(rule)
"""
NAMED = ("--rvads-autopilot=stack:Racer",)


@pytest.fixture
def tests(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makepyfile(stack=STACK, test_it=TESTS)
    return pytester


def test_every_result_says_what_drove(tests: pytest.Pytester) -> None:
    files = ("out.json", "out.html", "out.md", "out.csv")
    result = tests.runpytest(*NAMED, "--junitxml=out.xml", *(f"--rvads-report={name}" for name in files))
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["rvads: driven by --rvads-autopilot=stack:Racer (stack.py *)", "driven by stack.Racer (stack.py *): 1 run"]
    )
    text = {name: (tests.path / name).read_text(encoding="utf-8") for name in files}
    (record,) = json.loads(text["out.json"])["records"]
    assert record["driver"] == "stack.Racer"
    assert record["source"].startswith("stack.py ")
    told = f"stack.Racer ({record['source']}): 1 run"
    assert f"driven by {told}" in text["out.md"]
    assert f"<dt>driven by</dt><dd>{told}</dd>" in text["out.html"]
    (row,) = csv.DictReader(text["out.csv"].splitlines())
    assert row["driver"] == "stack.Racer"
    assert record["agents"][1] == {"name": "a1", "kind": "car", "entrance": [1, 0], "exit": [2, 0]}
    assert row["agents"].startswith("car a0 from 0.0 to 1.0; car a1 from 1.0 to 2.0; ")
    properties = {p.get("name"): p.get("value") for p in ET.parse(tests.path / "out.xml").iter("property")}
    assert properties["driver"] == "stack.Racer"
    (replay,) = (p for p in (tests.path / ".rvads" / "1").glob("*.html") if p.name != "index.html")
    assert "stack.Racer" in replay.read_text(encoding="utf-8")
    assert "stack.Racer" in (tests.path / ".rvads" / "1" / "index.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "driver"),
    [
        ("stack:Makers.racer", "stack.Racer"),
        ("reference", "pytest_rvads.drivers.reference.Reference"),
        ("late_yielder", "pytest_rvads.drivers.traffic.LateYielder"),
    ],
)
def test_an_option_names_what_drives(tests: pytest.Pytester, name: str, driver: str) -> None:
    tests.makeconftest("import pytest\n\n@pytest.fixture\ndef rvads_autopilot():\n    return 'not asked'")
    result = tests.runpytest(f"--rvads-autopilot={name}")
    assert re.findall(r"driven by (\S+) \(.*\): 1 run", result.stdout.str()) == [driver]


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (
            "missing:Racer",
            "*rvads_autopilot must name an autopilot as module:name, got *missing:Racer*: No module named *missing*",
        ),
        ("stack:Runner", "*rvads_autopilot must name an autopilot as module:name, got 'stack:Runner': *no attribute 'Runner'*"),
        ("stack:PLAN", "*rvads_autopilot must name a class or something callable, 'stack:PLAN' is [[]8.0[]]*"),
        (":Racer", "*rvads_autopilot must name an autopilot as module:name, got ':Racer': expected module:name, *"),
        ("referenze", "*unknown autopilot 'referenze'*"),
    ],
)
def test_a_name_that_leads_nowhere_is_an_error(tests: pytest.Pytester, name: str, says: str) -> None:
    result = tests.runpytest(f"--rvads-autopilot={name}")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([says])


@pytest.mark.parametrize(
    ("end", "says"),
    [
        ("import sys; sys.exit(0)", "*got 'ending:Racer': ending raised SystemExit: 0 (ending.py:1)"),
        ("import os; os._exit(0)", "*got 'ending:Racer': ending ended its process while it was imported, *"),
    ],
)
def test_module_that_ends_at_its_import_is_a_wrong_option(tests: pytest.Pytester, end: str, says: str) -> None:
    tests.makepyfile(ending=f"{end}\n\n\nclass Racer: ...")
    result = tests.runpytest_subprocess("--rvads-autopilot=ending:Racer")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([says])


def test_autopilot_option_and_stack_command_exclude_each_other(tests: pytest.Pytester) -> None:
    result = tests.runpytest(*NAMED, "--rvads-sut=./stack")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*rvads_sut and rvads_autopilot both say what drives, got *"])


def test_default_driver_is_no_success(tests: pytest.Pytester) -> None:
    tests.makepyfile(test_it=TESTS.replace("duration=5", "duration=40"))
    result = tests.runpytest()
    result.assert_outcomes(passed=1)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(["rvads: nothing says what drives in 1 item, so the bundled reference autopilot did, *"])
    assert tests.runpytest("--rvads-autopilot=reference").ret == pytest.ExitCode.OK

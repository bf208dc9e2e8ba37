"""Recorded runs as items: what is collected, how it is called, what becomes of verdicts, and what is not touched."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.logic import check as checking
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs import readers
from pytest_rvads.runs.recording import Recording, Track
from pytest_rvads.session.collection.marks import OpenFiles, Recordings
from tests.inner_sessions import records_of

from .conftest import Lines

Make = Callable[..., rvads.Run]
TESTS = """
import pytest_rvads as rvads

@rvads.recorded({arguments})
def test_drives(monitor, rule):
    monitor.check(rule)
"""
BY_RULE = '"drives/*.npz", rules=("full_stop", "red")'


@pytest.fixture
def stops(drive: Make) -> rvads.Run:
    """A vehicle that stands at the stop sign for 3 s and goes: it keeps `full_stop`; nothing here is red."""
    return drive("stop4", {0: (2, -0.5, [(0, 0.0), (300, 8.0)])}, 900)


@pytest.fixture
def races(drive: Make) -> rvads.Run:
    """A vehicle that drives through at 8 m/s: it breaks `full_stop`."""
    return drive("stop4", {0: (2, -10.0, [(0, 8.0)])}, 500)


@pytest.fixture
def files(pytester: pytest.Pytester, stops: rvads.Run, races: rvads.Run) -> Path:
    """A folder of a run that is kept well and one that is not, beside a test of both."""
    rvads.files.save_run(stops, pytester.path / "drives" / "mon.npz")
    rvads.files.save_run(races, pytester.path / "drives" / "tue.npz")
    pytester.makepyfile(test_it=TESTS.format(arguments=BY_RULE))
    return pytester.path / "drives"


def jam(label: str, arrivals: Sequence[float]) -> Recording:
    """Vehicles that each come from 100 m before the first entrance of an all-way stop, 10 m/s fast, from a time on."""
    junction = rvads.find("stop4")
    key = junction.leads(0, 2).key
    way = rvads.values.Itinerary.through(junction, *key)
    tracks = []
    for number, begin in enumerate(arrivals):
        times = begin + np.arange(0.0, 20.0, 0.1)
        station = -100.0 + 10.0 * (times - begin)
        times, station = times[station < way.end], station[station < way.end]
        pose = np.array([way.pose(float(s)) for s in station])
        agent = rvads.Agent(f"v{number}", junction.movements[key], size=(4.6, 1.8))
        tracks.append(Track(agent, times, station, np.full(len(times), 10.0), pose))
    return Recording(label, junction, tuple(tracks))


def test_every_run_and_rule_is_an_item(pytester: pytest.Pytester, files: Path) -> None:
    result = pytester.runpytest("--rvads-report=out.json", "--junitxml=out.xml")
    result.assert_outcomes(passed=1, failed=1, skipped=2)
    text = result.stdout.str()
    assert "stop4 as recorded: 2 runs, 4 verdicts: 1 pass, 1 fail, 2 NA  (never applicable: red)" in text
    assert "coverage: 2/4 cells exercised (50.0 %): 2 NA" in text
    assert f"recorded  {files / 'tue.npz'}" in text
    assert 'rerun     pytest "test_it.py::test_drives[tue-full_stop]"' in text
    assert "driven by" not in text
    assert (pytester.path / ".rvads" / "1" / "test_it.test_drives-tue-full_stop.html").exists()
    told = [(r["nodeid"], r["type"], r["recording"], r["status"]) for r in records_of(pytester.path)]
    assert told == [
        ("test_it.py::test_drives[mon-full_stop]", "recorded", "mon", "PASS"),
        ("test_it.py::test_drives[mon-red]", "recorded", "mon", "NA"),
        ("test_it.py::test_drives[tue-full_stop]", "recorded", "tue", "FAIL"),
        ("test_it.py::test_drives[tue-red]", "recorded", "tue", "NA"),
    ]
    assert not {"cls", "scenario", "cfg", "driver", "simulator"}.intersection(*records_of(pytester.path))
    case = next(iter(ElementTree.parse(pytester.path / "out.xml").iter("testcase")))
    properties = {one.get("name"): one.get("value") for one in case.iter("property")}
    assert properties == {"junction": "stop4", "recording": "mon", "rule": "full_stop", "verdict": "PASS"}


def test_runs_are_called_by_file_time_and_label(
    pytester: pytest.Pytester, files: Path, stops: rvads.Run, monkeypatch: pytest.MonkeyPatch, brackets: Lines
) -> None:
    several = jam("jam", (3.0, 300.0))
    one = jam("one", (3.0,))
    labelled = [replace(stops, label=name) for name in ("a b/c", "last", "last")]
    (files / "deep").mkdir()
    for suffix, read in {".jam": lambda _: several, ".one": lambda _: one, ".list": lambda _: labelled}.items():
        monkeypatch.setitem(readers.READERS, suffix, read)
        (files / "deep" / f"it s{suffix}").touch()
    patterns = '"drives/tue.npz", "drives/*.npz", "drives/deep/*.jam", "drives/**/*.list"'
    pytester.makepyfile(
        test_it=TESTS.format(arguments=f'{patterns}, rules="p1"'),
        test_one=TESTS.format(arguments='"drives/deep/it s.one", rules="p1"'),
    )
    first, second = (f"t{period.busy:06.1f}" for period in several.periods)
    assert brackets(pytester.runpytest("--collect-only", "-q")) == [
        *("tue-p1", "mon-p1", f"it_s-{first}-p1", f"it_s-{second}-p1"),
        *("deep.it_s-a_b_c-p1", "deep.it_s-last-p1", "deep.it_s-last.2-p1"),
        "it_s-p1",
    ]


@pytest.mark.extended
@settings(max_examples=50, deadline=None)
@given(labels=st.lists(st.text(min_size=1, max_size=8) | st.sampled_from(["a", "a.2", "a.3", "b/c", "b\\c"]), max_size=9))
def test_no_two_runs_of_a_file_are_called_the_same_and_ids_are_plain(labels: list[str]) -> None:
    class Given(OpenFiles):
        def runs(self, path: str) -> list[rvads.Run]:
            return [rvads.Run(label, place, (), none, none) for label in labels]

    place, none = rvads.find("stop4"), np.zeros((0, 0), dtype=np.int8)
    recordings = Recordings.of("here", patterns=("x",), rules=None, requirement=None, misspelt=())
    cells = list(recordings.cells([(Path("x"), "drive17")], Given(), takes_rule=False))
    assert len({cell.id for cell in cells}) == max(len(labels), 1), "one that says so where there is none"
    assert all(re.fullmatch(r"drive17(-[A-Za-z0-9_.-]+)?", cell.id) for cell in cells)


def test_a_folder_holds_the_runs_below_it(pytester: pytest.Pytester, stops: rvads.Run, brackets: Lines) -> None:
    """Neither what is hidden nor what has another ending is a recording; the folder may lie where pytest was started."""
    for name in ("a.npz", "b/a.npz", ".hidden/no.npz"):
        rvads.files.save_run(stops, pytester.path / "drives" / name)
    (pytester.path / "drives" / "notes.txt").touch()
    (pytester.path / "tests").mkdir()
    test = pytester.path / "tests" / "test_it.py"
    test.write_text(TESTS.format(arguments='"drives", rules="p1"'), encoding="utf-8")
    assert brackets(pytester.runpytest("--collect-only", "-q")) == ["a-p1", "b.a-p1"]
    rvads.files.save_run(stops, pytester.path / "tests" / "drives" / "own.npz")
    assert brackets(pytester.runpytest("--collect-only", "-q")) == ["own-p1"], "beside the test file counts first"


def test_recordings_collect_the_applicable_rules_of_a_rulebook(
    pytester: pytest.Pytester, files: Path, drive: Make, brackets: Lines
) -> None:
    rvads.files.save_run(drive("light4", {0: (2, -10.0, [(0, 8.0)])}, 100), files / "wed.npz")
    pytester.makepyfile(test_it=TESTS.format(arguments='"drives/*.npz"'))
    found = {tuple(name.split("-")) for name in brackets(pytester.runpytest("--collect-only", "-q"))}
    road = {place: {rule.name for rule in rvads_rules(place)} for place in ("stop4", "light4")}
    assert road["stop4"] != road["light4"]
    places = {"mon": "stop4", "tue": "stop4", "wed": "light4"}
    assert found == {(file, rule) for file, place in places.items() for rule in road[place]}


def rvads_rules(place: str) -> tuple[rvads.Rule, ...]:
    """Return the rules of the road about a built-in junction."""
    return rules_for("road", rvads.find(place))


def test_items_are_selected_by_file_rule_and_junction(pytester: pytest.Pytester, files: Path, drive: Make, ids: Lines) -> None:
    rvads.files.save_run(drive("light4", {0: (2, -10.0, [(0, 8.0)])}, 100), files / "wed.npz")
    for select, count in {
        "-k mon": 2,
        "-k red": 3,
        "-k light4": 2,
        "-k stop4": 4,
        "-m rvads(recording='tue')": 2,
        "-m rvads(junction='light4',rule='red')": 1,
    }.items():
        assert len(ids(pytester.runpytest("--collect-only", "-q", *select.split(" ", 1)))) == count, select


COUNTING = """
import gc
import weakref
import pytest_rvads as rvads
from pytest_rvads.runs.readers import READERS

read, alive = [], []

def load(path):
    run = rvads.files.load_run(path)
    gc.collect()
    read.append(weakref.ref(run))
    alive.append(sum(known() is not None for known in read))
    return [run]

READERS[".npz"] = load

def pytest_sessionfinish():
    print(f"read {len(read)}, at once {max(alive, default=0)};")
"""


@pytest.mark.extended
def test_only_the_heads_of_kept_runs_are_read_at_collection_and_runs_once_after_it(
    pytester: pytest.Pytester, files: Path
) -> None:
    """At once there are the two that may be asked for again, and the one that is read; however many files there are."""
    for number in range(8):
        (files / f"x{number}.npz").write_bytes((files / "mon.npz").read_bytes())
    pytester.makeconftest(COUNTING)
    pytester.runpytest_subprocess("-s", "--collect-only", "-q").stdout.fnmatch_lines(["*read 0, at once 0;"])
    result = pytester.runpytest_subprocess("-s")
    result.assert_outcomes(passed=9, failed=1, skipped=10)
    result.stdout.fnmatch_lines(["*read 10, at once 3;*"])


def test_a_file_that_can_t_be_read_is_an_error_of_its_own(pytester: pytest.Pytester, files: Path, brackets: Lines) -> None:
    """One is no archive; the head of the other one is whole, and its states are not."""
    whole = (files / "mon.npz").read_bytes()
    (files / "bad.npz").write_bytes(b"no archive")
    at = whole.index(b"zone.npy") + 200
    (files / "cut.npz").write_bytes(whole[:at] + bytes(50) + whole[at + 50 :])
    assert brackets(pytester.runpytest("--collect-only", "-q"))[:3] == ["bad", "cut-full_stop", "cut-red"]
    result = pytester.runpytest("--rvads-report=out.json")
    result.assert_outcomes(passed=1, failed=1, skipped=2, errors=3)
    told = {str(r["nodeid"]).partition("[")[2]: (r["status"], r["message"]) for r in records_of(pytester.path)}
    for name, file in (("bad]", "bad.npz"), ("cut-full_stop]", "cut.npz"), ("cut-red]", "cut.npz")):
        status, message = told[name]
        assert status == "ERROR"
        assert str(message).startswith(f"{files / file}: ")
    result.stdout.no_fnmatch_line("*Traceback*")


def test_recording_without_near_traffic_is_an_error(
    pytester: pytest.Pytester, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(readers.READERS, ".jam", lambda _: jam("jam", ()))
    (files / "quiet.jam").touch()
    pytester.makepyfile(test_it=TESTS.format(arguments='"drives/quiet.jam"'))
    result = pytester.runpytest()
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["*quiet.jam: holds no run, so there is nothing to judge: nobody came near the junction*"])


def test_busy_periods_are_separate_runs(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four vehicles drive past the stop sign at 10 m/s, two and two: each pair breaks `full_stop` in a run of its own."""
    opened = []

    def read(path: str) -> Recording:
        opened.append(path)
        return jam("jam", (3.0, 6.0, 300.0, 303.0))

    monkeypatch.setitem(readers.READERS, ".jam", read)
    (pytester.path / "rush.jam").touch()
    pytester.makepyfile(test_it=TESTS.format(arguments='"rush.jam", rules=["full_stop", "p4"]'))
    result = pytester.runpytest("--rvads-report=out.json")
    result.assert_outcomes(failed=2, skipped=2)
    assert len(opened) == 1, "to cut it into periods and to judge them"
    told = [r["verdicts"][0] for r in records_of(pytester.path) if r["status"] == "FAIL"]
    assert [sorted(verdict["responsible"]) for verdict in told] == [["v0", "v1"], ["v2", "v3"]]
    assert all(303.0 < told[1]["time"] < 330.0 for _ in told), "on the clock of the log"


DRIVEN = """
import pytest
import pytest_rvads as rvads

@pytest.fixture(params=["one", "two"])
def rvads_autopilot(request):
    assert False, "nobody drives"

@pytest.fixture(scope="session")
def rvads_simulator():
    assert False, "nothing is simulated"

@pytest.fixture(scope="session")
def rvads_vehicle():
    assert False, "in no body"
"""


def test_what_drives_is_not_set_up(pytester: pytest.Pytester, files: Path, brackets: Lines) -> None:
    pytester.makeconftest(DRIVEN)
    assert brackets(pytester.runpytest("--collect-only", "-q")) == ["mon-full_stop", "mon-red", "tue-full_stop", "tue-red"]
    result = pytester.runpytest("-k", "mon")
    result.assert_outcomes(passed=1, skipped=1, deselected=2)
    assert result.ret == 0, "and nobody asks what was to drive"
    result.stdout.no_fnmatch_line("*driven by*")


@pytest.mark.parametrize(
    ("arguments", "body"),
    [
        ("rvads_recorded", "assert rvads_recorded.duration > 0"),
        ("run, rvads_recorded", "assert run is rvads_recorded"),
        ("rvads_recorded, monitor", "assert monitor.run is rvads_recorded; monitor.check('on_route')"),
        ("monitor, rule, extra", "monitor.check(rule); assert extra == 1"),
    ],
)
def test_the_run_is_a_fixture(pytester: pytest.Pytester, files: Path, stops: rvads.Run, arguments: str, body: str) -> None:
    rules = ", rules='full_stop'" if "rule" in arguments else ""
    code = f"@rvads.recorded('drives/mon.npz'{rules})\ndef test_it({arguments}):\n    {body}\n"
    more = "@pytest.mark.parametrize('extra', [1])\n" if "extra" in arguments else ""
    rvads.files.save_run(replace(stops, collisions=()), files / "mon.npz")
    pytester.makepyfile(test_it=f"import pytest\nimport pytest_rvads as rvads\n\n{more}{code}")
    pytester.runpytest().assert_outcomes(passed=1)


@pytest.mark.usefixtures("doubted")
def test_unsure_skips_and_is_counted_and_listed(pytester: pytest.Pytester, files: Path) -> None:
    result = pytester.runpytest("-rs", "--rvads-report=out.json", "--rvads-report=out.md", "--junitxml=out.xml", "-v")
    result.assert_outcomes(failed=1, skipped=3)
    assert [r["status"] for r in records_of(pytester.path)] == ["UNSURE", "NA", "FAIL", "NA"]
    text = result.stdout.str()
    assert "UNSURE [1] test_it.py:3: UNSURE: a0 stood for 0.02 s, known to 0.05 s" in text
    assert "4 verdicts: 1 fail, 1 unsure, 2 NA" in text
    assert "coverage: 1/4 cells exercised (25.0 %): 1 unsure, 2 NA" in text
    assert "unsure: another reading of what was recorded changes the verdict" in text
    assert "1 x full_stop: a=a0, j.en=entrance 0: a0 stood for 0.02 s, known to 0.05 s" in text
    assert "a0 stood for 0.02 s" in (pytester.path / "out.md").read_text(encoding="utf-8")
    case = next(iter(ElementTree.parse(pytester.path / "out.xml").iter("testcase")))
    assert case.find("skipped") is not None
    assert {"verdict": "UNSURE"}.items() <= {one.get("name"): one.get("value") for one in case.iter("property")}.items()


@pytest.mark.usefixtures("doubted")
def test_unsure_fails_where_that_is_asked_for(pytester: pytest.Pytester, files: Path) -> None:
    result = pytester.runpytest("-k", "mon", "--rvads-strict=unsure", "--rvads-report=out.json")
    result.assert_outcomes(failed=1, skipped=1, deselected=2)
    assert records_of(pytester.path)[0]["status"] == "UNSURE"
    result.stdout.fnmatch_lines(["*full_stop UNSURE: a0 stood for 0.02 s, known to 0.05 s*", "causes of failures"])
    pytester.makeini("[pytest]\nrvads_strict = maybe\n")
    refused = pytester.runpytest()
    refused.stderr.fnmatch_lines(["ERROR: rvads_strict must name outcomes of open, unavoidable, unsure, or none, got 'maybe'"])


@pytest.mark.usefixtures("doubted")
def test_an_unsure_verdict_that_a_test_passes_over_is_no_pass(pytester: pytest.Pytester, files: Path) -> None:
    pytester.makepyfile(test_it=TESTS.format(arguments='"drives/mon.npz", rules="full_stop"').replace(".check", ".verdict"))
    result = pytester.runpytest("--rvads-report=out.json")
    result.assert_outcomes(passed=1)
    assert result.ret == pytest.ExitCode.NO_TESTS_COLLECTED
    assert [r["status"] for r in records_of(pytester.path)] == ["UNSURE"]
    pytester.runpytest("--rvads-strict=unsure").assert_outcomes(failed=1)


@pytest.mark.usefixtures("doubted")
def test_a_baseline_tells_what_became_unsure(pytester: pytest.Pytester, files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as sure:
        sure.setattr(checking, "check", rvads.check)
        pytester.runpytest("--rvads-report=old.json")
    result = pytester.runpytest("--rvads-baseline=old.json")
    result.stdout.fnmatch_lines(["against old.json: 1 LOST, 3 UNCHANGED", "*LOST *mon-full_stop*was PASS, is UNSURE"])


def test_a_baseline_tells_what_recordings_broke_since(pytester: pytest.Pytester, files: Path) -> None:
    pytester.runpytest("--rvads-report=old.json")
    against = ("--rvads-baseline=old.json", "--rvads-fail-on=new")
    same = pytester.runpytest(*against)
    assert same.ret == 0, "what failed before may"
    same.stdout.fnmatch_lines(["against old.json: 4 UNCHANGED"])
    (files / "mon.npz").write_bytes((files / "tue.npz").read_bytes())
    (files / "tue.npz").unlink()
    worse = pytester.runpytest(*against)
    assert worse.ret == pytest.ExitCode.TESTS_FAILED
    worse.stdout.fnmatch_lines(["against old.json: 1 NEW, 1 LOST, *", "*NEW *mon-full_stop*", "*LOST *tue-full_stop*not exist*"])


def test_known_deficiencies_of_recordings_are_strict(pytester: pytest.Pytester, files: Path) -> None:
    known = '@rvads.known("I3", recording="{}", rule="full_stop")\n@rvads.recorded'
    for name, outcome in (("tue", {"passed": 1, "xfailed": 1, "skipped": 2}), ("mon", {"failed": 2, "skipped": 2})):
        tests = TESTS.format(arguments=BY_RULE).replace("@rvads.recorded", known.format(name))
        pytester.makepyfile(test_it=tests)
        pytester.runpytest().assert_outcomes(**outcome)


def test_subjects_and_faults_are_those_of_the_kept_run(pytester: pytest.Pytester, files: Path, drive: Make) -> None:
    """a1 races and is traffic; of another run a fault is the end, and what was kept until then does not count."""
    both = {0: (2, -0.5, [(0, 0.0), (600, 8.0)]), 1: (2, -10.0, [(0, 8.0)])}
    among = drive("stop4", both, 1200, subject="a0")
    rvads.files.save_run(among, files / "mon.npz")
    broken = replace(drive("stop4", {0: (2, -0.5, [(0, 0.0)])}, 300), fault=rvads.values.Fault(2.99, "a0", "the disk was full"))
    rvads.files.save_run(broken, files / "tue.npz")
    result = pytester.runpytest("-k", "full_stop", "--rvads-report=out.json")
    assert [r["status"] for r in records_of(pytester.path) if r["rule"] == "full_stop"] == ["PROVOKED", "ERROR"]
    result.stdout.fnmatch_lines(["*ERROR: the disk was full*"])


def test_recorded_runs_can_be_kept_and_hooks_learn_of_them(pytester: pytest.Pytester, files: Path, races: rvads.Run) -> None:
    pytester.makeconftest(
        "def pytest_rvads_verdict(record):\n    print('HOOK', record['recording'], record['rule'], record['status'])\n"
    )
    result = pytester.runpytest("-s", "--rvads-keep=kept")
    result.stdout.fnmatch_lines(["*HOOK tue full_stop FAIL*"])
    assert rvads.files.load_run(pytester.path / "kept" / "test_it.test_drives-tue.npz") == races


@pytest.mark.extended
def test_workers_share_the_items(pytester: pytest.Pytester, files: Path) -> None:
    result = pytester.runpytest("-n2", "--rvads-report=out.json")
    result.assert_outcomes(passed=1, failed=1, skipped=2)
    assert [r["status"] for r in records_of(pytester.path)] == ["PASS", "NA", "FAIL", "NA"]


def test_a_time_budget_and_the_limit_of_items_count(pytester: pytest.Pytester, files: Path) -> None:
    pytester.runpytest("--rvads-time-budget=100").assert_outcomes(passed=1, failed=1, skipped=2)
    result = pytester.runpytest("--rvads-max-items=3")
    result.stdout.fnmatch_lines(["test_it.py:3: *would expand to more than 3 items in 2 files: narrow the patterns, *"])

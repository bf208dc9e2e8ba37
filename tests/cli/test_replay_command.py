"""``rvads replay``: what failed in a session, drawn from the runs that it has kept."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from pytest_rvads.cli import main
from pytest_rvads.report.animated import animated
from pytest_rvads.report.failures import Beside
from pytest_rvads.report.folders import claimed, run_file
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.satellites.pages import replay
from tests.inner_sessions import driven_by

TESTS = driven_by(
    "Racer",
    """
from pytest_rvads.session import artefacts

artefacts._MOST_PAGES = 1

rvads.rule("stays_out", "forall a, j.en. G(!a@j)", title="nobody enters")
start = dict(classes=(1, 7), distances=3, duration=2)

@rvads.scenario("stop4", rules=("full_stop", "stays_out", "on_route"), **start)
def test_rules(run, rule, monitor):
    monitor.check(rule)

@rvads.scenario("stop4", **start)
def test_run(run):
    assert not run.agents
""",
)
RULES = "[stays_out]\ntext = forall a, j.en. G(!a@j)\ntitle = nobody enters\n"
POINT = "cfgd03.00v00.00"
DRAWN = f"test_it.py::test_rules[stop4-class01-as1111-{POINT}-full_stop]"
OWN_DRAWN = f"test_it.py::test_rules[stop4-class01-as1111-{POINT}-stays_out]"
UNDRAWN = f"test_it.py::test_rules[stop4-class07-as1133-{POINT}-full_stop]"
OWN = f"test_it.py::test_rules[stop4-class07-as1133-{POINT}-stays_out]"
PLAIN = f"test_it.py::test_run[stop4-class07-as1133-{POINT}]"
PASSED = f"test_it.py::test_rules[stop4-class07-as1133-{POINT}-on_route]"

Said = Callable[..., tuple[int, list[str], list[str]]]


@pytest.fixture(scope="module")
def _session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which a session of two runs has ended, which drew the first failure of each of two rules."""
    folder = tmp_path_factory.mktemp("session")
    (folder / "test_it.py").write_text(TESTS, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    assert subprocess.run(command, cwd=folder, stdout=subprocess.DEVNULL, check=False).returncode == 1
    return folder


@pytest.fixture
def session(_session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of that session, in a copy that is the working directory."""
    shutil.copytree(_session, tmp_path / "here", symlinks=True)
    monkeypatch.chdir(tmp_path / "here")
    return Path(".rvads", "1")


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str]) -> Said:
    """Return a function that runs the command and gives exit status, standard output and standard error, in lines."""

    def run(*arguments: str) -> tuple[int, list[str], list[str]]:
        status = main(["replay", *arguments])
        out, err = capsys.readouterr()
        return status, out.splitlines(), err.splitlines()

    return run


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What pages are drawn of: run, verdict, rule, notes, and what stands beside."""
    found: list[tuple[Any, ...]] = []
    pages = replay.failure_pages

    def spy(*arguments: Any) -> Any:
        found.append(arguments)
        return pages(*arguments)

    monkeypatch.setattr(replay, "failure_pages", spy)
    return found


def page_of(session: Path, nodeid: str) -> Path:
    return session / f"{nodeid.replace('.py::', '.').replace('[', '-').replace(']', '')}.html"


def report_of(session: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((session / "report.json").read_text(encoding="utf-8"))
    return {record["nodeid"]: record for record in found["records"]}


def test_without_arguments_it_lists_what_failed(session: Path, said: Said) -> None:
    status, (head, *lines, hint), err = said()
    assert (status, err) == (0, [])
    assert head.startswith(".rvads/1: began 2")
    assert head.endswith(", 6 of 8 items failed")
    told = {line.split()[1]: line.split(maxsplit=2)[::2] for line in lines}
    assert told == {
        DRAWN: ["FAIL", f"{page_of(session, DRAWN).as_posix()}#t=1.68"],
        OWN_DRAWN: ["FAIL", f"{page_of(session, OWN_DRAWN).as_posix()}#t=1.68"],
        UNDRAWN: ["FAIL", "not drawn yet"],
        OWN: ["FAIL", "not drawn yet"],
        PLAIN: ["FAIL", "no rule was violated"],
        PLAIN.replace("07-as1133", "01-as1111"): ["FAIL", "no rule was violated"],
    }
    assert hint.startswith('rvads replay --session 1 "ID" draws a failure by its id')


@pytest.mark.parametrize("what", [(UNDRAWN,), ("class07", "--rules", "full_stop"), ("07-as1133-cfgd03.00v00.00-full",)])
def test_one_is_drawn_by_its_id_or_a_part_of_it(
    session: Path, said: Said, shown: list[tuple[Any, ...]], what: tuple[str, ...]
) -> None:
    page = page_of(session, UNDRAWN)
    assert not page.exists()
    status, (path, message), err = said(*what)
    assert (status, path, err) == (0, f"{page.as_posix()}#t=1.68", [])
    record = report_of(session)[UNDRAWN]
    assert message.strip() == record["message"]
    assert "<svg" in page.read_text(encoding="utf-8")
    ((run, verdict, rule, notes, beside),) = shown
    assert (run.hash, verdict.rule, rule.name) == (record["hash"], "full_stop", "full_stop")
    assert notes.startswith(verdict.explanation)
    assert "driven by test_it.Racer" in notes
    assert notes.endswith(f'rerun     pytest "{UNDRAWN}"')
    assert [word for word, _ in beside.facts] == ["scenario", "driven by", "simulated by", "rule", "rerun"]
    assert dict(beside.facts)["scenario"].startswith(f"stop4-class07-as1133-{POINT} (0->1 ")
    assert [other[:2] for other in beside.others] == [("stays_out", "FAIL"), ("on_route", "PASS")]
    assert (beside.back, beside.ghost) == ("index.html", None)


def test_the_page_of_the_session_leads_to_it_then(session: Path, said: Said) -> None:
    assert said(UNDRAWN)[0] == 0
    page = page_of(session, UNDRAWN)
    assert report_of(session)[UNDRAWN]["look"] == f"{page.as_posix()}#t=1.68"
    assert "look" not in report_of(session)[OWN]
    assert f'"{page.name}#t=1.68"' in (session / "index.html").read_text(encoding="utf-8")
    assert any(UNDRAWN in line and page.name in line for line in said()[1])


def test_all_are_drawn_once(session: Path, said: Said) -> None:
    before = page_of(session, DRAWN).stat().st_mtime_ns
    status, out, _ = said("--all", "--rules", "full_stop")
    assert (status, out) == (0, [".rvads/1: 1 page drawn, 1 drawn before"])
    assert page_of(session, UNDRAWN).exists()
    assert not page_of(session, OWN).exists()
    assert page_of(session, DRAWN).stat().st_mtime_ns == before


def test_what_all_can_t_draw_costs_nothing_else(session: Path, said: Said) -> None:
    status, out, err = said("--all")
    assert status == 1
    assert out == [".rvads/1: 2 pages drawn, 2 drawn before"]
    told = [line for line in err if line.startswith("rvads: ")]
    assert len(told) == 2
    assert all("no rule was violated, so there is no replay of it; run it again: pytest " in line for line in told)


def test_a_rule_of_one_s_own_is_drawn_as_the_session_judged_it(session: Path, said: Said, shown: list[tuple[Any, ...]]) -> None:
    status, _, (doubt,) = said(OWN)
    assert status == 0
    assert doubt.startswith("rvads: 'stays_out' is a rule of your own, so its monitors are not shown: name its file by --rules")
    ((_, verdict, rule, *_),) = shown
    record = report_of(session)[OWN]["verdicts"][0]
    assert rule == ""
    assert (verdict.message, verdict.time, list(verdict.responsible)) == (
        record["message"],
        record["time"],
        record["responsible"],
    )
    assert json.loads(msgspec.json.encode(verdict.instances)) == record["instances"]


def test_with_the_file_of_the_rule_its_monitors_are_shown(session: Path, said: Said, shown: list[tuple[Any, ...]]) -> None:
    Path("own.rules").write_text(RULES, encoding="utf-8")
    status, _, err = said(OWN, "--rules", "own.rules")
    assert (status, err) == (0, [])
    ((_, verdict, rule, *_),) = shown
    assert rule.name == "stays_out"
    assert verdict.explanation


def test_a_rule_that_says_something_else_now_is_told(session: Path, said: Said, shown: list[tuple[Any, ...]]) -> None:
    Path("own.rules").write_text(RULES.replace("!a@j", "true"), encoding="utf-8")
    status, _, (doubt,) = said(OWN, "--rules", "own.rules")
    assert status == 0
    assert (
        doubt
        == "rvads: the session said FAIL by stays_out, and this version says PASS: the page shows the verdict of the session"
    )
    ((_, verdict, rule, *_),) = shown
    assert (verdict.status, rule) == ("FAIL", "")


def test_a_page_elsewhere_leads_back_and_is_no_page_of_the_session(
    session: Path, said: Said, shown: list[tuple[Any, ...]]
) -> None:
    status, (path, _), _ = said(UNDRAWN, "-o", "out/of/here.html")
    assert (status, path) == (0, "out/of/here.html#t=1.68")
    assert shown[0][4].back == "../../.rvads/1/index.html"
    assert not page_of(session, UNDRAWN).exists()
    assert "look" not in report_of(session)[UNDRAWN]


def test_a_session_is_named_by_number_folder_or_the_folder_of_all(session: Path, said: Said) -> None:
    shutil.copytree(session, session.with_name("2"))
    (session.with_name("2") / ".session").write_text("another")
    shutil.copy(session / "report.json", ".rvads/report.json")  # as --rvads-report may be told to write it
    assert said()[1][0].startswith(".rvads/2: ")
    assert said("--session", "1")[1][0].startswith(".rvads/1: ")
    Path(".rvads/report.json").unlink()
    for name, folder in (("1", ".rvads/1"), (".rvads/1", ".rvads/1"), (".rvads/latest", ".rvads/latest"), (".rvads", ".rvads/2")):
        assert said("--session", name)[1][0].startswith(f"{folder}: "), name
    os.chdir("..")
    assert said("--session", "here/.rvads/1", UNDRAWN)[0] == 0
    assert page_of(Path("here") / session, UNDRAWN).exists()
    os.chdir("here")


def test_the_run_of_an_earlier_session_is_a_ghost(
    session: Path, said: Said, shown: list[tuple[Any, ...]], make_slower: Callable[[], Run]
) -> None:
    before = make_slower()
    assert said(UNDRAWN, "--baseline", "main/report.json")[0] == 0
    beside: Beside = shown[0][4]
    assert (beside.ghost, beside.ghost_name) == (before, "report.json")
    report = Path("main", "report.json")
    report.write_text(report.read_text(encoding="utf-8").replace(before.hash, "../../outside"), encoding="utf-8")
    assert said(UNDRAWN, "--baseline", "main/report.json")[0] == 0
    assert shown[1][4].ghost is None, "of a report whose hash is none there is no earlier run, and that costs no page"


@pytest.fixture
def make_slower(session: Path) -> Callable[[], Run]:
    """Return a function that makes a copy of the session in which the run of `UNDRAWN` is another one, and returns that."""

    def make() -> Run:
        from dataclasses import replace

        from pytest_rvads.runs.runfile import save_run

        shutil.copytree(session, "main")
        record = report_of(session)[UNDRAWN]
        run = load_run(run_file(Path("main"), record["hash"]))
        other = replace(run, speed=0.5 * run.need("speed"))
        save_run(other, run_file(Path("main"), other.hash))
        text = Path("main", "report.json").read_text(encoding="utf-8")
        Path("main", "report.json").write_text(text.replace(record["hash"], other.hash), encoding="utf-8")
        return other

    return make


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ("class07",),
            f".rvads/1 has 3 failures with 'class07' in the id: name a longer part of an id, or --all: {UNDRAWN}, {OWN}, {PLAIN}",
        ),
        (
            ("nothing like it",),
            ".rvads/1 has no failure with 'nothing like it' in the id: `rvads replay --session 1` lists its failures",
        ),
        (("class07", "--rules", "p9"), ".rvads/1 has no failure with 'class07' in the id and 'p9' as its rule: "),
        (
            ("--rules", "stays_out"),
            ".rvads/1 has 2 failures with 'stays_out' as its rule: name a longer part of an id, or --all: test_it.py::",
        ),
        (
            (PASSED,),
            f"{PASSED} did not fail in .rvads/1, it is PASS, and only runs of failures are kept: --rvads-keep=DIR keeps all runs",
        ),
        ((PLAIN,), f'{PLAIN}: no rule was violated, so there is no replay of it; run it again: pytest "{PLAIN}"'),
        (("--session", "7"), "there is no session 7 in .rvads, there are 1"),
        (
            ("--session", "nowhere"),
            "no session of pytest has left anything in nowhere: run pytest in this folder first, or name ",
        ),
        (("--session", "0"), "there is no session 0 in .rvads, there are 1"),
        (("--all", "-o", "x.html"), "--all writes many pages, each into the folder of the session: leave --output out"),
        ((UNDRAWN, "--rules", "none.rules"), "none.rules: can't be read: No such file or directory"),
        ((UNDRAWN, "--baseline", "none.json"), "none.json can't be read as a report of --rvads-report: "),
        (("none.npz",), "none.npz: can't be read: No such file or directory"),
        (
            ("test_it.py",),
            f".rvads/1 has 6 failures with 'test_it.py' in the id: name a longer part of an id, or --all: {DRAWN}, ",
        ),
        (("run.npz", "--session", "1"), "run.npz is the file of a run, which belongs to no session: leave --session"),
        (("run.npz", "--all"), "run.npz is the file of a run, which belongs to no session: leave --session"),
    ],
)
def test_mistakes_are_one_sentence(session: Path, said: Said, arguments: tuple[str, ...], says: str) -> None:
    status, out, err = said(*arguments)
    assert (status, out) == (2, [])
    assert len(err) == 1
    assert err[0].startswith(f"rvads: {says}")


def test_without_a_session_it_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: Said) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, (line,) = said()
    assert (status, out) == (2, [])
    assert line == (
        "rvads: no session of pytest has left anything in .rvads: run pytest in this folder first, or name the folder of "
        "a session by --session"
    )


def test_of_a_session_that_died_it_says_so(session: Path, said: Said) -> None:
    claimed(Path(".rvads"), "died", 9)
    says = "rvads: the session of .rvads/2 has not ended, or died, so it has left no report.json"
    assert said() == (2, [], [f"{says}; the last session with a report is --session .rvads/1"])
    (session / "report.json").unlink()
    assert said() == (2, [], [says])


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda run: run.unlink(), "its run is not kept, so there is no replay of it; run it again: pytest "),
        (lambda run: run.write_bytes(run.read_bytes()[:100]), "not a run kept by rvads"),
        (lambda run: run.write_bytes(next(p for p in run.parent.iterdir() if p != run).read_bytes()), "holds another run than "),
    ],
    ids=["gone", "cut off", "another"],
)
def test_a_run_that_is_gone_or_damaged_is_told(session: Path, said: Said, damage: Callable[[Path], object], says: str) -> None:
    damage(run_file(session, report_of(session)[UNDRAWN]["hash"]))
    status, out, (line,) = said(UNDRAWN)
    assert (status, out) == (2, [])
    assert says in line
    assert not page_of(session, UNDRAWN).exists()


@pytest.mark.parametrize("content", ["", "{}", "[1]", '{"format": "rvads-report", "version": 4, "records": [{}]}', "\x00"])
def test_a_damaged_report_is_told(session: Path, said: Said, content: str) -> None:
    (session / "report.json").write_text(content, encoding="utf-8")
    status, out, err = said()
    assert (status, out, len(err)) == (2, [], 1)
    assert ".rvads/1/report.json" in err[0]


def test_a_report_from_elsewhere_steers_no_terminal_and_no_path(session: Path, said: Said) -> None:
    path = session / "report.json"
    text = path.read_text(encoding="utf-8")
    hostile = "../../../up\x1b[2J<script>"
    path.write_text(text.replace(json.dumps(UNDRAWN)[1:-1], json.dumps(hostile)[1:-1]), encoding="utf-8")
    _, out, _ = said()
    assert any("up\\x1b[2J<script>" in line for line in out)
    status, out, _ = said("up\x1b")
    assert status == 0
    (page,) = (p for p in session.glob("*.html") if "up" in p.name)
    assert "\x1b" not in out[0]
    assert not list(Path("..").glob("*up*"))
    assert "<script>up" not in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("digest", ["../../../outside", "..\\outside", "/outside", "é", "A1\x1b", "1\n"])
def test_what_is_no_hash_makes_no_path(session: Path, said: Said, digest: str) -> None:
    """A run that somebody has put elsewhere is not read, whatever a report says; the other failures are drawn."""
    content = json.loads((session / "report.json").read_text(encoding="utf-8"))
    (one,) = (record for record in content["records"] if record["nodeid"] == UNDRAWN)
    for place in (Path("outside.npz"), session / "runs" / f"{Path(digest).name}.npz"):
        shutil.copy(run_file(session, one["hash"]), place)
    one["hash"] = digest
    (session / "report.json").write_text(json.dumps(content), encoding="utf-8")
    status, out, (line,) = said(UNDRAWN)
    assert (status, out) == (2, [])
    assert "its record is damaged, the hash of a run consists of the digits 0-9 a-f, got '" in line
    assert "\x1b" not in line
    assert any(f"{UNDRAWN}  its record is damaged" in line for line in said()[1])
    assert said("--all", "--rules", "full_stop")[:2] == (1, [".rvads/1: 0 pages drawn, 1 drawn before"])
    assert not page_of(session, UNDRAWN).exists()


def test_the_run_of_a_file_is_drawn(session: Path, said: Said, shown: list[tuple[Any, ...]]) -> None:
    (kept, *_) = sorted((session / "runs").iterdir())
    status, (path, message), err = said(str(kept), "--rules", "full_stop")
    assert (status, path, err) == (0, f"{kept.stem}-full_stop.html#t=1.68", [])
    assert message.startswith("  full_stop at t=1.68 s: ")
    assert Path(f"{kept.stem}-full_stop.html").exists()
    _, verdict, _, notes, beside = shown[0]
    assert notes.startswith(verdict.explanation), "why the rule is violated"
    assert dict(beside.facts)["rerun"] == f'rvads replay "{kept}" --rules full_stop'
    assert "full_stop" not in [rule for rule, *_ in beside.others]
    assert beside.back == ""


def test_run_of_a_file_is_drawn_where_the_rule_does_not_apply(session: Path, said: Said) -> None:
    (kept, *_) = sorted((session / "runs").iterdir())
    status, (path, message), err = said(str(kept), "--rules", "red")
    assert (status, err) == (0, [])
    assert Path(path.partition("#")[0]).exists()
    assert message.startswith("  red NA: ")


def test_without_a_rule_it_is_shown_as_it_is(session: Path, said: Said, shown: list[tuple[Any, ...]]) -> None:
    (kept, *_) = (session / "runs").iterdir()
    assert said(str(kept), "-o", "run.html") == (0, ["run.html"], [])
    assert "<title>stop4-class0" in Path("run.html").read_text(encoding="utf-8")
    assert shown == []


@pytest.mark.parametrize(
    ("rule", "says"),
    [("p9", "unknown rule 'p9'"), ("paper", "a page shows one rule, got 'paper' with 6 rules: name one of these rules")],
)
def test_a_file_is_judged_by_one_rule_that_there_is(session: Path, said: Said, rule: str, says: str) -> None:
    (kept, *_) = (session / "runs").iterdir()
    status, out, (line,) = said(str(kept), "--rules", rule)
    assert (status, out) == (2, [])
    assert line.startswith(f"rvads: {says}")


def test_an_animated_picture_is_of_the_moment(session: Path, said: Said) -> None:
    status, out, _ = said(UNDRAWN, "-o", "out/a.svg")
    record = report_of(session)[UNDRAWN]
    assert (status, out) == (0, ["out/a.svg", f"  {record['message']}"])
    (verdict,) = record["verdicts"]
    run = load_run(run_file(session, record["hash"]))
    told = {"title": verdict["message"], "responsible": tuple(verdict["responsible"]), "around": verdict["time"]}
    assert Path("out/a.svg").read_text(encoding="utf-8") == animated(run, **told)
    assert not page_of(session, UNDRAWN).exists()
    assert said(UNDRAWN, "-o", "b.html")[1][0] == "b.html#t=1.68"

"""The page of a session leads to the replays; pytest-html gets the pictures."""

import base64
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.cli import main
from pytest_rvads.report import folders
from pytest_rvads.report.failures import Beside
from pytest_rvads.report.folders import claimed
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.satellites.pages import replay
from pytest_rvads.session import artefacts
from tests.inner_sessions import FAILING, driven_by, records_of


def content(page: Path) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*)</script>', page.read_text(encoding="utf-8"))
    assert found
    read: dict[str, Any] = json.loads(found[1])
    return read


@pytest.mark.extended
@pytest.mark.parametrize("workers", ["-n0", "-n1"])
def test_the_index_links_every_failure_to_its_replay(pytester: pytest.Pytester, workers: str) -> None:
    pytester.makepyfile(FAILING)
    result = pytester.runpytest(workers, "--rvads-report=out/verdicts.html")
    result.stdout.fnmatch_lines(["look: .rvads/1/index.html"])
    for page in (pytester.path / ".rvads" / "1" / "index.html", pytester.path / "out" / "verdicts.html"):
        items = content(page)["items"]
        assert len(items) == 2
        failed = [item for item in items if item["status"] == "FAIL"]
        assert failed
        for item in failed:
            target, _, time = item["look"].partition("#t=")
            assert (page.parent / target).resolve().is_file()
            assert f"t={time} s" in item["text"]


@pytest.mark.extended
def test_the_replay_shows_the_monitors_and_the_vehicle_to_blame(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(FAILING)
    pytester.runpytest("-k", "p3")
    (page,) = (pytester.path / ".rvads" / "1").glob("*p3.html")
    run = content(page)
    assert run["responsible"]
    assert "violated" in {word for _, changes in run["tracks"] for _, word in changes}
    assert {label.split()[0] for label, _ in run["tracks"]} == {"p3"}


@pytest.mark.extended
def test_without_artefacts_there_is_no_page(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(FAILING)
    result = pytester.runpytest("--rvads-artefacts=none", "-k", "p1")
    result.stdout.no_fnmatch_line("look*")
    assert not (pytester.path / ".rvads").exists()


@pytest.mark.extended
def test_pytest_html_gets_the_picture(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pytest_html")
    monkeypatch.delenv("PYTEST_ADDOPTS")  # by which tests/conftest.py puts it away
    pytester.makepyfile(FAILING)
    pytester.runpytest("-k", "p3", "--html=report.html", "--self-contained-html")
    (drawn,) = (pytester.path / ".rvads" / "1").glob("*p3.svg")
    assert base64.b64encode(drawn.read_bytes()).decode() in (pytester.path / "report.html").read_text(encoding="utf-8")


RACING = driven_by(
    "Racer",
    """
rvads.rule("stays_out", "forall a, j.en. G(!a@j)")

@rvads.scenario("stop4", classes=(1, 7), distances=3, rules=("full_stop", "stays_out"), duration=2)
def test_rules(run, rule, monitor):
    monitor.check(rule)
""",
)


@pytest.fixture
def racing(pytester: pytest.Pytester) -> Path:
    """The folder of tests of two runs, each of which violates two rules."""
    pytester.makepyfile(test_it=RACING)
    return pytester.path / ".rvads"


def looks(result: pytest.RunResult) -> list[str]:
    return [line.removeprefix("look      ") for line in result.outlines if line.startswith("look  ")]


def test_every_session_has_a_folder_and_keeps_each_run_once(pytester: pytest.Pytester, racing: Path) -> None:
    result = pytester.runpytest("-vv")
    result.assert_outcomes(failed=4)
    first = racing / "1"
    assert all((pytester.path / look.partition("#")[0]).parent == first for look in looks(result))
    records = records_of(first, "report.json")
    kept = {load_run(path).hash for path in (first / "runs").iterdir()}
    assert kept == {record["hash"] for record in records}
    assert len(kept) == len(list((first / "runs").iterdir())) == 2
    assert [record["look"] for record in records] == looks(result)
    before = {path: path.read_bytes() for path in first.rglob("*") if path.is_file()}
    pytester.runpytest("-k", "class07").stdout.fnmatch_lines(["look: .rvads/2/index.html"])
    assert {path: path.read_bytes() for path in first.rglob("*") if path.is_file()} == before
    assert (racing / "latest").resolve() == racing / "2"


@pytest.mark.extended
def test_workers_write_to_the_folder_of_their_session(pytester: pytest.Pytester, racing: Path) -> None:
    result = pytester.runpytest("-n2", "-vv")
    result.assert_outcomes(failed=4)
    assert [path.name for path in racing.iterdir() if path.is_dir() and not path.is_symlink()] == ["1"]
    assert len(list((racing / "1" / "runs").iterdir())) == 2
    assert len(list((racing / "1").glob("test_it*.html"))) == 4


@pytest.mark.slow  # two processes; tests/report/test_folders.py has many of them claim folders at once
def test_two_sessions_at_once_have_two_folders(pytester: pytest.Pytester, racing: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    sessions = [subprocess.Popen([*command, "-k", name], stdout=subprocess.DEVNULL) for name in ("class01", "class07")]
    assert [session.wait() for session in sessions] == [1, 1]
    reports = [json.loads((racing / number / "report.json").read_text(encoding="utf-8")) for number in "12"]
    assert {tuple(record["cls"] for record in report["records"]) for report in reports} == {(1, 1), (7, 7)}
    for number, report in zip("12", reports, strict=True):
        assert all(record["look"].startswith(f".rvads/{number}/") for record in report["records"])


def test_a_process_draws_the_first_failures_and_of_every_rule_one(
    pytester: pytest.Pytester, racing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(artefacts, "_MOST_PAGES", 1)
    result = pytester.runpytest("-vv")
    *drawn, third, fourth = looks(result)
    assert [look.partition("#")[0].endswith(".html") for look in drawn] == [True, True]
    rest = "test_it.py::test_rules[stop4-class07-as1133-cfgd03.00v00.00"
    assert (third, fourth) == tuple(f'rvads replay --session 1 "{rest}-{rule}]"' for rule in ("full_stop", "stays_out"))
    records = json.loads((racing / "1" / "report.json").read_text(encoding="utf-8"))["records"]
    assert ["look" in record for record in records] == [True, True, False, False]
    assert rf"rvads replay --session 1 \"{rest}-full_stop]\"" in (racing / "1" / "index.html").read_text(encoding="utf-8")
    assert len(list((racing / "1" / "runs").iterdir())) == 2, "what is not drawn is kept all the same"


def test_a_folder_elsewhere_is_named_by_the_command(
    pytester: pytest.Pytester, racing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(artefacts, "_MOST_PAGES", 1)
    result = pytester.runpytest("-vv", "--rvads-artefacts=out/of the way")
    assert looks(result)[-1].startswith('rvads replay --session "out/of the way/1" "test_it.py::')
    result.stdout.fnmatch_lines(["look: out/of the way/1/index.html"])
    assert not racing.exists()


def test_runs_beyond_the_room_are_not_kept(pytester: pytest.Pytester, racing: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(artefacts, "_MOST_PAGES", 1)
    monkeypatch.setattr(artefacts, "_MOST_BYTES", 1)
    result = pytester.runpytest("-vv")
    assert looks(result)[2].startswith("not drawn, and its run is not kept, those of this session take ")
    assert len(list((racing / "1" / "runs").iterdir())) == 1


def test_a_run_that_can_t_be_kept_is_drawn(pytester: pytest.Pytester, racing: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (pytester.path / "file").write_text("in the way", encoding="utf-8")
    monkeypatch.setattr(folders, "run_file", lambda _, digest: pytester.path / "file" / digest)
    (look,) = looks(pytester.runpytest("-k", "class01 and full_stop"))
    assert (pytester.path / look.partition("#")[0]).exists()


@pytest.mark.extended
def test_killed_session_leaves_pages_and_runs(
    pytester: pytest.Pytester, racing: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytester.makepyfile(test_it=RACING + "\ndef test_end():\n    import os\n    os._exit(9)\n")
    assert pytester.runpytest_subprocess("-k", "(class01 and full_stop) or end").ret == 9
    assert {path.suffix for path in (racing / "1").iterdir()} == {"", ".html", ".svg"}
    assert len(list((racing / "1" / "runs").iterdir())) == 1
    capsys.readouterr()
    assert main(["replay"]) == 2
    assert "the session of .rvads/1 has not ended, or died" in capsys.readouterr().err
    pytester.runpytest("-k", "class07 and full_stop").stdout.fnmatch_lines(["look: .rvads/2/index.html"])
    assert main(["replay", "class07"]) == 0


def test_the_last_few_sessions_stay(pytester: pytest.Pytester, racing: Path) -> None:
    for token in "abcdef":
        (claimed(racing, token, 9) / "report.json").write_text("{}")
    (racing / "mine.html").write_text("mine")
    pytester.runpytest("-k", "class01 and full_stop")
    assert {path.name for path in racing.iterdir()} == {"3", "4", "5", "6", "7", "latest", "mine.html", ".gitignore"}


@pytest.mark.parametrize(
    ("content", "options"),
    [
        ("def test_plain(): assert not 'ours'", ()),
        (RACING, ("--collect-only",)),
        (RACING, ("--rvads-artefacts=none",)),
        (RACING, ("-k", "no_such")),
        ("def test_plain(): assert not 'ours'", ("-n1",)),
    ],
    ids=["not ours", "collected only", "none", "deselected", "worker"],
)
def test_session_without_failures_of_ours_leaves_no_folder(
    pytester: pytest.Pytester, content: str, options: tuple[str, ...]
) -> None:
    pytester.makepyfile(content)
    pytester.runpytest(*options)
    assert not (pytester.path / ".rvads").exists()


def test_a_green_session_leaves_its_report(pytester: pytest.Pytester, racing: Path) -> None:
    pytester.runpytest("-k", "class01 and full_stop", "--rvads-autopilot=reference").assert_outcomes(passed=1)
    assert {path.name for path in (racing / "1").iterdir()} == {"index.html", "report.json", ".session"}


def test_hostile_ids_become_plain_file_names_and_quoted_words(
    pytester: pytest.Pytester, racing: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [
        "../../up",
        "$(touch hacked)",
        "`touch hacked`",
        "<script>alert(1)</script>",
        "a'b",
        'c"d',
        "con\\aux",
        "x" * 300,
        "é\n",
    ]
    content = RACING.replace("@rvads.scenario", f"@pytest.mark.parametrize('odd', {names!r})\n@rvads.scenario")
    pytester.makepyfile(test_it=content.replace("def test_rules(", "def test_rules(odd, ").replace("(1, 7)", "1"))
    monkeypatch.setattr(artefacts, "_MOST_PAGES", 0)
    result = pytester.runpytest("-k", "full_stop", "-vv")
    result.assert_outcomes(failed=len(names))
    (drawn,) = (racing / "1").glob("test_it*.html")
    assert "<script>alert" not in drawn.read_text(encoding="utf-8")
    told = [look for look in looks(result) if look.startswith("rvads replay ")]
    assert len(told) == len(names) - 1
    for look in told:
        command = look.replace("rvads replay", f"{sys.executable} -c 'import sys; print(len(sys.argv), sys.argv[3])'")
        printed = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, check=True).stdout
        assert printed.startswith("4 test_it.py::test_rules[")
        assert main(["replay", "--session", "1", printed.removeprefix("4 ").rstrip("\n")]) == 0
    assert not list(pytester.path.rglob("hacked"))
    assert len(list((racing / "1").glob("test_it*.html"))) == len(names)
    assert {path.parent for path in pytester.path.rglob("*.html")} == {racing / "1"}


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[Beside]:
    """What stands beside the pages of sessions within this test."""
    found: list[Beside] = []
    pages = replay.failure_pages

    def spy(run: Run, verdict: Any, rule: Any, notes: str, beside: Beside) -> Iterator[Any]:
        found.append(beside)
        return pages(run, verdict, rule, notes, beside)

    monkeypatch.setattr(replay, "failure_pages", spy)
    return found


def test_beside_a_replay_stand_facts_and_the_other_verdicts(pytester: pytest.Pytester, racing: Path, shown: list[Beside]) -> None:
    pytester.runpytest("-k", "class07 and full_stop")
    (beside,) = shown
    told = dict(beside.facts)
    assert told["scenario"].startswith("stop4-class07-as1133-cfgd03.00v00.00 (0->1 ")
    assert told["driven by"].startswith("test_it.Racer (test_it.py ")
    assert told["rule"] == "full_stop: full stop"
    assert told["rerun"] == 'pytest "test_it.py::test_rules[stop4-class07-as1133-cfgd03.00v00.00-full_stop]"'
    ((rule, status, message),) = beside.others
    assert (rule, status) == ("stays_out", "FAIL"), "also where it was not selected"
    assert message.startswith("stays_out at t=")
    assert (beside.back, beside.ghost) == ("index.html", None)


def slower(folder: Path) -> None:
    file = folder / "test_it.py"
    file.write_text(file.read_text(encoding="utf-8").replace("return 8.0", "return 2.50"), encoding="utf-8")


@pytest.mark.parametrize("started", [".", "sub"])
def test_the_run_of_the_baseline_is_a_ghost(pytester: pytest.Pytester, racing: Path, shown: list[Beside], started: str) -> None:
    pytester.runpytest("-k", "class07", "--rvads-keep=kept", "--rvads-report=main.json")
    before = load_run(next((pytester.path / "kept").iterdir()))
    slower(pytester.path)
    shown.clear()
    where = pytester.path / started
    where.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(where)
        path = Path("..", "main.json") if started == "sub" else Path("main.json")
        pytester.runpytest("-k", "class07", f"--rvads-baseline={path}", str(pytester.path))
    assert [beside.ghost for beside in shown] == [before, before]
    assert {beside.ghost_name for beside in shown} == {"main.json"}


@pytest.mark.slow  # a worker starts
def test_worker_finds_the_run_of_the_baseline(pytester: pytest.Pytester, racing: Path) -> None:
    pytester.makeconftest("""
        from pathlib import Path
        from pytest_rvads.satellites.pages import replay

        def spy(run, verdict, rule, notes, beside, pages=replay.failure_pages):
            Path("ghost").write_text(str(beside.ghost and beside.ghost.hash))
            return pages(run, verdict, rule, notes, beside)

        replay.failure_pages = spy
    """)
    chosen = ("-k", "class07 and full_stop", "-n1")
    pytester.runpytest_subprocess(*chosen, "--rvads-keep=kept", "--rvads-report=main.json")
    assert Path("ghost").read_text() == "None"
    slower(pytester.path)
    pytester.runpytest_subprocess(*chosen, "--rvads-baseline=main.json")
    assert Path("ghost").read_text() == load_run(next((pytester.path / "kept").iterdir())).hash


@pytest.mark.parametrize("lost", ["not kept", "another run", "damaged", "the same", "elsewhere"])
def test_ghost_requires_a_readable_run_of_the_baseline(
    pytester: pytest.Pytester, racing: Path, shown: list[Beside], lost: str
) -> None:
    chosen = ("-k", "class07 and full_stop")
    pytester.runpytest(*chosen, "--rvads-report=main.json", *([] if lost == "not kept" else ["--rvads-keep=kept"]))
    kept = next((pytester.path / "kept").iterdir()) if lost != "not kept" else None
    for path in (racing / "1" / "runs").iterdir():
        path.unlink()
    if lost != "the same":
        slower(pytester.path)
    if lost == "damaged" and kept:
        kept.write_bytes(kept.read_bytes()[:100])
    if lost == "another run":
        pytester.runpytest(*chosen, "--rvads-keep=kept")
    if lost == "elsewhere":
        main_json = pytester.path / "main.json"
        text = main_json.read_text(encoding="utf-8")
        main_json.write_text(text.replace('"kept": "kept"', '"kept": "../../nowhere"'), encoding="utf-8")
    shown.clear()
    pytester.runpytest(*chosen, "--rvads-baseline=main.json").assert_outcomes(failed=1)
    assert [beside.ghost for beside in shown] == [None]

"""The command line: answers on standard output, one line on standard error and status 2 for bad input."""

import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest

from pytest_rvads.cli import main
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.kpis import kpis
from pytest_rvads.runs.runfile import load_run, save_run
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from tests.inner_sessions import records_of

RVADS = str(Path(sys.executable).with_name("rvads"))


def test_classes_lists_lazily(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["classes", "5"]) == 0
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert lines[0] == "1024 scenarios in 208 classes"
    assert len(lines) == 101
    assert "108 more" in err
    main(["classes", "5", "--all"])
    assert len(capsys.readouterr().out.splitlines()) == 209


def test_eight_ways_answer_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["classes", "8"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "5764801 scenarios in 720916 classes"


def test_pictures_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pytest_rvads.geometry.opendrive.map_file import path_of

    assert main(["classes", "3", "--svg", str(tmp_path / "c.svg")]) == 0
    assert main(["map", str(path_of("light4")), "--json", "--svg", str(tmp_path / "m.svg")]) == 0
    for name in ("c.svg", "m.svg"):
        assert ET.parse(tmp_path / name).getroot().tag.endswith("svg")
    out = capsys.readouterr().out
    assert json.loads(out[out.index("{") :])["junctions"][0]["control"] == "lights"


@pytest.mark.parametrize(
    "arguments",
    [
        ["classes", "9"],
        ["classes", "x"],
        ["rules", "no_such_rule"],
        ["map", "nowhere.xodr"],
        ["map", __file__],
        ["check", "nowhere.json"],
        ["check", __file__],
        ["rules", "--dot"],
        ["rules", "nowhere.rules"],
        ["classes", "3", "--svg", "/dev/null/c.svg"],
    ],
)
def test_bad_input_is_one_line_and_status_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == "" or arguments[0] == "classes"
    assert err.startswith("rvads: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize("arguments", [[], ["nonsense"], ["classes"], ["monitor", "G p"]])
def test_wrong_usage_is_argparse_s(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no device that is always full")
@pytest.mark.parametrize("arguments", ["classes 4", "dynamics braking --json", "rules"])
def test_full_disk_behind_standard_output_is_told_in_one_sentence(arguments: str) -> None:
    with Path("/dev/full").open("w") as full:
        command = f"{RVADS} {arguments}"
        done = subprocess.run(["bash", "-c", command], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "rvads: [Errno 28] No space left on device: standard output or a temporary file can't be written"
    ]


@pytest.mark.extended
def test_a_reader_that_had_enough_is_no_error() -> None:
    command = f"{RVADS} classes 7 --all | head -1"
    done = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_recorded_runs_are_judged(shared: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(shared / "runs" / "t-way-stop.json")
    assert main(["check", file, "--json", "--rule", "paper"]) == 0
    judged = json.loads(capsys.readouterr().out)
    published = {run["name"]: run["verdicts"] for run in json.loads(Path(file).read_text(encoding="utf-8"))["runs"]}
    words = {"True": "PASS", "False": "FAIL", "None": "NA"}
    names = {"one-car-in-junction": "p1", "right-of-priority": "p2", "fifo-priority": "p3"}
    assert set(judged) == {"version", *published}
    for run, verdicts in published.items():
        for name, verdict in (verdicts or {}).items():
            assert judged[run][names[name]]["status"] == words[verdict]
    assert main(["check", file, "--rules", "p1"]) == (1 if "FAIL" in str(judged) else 0)


def test_a_kept_run_gets_the_verdict_it_had(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    pytester.makepyfile(
        test_keep="""
        import pytest_rvads as rvads

        @rvads.scenario("stop3", classes=(1, 2), grid="E", rules=("p1", "p3"))
        def test_rules(run, rule, monitor):
            monitor.check(rule)
        """
    )
    pytester.runpytest("--rvads-keep=kept", "--rvads-report=out.json")
    records = records_of(pytester.path)
    files = sorted((pytester.path / "kept").glob("*.npz"))
    assert [f.name for f in files] == [f"test_keep.test_rules-stop3-class0{n}-as11{n}-cfgE.npz" for n in (1, 2)]
    for record in records:
        (file,) = [f for f in files if f"-as{record['scenario']}-" in f.name]
        run = load_run(file)
        assert run.hash == record["hash"]
        assert check(run, record["rule"]).status == record["status"]
    capsys.readouterr()
    assert main(["check", str(files[0]), "--rules", "p1"]) == 0
    assert "PASS" in capsys.readouterr().out


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("kept") / "run.npz"
    save_run(simulate(Case(Scenario(find("light4"), "1230", distance=5.0, duration=5.0), Reference)), path)
    return path


def test_indicators_are_shown_to_people_and_on_request_to_programs(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wanted = kpis(load_run(kept)).record()
    main(["check", str(kept), "--json", "--rule", "paper"])
    _, plain = json.loads(capsys.readouterr().out).values()
    main(["check", str(kept), "--json", "-v", "--rule", "paper"])
    _, full = json.loads(capsys.readouterr().out).values()
    assert set(plain) == {"p1", "p2", "p3", "p4", "p5", "p6"}
    assert full == {**plain, "(kpis)": wanted}
    main(["check", str(kept)])
    waiting = ", ".join(f"{v['agent']} {v['waiting']:.2f}" for v in wanted["vehicles"])
    assert f"\n  waiting [s]  {waiting}\n" in capsys.readouterr().out


def test_rules_of_a_file_judge_kept_runs(kept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = tmp_path / "own.rules"
    own.write_text("[gets_in]\ntext = forall a. F a@j\n", encoding="utf-8")
    assert main(["check", str(kept), "--rules", str(own), "--rules", "p1", "--json"]) == 0
    _, judged = json.loads(capsys.readouterr().out).values()
    assert list(judged) == ["gets_in", "p1"]
    assert main(["check", str(kept), "--rules", str(tmp_path / "none.rules")]) == 2


@pytest.mark.parametrize("json_too", [[], ["--json"]])
def test_a_run_that_could_not_be_judged_is_no_success(
    kept: Path, tmp_path: Path, json_too: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    run = load_run(kept)
    speed = run.need("speed").copy()
    speed[3, 1] = float("nan")
    save_run(replace(run, speed=speed), tmp_path / "nan.npz")
    assert main(["check", str(tmp_path / "nan.npz"), *json_too]) == 2
    out, err = capsys.readouterr()
    assert "ERROR" in out
    assert err.splitlines()[-1].endswith("can't be judged: speed of a1 at 0.03 s is not a finite number")


def test_rules_of_a_file_run_like_others(pytester: pytest.Pytester) -> None:
    pytester.makefile(".rules", own="[gets_in]\ntext = forall a. F a@j\ntitle = everybody gets in\n")
    pytester.makeini("[pytest]\nrvads_rules = own.rules\n")
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop3", classes=1, grid="E", rules=("gets_in", "p1"))
        def test_rules(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest("-v")
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["*stop3-class01-as111-cfgE-gets_in?*PASSED*"])


def test_the_braking_table_is_the_plant_s(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dynamics", "braking", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert set(table) == {"1", "2", "3"}
    # Without any lag a vehicle stops from v = sqrt(2 a d); the brake's lag costs some of it, never gains.
    for aggression, deceleration in (("1", 4.0), ("2", 6.0), ("3", 8.0)):
        for distance, speed in table[aggression].items():
            ideal = min((2 * (deceleration + 0.3) * float(distance)) ** 0.5, 11.176)
            assert 0.5 * ideal < speed <= ideal


def test_a_rule_is_shown_by_its_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "own.rules"
    file.write_text("[calm]\ntext = forall a. G !stopped(a)\n", "utf-8")
    assert main(["rules", str(file), "full_stop", "calm"]) == 0
    shown = capsys.readouterr().out
    assert re.findall(r"^  (\w+)", shown, re.MULTILINE) == ["full_stop", "calm"]
    assert "!a@j W stopped(a)" in shown
    assert "      1  F  no continuation satisfies the formula\n           stays when true" in shown


def test_automaton_of_a_rule_is_drawn_for_graphviz(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "own.rules"
    file.write_text("[nested]\ntext = forall a. G(a@j -> exists a'. stopped(a'))\n", "utf-8")
    assert main(["rules", "keep_lane", "--dot"]) == 0
    assert capsys.readouterr().out.splitlines()[4:] == [
        '  0 [label="0\\n?", fillcolor="#ffffff"];',
        '  1 [label="1\\nF", fillcolor="#f4b6b6"];',
        '  0 -> 0 [label="!off_lane(a)"];',
        '  0 -> 1 [label="off_lane(a)"];',
        '  1 -> 1 [label="true"];',
        "}",
    ]
    assert main(["rules", "nested", str(file)]) == 0
    assert "rule 'nested' has a quantifier inside" in capsys.readouterr().out
    assert main(["rules", "nested", str(file), "--dot"]) == 2


def test_classes_of_a_junction_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["classes", "stop4"]) == 0
    named = capsys.readouterr().out
    assert main(["classes", "4"]) == 0
    assert capsys.readouterr().out == named
    assert main(["classes", "4", "--map", "town.xodr"]) == 2
    assert "town.xodr" in capsys.readouterr().err


ASCII = os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONPATH": os.pathsep.join(sys.path)}


@pytest.mark.extended
@pytest.mark.parametrize(
    "arguments",
    [["rules", "größer.rules"], ["rules"], ["map", "größe.xodr"], ["check", "→.npz"]],
)
def test_every_answer_can_be_written_in_every_encoding(arguments: list[str], tmp_path: Path) -> None:
    from pytest_rvads.geometry.opendrive.map_file import path_of

    rule = 'größer = forall a. G !(a@j)\n    title: "→ größer"\n'
    (tmp_path / "größer.rules").write_text(rule, encoding="utf-8")
    (tmp_path / "größe.xodr").write_bytes(path_of("stop3").read_bytes())
    done = subprocess.run([RVADS, *arguments], env=ASCII, cwd=tmp_path, capture_output=True, timeout=60, check=False)
    assert (done.stdout + done.stderr).isascii()
    assert b"Traceback" not in done.stderr
    assert done.stdout or done.stderr.startswith(b"rvads: ")


def test_names_from_files_are_no_commands_of_the_terminal(kept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = load_run(kept)
    save_run(replace(run, label="\u202erun"), tmp_path / "run.npz")
    main(["check", str(tmp_path / "run.npz")])
    main(["check", str(tmp_path / "no\x1b[2J.npz")])
    out, err = capsys.readouterr()
    assert out.startswith(r"\u202erun")
    assert r"no\x1b[2J.npz" in err
    assert "\x1b" not in out + err


@pytest.mark.parametrize("closed", ["<&-", ">&-"])
def test_a_stream_that_is_closed_is_told_in_one_sentence(closed: str) -> None:
    command = f"{Path(sys.executable).with_name('rvads')} monitor --jsonl {closed}"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == ("rvads: it needs an open standard input and output: redirect what is of no use to /dev/null\n")

"""Campaigns: the same results whatever works on them, on disk as they come, and never of anything else than is asked."""

import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.satellites.campaigns import campaign
from pytest_rvads.satellites.campaigns.resultsfile import Judged
from pytest_rvads.simulators.patience import Watch
from pytest_rvads.simulators.simulator import Choice

FEW = 6
RULES = len(rules_for("road", rvads.find("stop4")))


class Broken(rvads.Follower):
    """Raises in its first decision."""

    def target_speed(self, seen: Observation) -> float:
        raise ZeroDivisionError("no speed")


class Deadly(rvads.Follower):
    """Kills its process where the draw is 2 s."""

    def target_speed(self, seen: Observation) -> float:
        if seen.wait == 2.0:
            os.kill(os.getpid(), signal.SIGKILL)
        return 1.0


class Steady(rvads.Follower):
    """Drives at one speed."""

    def __init__(self, speed: float = 8.0) -> None:
        super().__init__()
        self.speed = speed

    def target_speed(self, seen: Observation) -> float:
        return self.speed


def cases(driver: Any = rvads.Reference, distances: Iterable[float] = range(4, 4 + FEW), **changes: Any) -> Iterator[rvads.Case]:
    place = rvads.find("stop4")
    for distance in distances:
        yield rvads.Case(rvads.Scenario(place, "1010", distance=float(distance), duration=0.5, **changes), driver)


@pytest.fixture(scope="module")
def alone() -> list[Judged]:
    """Results of this process."""
    return list(rvads.campaign(cases(), executor=1))


def test_a_campaign_says_of_a_case_what_simulating_and_checking_it_says(alone: list[Judged]) -> None:
    for judged, case in zip(alone, cases(), strict=True):
        run = rvads.simulate(case)
        assert (judged.name, judged.hash, judged.duration) == (case.scenario.name, run.hash, run.duration)
        for verdict in judged.verdicts:
            assert verdict.status == str(rvads.check(run, verdict.rule).status)
        assert {"no_collision", "full_stop"} <= {verdict.rule for verdict in judged.verdicts}


def test_results_are_the_same_whatever_works_on_them_and_in_which_order(alone: list[Judged]) -> None:
    assert list(rvads.campaign(cases(), executor=2)) == alone
    with ThreadPoolExecutor(2) as threads:
        assert list(rvads.campaign(cases(), executor=threads)) == alone
    backwards = rvads.campaign(list(cases())[::-1], executor=1)
    assert [msgspec.structs.replace(judged, number=0) for judged in backwards][::-1] == [
        msgspec.structs.replace(judged, number=0) for judged in alone
    ]


def test_what_has_a_result_is_not_run_again(tmp_path: Path, alone: list[Judged], monkeypatch: pytest.MonkeyPatch) -> None:
    path, run = tmp_path / "results.jsonl", []

    def counted(case: rvads.Case, simulator: rvads.Simulator) -> rvads.Run:
        run.append(case.scenario.name)
        return rvads.simulate(case, simulator)

    monkeypatch.setattr(campaign, "simulate", counted)
    rvads.campaign(list(cases())[:4], executor=1, results=path).close()
    with rvads.campaign(cases(), executor=1, results=path) as results:
        assert list(results) == alone
    assert len(run) == len(set(run)) == FEW


def test_an_interrupted_campaign_goes_on_where_it_was(tmp_path: Path, alone: list[Judged]) -> None:
    path = tmp_path / "results.jsonl"

    def interrupt(done: int, _: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rvads.campaign(cases(), executor=2, results=path, progress=interrupt)
    with path.open("ab") as file:
        file.write(b'\n{"case":"cut of')  # as a crash leaves it
    with rvads.values.Results(path) as half:
        assert half.exitstatus == 2
        assert "INCOMPLETE" in half.report().notes[0]
        assert len(half) == 3
    with rvads.campaign(cases(), executor=1, results=path) as results:
        assert list(results) == alone
        assert results.exitstatus == 0


def test_a_worker_keeps_one_junction_however_many_batches_bring_it(monkeypatch: pytest.MonkeyPatch) -> None:
    met = []

    def noted(case: rvads.Case, simulator: rvads.Simulator) -> rvads.Run:
        met.append(case.scenario)
        return rvads.simulate(case, simulator)

    monkeypatch.setattr(campaign, "simulate", noted)
    sent = [pickle.loads(pickle.dumps(case)) for case in cases()]
    rvads.campaign(sent, "no_collision", executor=1).close()
    assert met == [case.scenario for case in sent]
    assert len({id(scenario.place) for scenario in met}) == 1 < len({id(case.scenario.place) for case in sent})


def test_progress_counts_cases_done_before_and_left_out(tmp_path: Path) -> None:
    path, told = tmp_path / "results.jsonl", []
    rvads.campaign(cases(distances=[4, 5]), executor=1, results=path).close()
    results = rvads.campaign(
        cases(distances=[4, 5, 1e4, 6]), executor=1, results=path, total=4, progress=lambda *now: told.append(now)
    )
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert results.report().unfit == {"stop4": 1}
    assert len(results) == 3


def test_results_of_something_else_are_not_mixed_in(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    rvads.campaign(cases(partial(Steady, 7.0)), "no_collision", executor=1, results=path).close()
    others: dict[str, tuple[Any, str, Any]] = {
        "rules": (partial(Steady, 7.0), "road", None),
        "driver": (rvads.Reference, "no_collision", None),
        "code or values of .*Steady": (partial(Steady, 8.0), "no_collision", None),
        "simulator": (partial(Steady, 7.0), "no_collision", Renamed()),
    }
    for what, (driver, rules, simulator) in others.items():
        with pytest.raises(
            rvads.errors.RvadsError, match=rf"holds results of another campaign \(.*{what}.*\): name another file"
        ):
            rvads.campaign(cases(driver), rules, executor=1, results=path, simulator=simulator)
    two = [*cases(partial(Steady, 7.0), [4]), *cases(partial(Steady, 8.0), [4])]
    with pytest.raises(
        rvads.errors.RvadsError, match=r"two different drivers of a campaign have the name .*Steady: give each driver a name"
    ):
        rvads.campaign(two, executor=1)


def test_a_policy_may_be_the_class_of_the_driver_with_other_numbers() -> None:
    seated = [
        rvads.Case(case.scenario.but(subject=0), rvads.Reference, traffic=rvads.traffic(name))
        for name in ("reference", "hesitant")
        for case in cases(distances=[4])
    ]
    usual, hesitant = rvads.campaign(seated, "no_collision", executor=2)
    assert (usual.name, usual.traffic, usual.seat) == (seated[0].scenario.name, "reference", 0)
    assert (hesitant.name, hesitant.traffic) == (f"{seated[1].scenario.name}-hesitant", "hesitant")


class Renamed:
    """The usual simulator under another name."""

    name = "renamed"

    def __call__(self, case: rvads.Case, watch: Watch | None = None, /) -> rvads.Run:
        return rvads.mujoco(case, watch)

    def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
        return rvads.mujoco.vmax(distance, aggression, vehicle)


def test_a_file_that_is_written_to_is_not_written_to_by_another_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pytest_rvads.satellites.campaigns import resultsfile

    monkeypatch.setattr(resultsfile, "_PATIENCE", 0.0)
    path = tmp_path / "results.jsonl"

    def begin_another(done: int, _: int) -> None:
        if done == 1:
            with pytest.raises(rvads.errors.RvadsError, match="another campaign writes to"):
                rvads.campaign(cases(), executor=1, results=path)

    rvads.campaign(cases(), executor=1, results=path, progress=begin_another).close()
    rvads.campaign(cases(), executor=1, results=path).close()


def test_a_driver_that_raises_costs_its_own_cases() -> None:
    two = [*cases(Broken, [4, 5]), *cases(distances=[6])]
    first, second, third = rvads.campaign(two, ["no_collision", "progress"], executor=1)
    for judged in (first, second):
        assert {verdict.status for verdict in judged.verdicts} == {Outcome.ERROR}
        assert "ZeroDivisionError: no speed" in judged.verdicts[0].message
    assert Outcome.ERROR not in {verdict.status for verdict in third.verdicts}


def test_a_case_that_kills_its_process_is_an_error_and_costs_no_other() -> None:
    mixed = [*cases(Deadly, [4, 6, 7]), *cases(Deadly, [5], wait=2.0), *cases(Deadly, [8, 9])]
    results = rvads.campaign(mixed, "no_collision", executor=2)
    found = {judged.cfg: judged.verdicts[0] for judged in results}
    assert len(found) == FEW
    dead = found.pop("d05.00v00.00")
    assert dead.outcome is Outcome.ERROR
    assert "the process that simulated it died" in dead.message
    assert {verdict.status for verdict in found.values()} == {Outcome.PASS}
    assert results.exitstatus == 1


def test_what_can_not_travel_says_what_to_do() -> None:
    with pytest.raises(rvads.errors.RvadsError, match=r"can't travel to another process .*executor=1"):
        rvads.campaign(cases(lambda: rvads.Reference()), executor=2)
    assert len(rvads.campaign(cases(lambda: rvads.Reference()), "no_collision", executor=1)) == FEW


def fast(run: rvads.Run, agent: int) -> NDArray[np.bool_]:
    return run.need("speed")[:, agent] > 1.0


def test_rules_and_words_of_users_travel() -> None:
    word = rvads.values.Word("fast", ("agent",), fast)
    mine = rvads.Rule("slow", "forall a. G !fast(a)", words=(word,))
    beside = rvads.campaign(cases(partial(Steady, 6.0), [20.0], speed=5.0), mine, executor=2)
    assert [judged.verdicts[0].status for judged in beside] == [Outcome.FAIL]
    assert [judged.verdicts[0].rule for judged in beside] == ["slow"]


def test_a_worker_with_other_code_answers_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    question = campaign.Question(("no_collision",), Choice(rvads.bullet), "0" * 64, {"pytest-rvads": "0.0"})
    with pytest.raises(rvads.errors.RvadsError, match=r"a worker has other code .*install the same version"):
        campaign.judge(question, campaign.Job(0, "0" * 64, next(cases()), "driver", None))


@pytest.mark.parametrize("wrong", ["stop4", None, [1], [rvads.find("stop4")]])
def test_what_is_no_case_is_refused(wrong: Any) -> None:
    with pytest.raises(rvads.errors.ScenarioError, match="a campaign takes cases"):
        rvads.campaign(wrong, executor=1)


def test_no_cases_are_nothing_judged() -> None:
    results = rvads.campaign([], executor=1)
    assert (len(results), results.exitstatus) == (0, 5)


def test_reports_are_made_of_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, whole = tmp_path / "results.jsonl", tmp_path / "report.json"
    rvads.campaign(cases(), executor=1, results=path).close()
    assert main(["report", "merge", str(path), "-o", str(whole), "-o", str(tmp_path / "report.csv")]) == 0
    out = capsys.readouterr().out
    assert f"{FEW} runs, {RULES * FEW} verdicts" in out
    report = json.loads(whole.read_text())
    assert len(report["records"]) == RULES * FEW
    assert len({record["nodeid"] for record in report["records"]}) == RULES * FEW


def test_parts_of_a_campaign_make_one_report_in_which_nothing_counts_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = [str(tmp_path / f"{part}.jsonl") for part in range(2)]
    rvads.campaign(cases(distances=[4, 5, 6]), executor=1, results=parts[0]).close()
    rvads.campaign(cases(distances=[6, 7]), executor=1, results=parts[1]).close()
    assert main(["report", "merge", *parts]) == 0
    assert f"4 runs, {4 * RULES} verdicts" in capsys.readouterr().out
    other = str(tmp_path / "other.jsonl")
    rvads.campaign(cases(distances=[4]), "no_collision", executor=1, results=other).close()
    assert main(["report", "merge", *parts, other]) == 2
    assert "holds results of another campaign than" in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"", b"{}", b"\x00\xff", b'{"format":"rvads-campaign","version":1}', b"[" * 10_000])
def test_what_is_no_file_of_results_is_refused(tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "results.jsonl"
    path.write_bytes(content)
    assert main(["report", "merge", str(path)]) == 2
    assert "holds no results of a campaign of version 2" in capsys.readouterr().err
    if content:
        with pytest.raises(rvads.errors.RvadsError, match="holds no results"):
            rvads.campaign(cases(), executor=1, results=path)
        assert path.read_bytes() == content


def test_results_of_several_campaigns_in_one_file_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parts = []
    for driver in (rvads.Reference, Steady):
        parts.append(tmp_path / f"{driver.__name__}.jsonl")
        rvads.campaign(cases(driver, [4]), "no_collision", executor=1, results=parts[-1]).close()
    both = tmp_path / "both.jsonl"
    both.write_bytes(b"".join(part.read_bytes() for part in parts))
    assert main(["report", "merge", str(both)]) == 2
    assert "both.jsonl holds results of several campaigns (driver" in capsys.readouterr().err


def test_no_command_is_told_that_nobody_could_run(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path, page = tmp_path / "results.jsonl", tmp_path / "report.md"
    one = rvads.Case(rvads.Scenario(rvads.find("stop4"), "2000", distance=15.0, speed=5.0, duration=8.0), rvads.RollingStop)
    rvads.campaign([one], "full_stop", executor=1, results=path).close()
    assert main(["report", "merge", str(path), "-o", str(page)]) == 1
    assert f'first: "{one.scenario.name}-full_stop"' in capsys.readouterr().out
    assert "| first |" in page.read_text()


def test_a_result_that_was_damaged_later_is_missed(tmp_path: Path, alone: list[Judged]) -> None:
    path = tmp_path / "results.jsonl"
    rvads.campaign(cases(), executor=1, results=path).close()
    lines = path.read_bytes().split(b"\n")
    third = next(k for k, line in enumerate(lines) if alone[2].case.encode() in line)
    lines[third] = lines[third].replace(b'"verdicts":', b'"verdicts"?')
    path.write_bytes(b"\n".join(lines))
    with rvads.values.Results(path) as damaged:
        assert (len(damaged), damaged.exitstatus, damaged.report().complete) == (FEW - 1, 2, False)
    with rvads.campaign(cases(), executor=1, results=path) as results:
        assert (list(results), results.exitstatus) == (alone, 0)


@pytest.mark.parametrize("kept", [0, 1, 40])
def test_a_head_that_was_cut_off_is_written_again(tmp_path: Path, kept: int, alone: list[Judged]) -> None:
    path = tmp_path / "results.jsonl"
    rvads.campaign(cases(distances=[4]), executor=1, results=path).close()
    path.write_bytes(path.read_bytes()[:kept])
    with rvads.campaign(cases(distances=[4]), executor=1, results=path) as results:
        assert list(results) == alone[:1]


@pytest.mark.skipif(sys.platform != "linux", reason="limits the size of files")
def test_a_full_disk_ends_a_campaign_that_goes_on_when_there_is_room(tmp_path: Path, alone: list[Judged]) -> None:
    import resource

    path, usual = tmp_path / "results.jsonl", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (12_000, usual[1]))
    try:
        with pytest.raises(rvads.errors.RvadsError, match=r"no result can be added to .*make room, then run the campaign again"):
            rvads.campaign(cases(), executor=1, results=path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    with rvads.values.Results(path) as half:
        assert 0 < len(half) < FEW
    with rvads.campaign(cases(), executor=1, results=path) as results:
        assert list(results) == alone


def test_results_are_not_written_to_what_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(rvads.errors.RvadsError, match="is no regular file"):
        rvads.campaign(cases(), executor=1, results=tmp_path / "pipe")
    with pytest.raises(OSError, match="expected a regular file"):
        rvads.values.Results(tmp_path / "pipe")


HASHES = """
import sys; sys.path.insert(0, {folder!r})
from pytest_rvads.drivers.identity import identity
import mine
before = identity(mine.Mine)
mine.Mine().control(None)
assert identity(mine.Mine) == before
print(before)
"""


@pytest.mark.extended
@pytest.mark.parametrize(
    "imports",
    ["import helper\nclass Mine:\n def control(self, seen):", "class Mine:\n def control(self, seen):\n  import helper"],
)
def test_a_driver_is_the_same_in_another_process_until_its_code_changes(tmp_path: Path, imports: str) -> None:
    """Whether it imports what it needs at once, or when it needs it."""

    def asked(speed: float) -> str:
        (tmp_path / "mine.py").write_text(f"{imports}\n  return helper.further.SPEED\n")
        (tmp_path / "helper.py").write_text("import further\n")
        (tmp_path / "further.py").write_text(f"SPEED = {speed}\n")
        (tmp_path / "unrelated.py").write_text(f"SPEED = {os.urandom(4).hex()!r}\n")
        command = [sys.executable, "-B", "-c", HASHES.format(folder=str(tmp_path))]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    assert asked(1.0) == asked(1.0) != asked(2.0)

"""Pedestrians beside a subject, as a user of the plugin meets them."""

import json
from pathlib import Path

import pytest

from pytest_rvads.scenarios.ids import from_id

from .conftest import Lines

TEST = """
import pytest_rvads as rvads

@rvads.scenario(
    "zebra4",
    subject=0,
    scenarios=["2222", "1222"],
    grid="CH",
    pedestrians={"behaviour": ["steady", "waits"], "side": "far", "difference": [-1, 3]},
    traffic=["reference", "stopped"],
    rules=["no_collision", "speed_limit"],
    duration=2,
)
def test_crossing(run, rule, monitor):
    monitor.check(rule)
"""


def test_ids_name_pedestrians_between_configurations_and_traffic(pytester: pytest.Pytester, brackets: Lines) -> None:
    pytester.makepyfile(TEST)
    found = brackets(pytester.runpytest("--collect-only", "-q"))
    walkers = [f"{k}f.{b}.{d}" for k in (0, 2) for b in ("steady", "waits") for d in ("e1.00", "l3.00")]
    straight = [id.partition("-s0-")[2] for id in found if "as2222" in id]
    assert straight == [
        f"w{walker}-cfg{cfg}{traffic}-{rule}"
        for cfg in "CH"
        for walker in walkers
        for traffic in ("", "-stopped")
        for rule in ("no_collision", "speed_limit")
    ]
    assert {id.partition("-w")[2][0] for id in found if "as1222" in id} == {"0", "1"}, "turning right leads to arm 1"
    assert {from_id(id).walking for id in found if "as2222" in id} == set(walkers)


def test_nobody_walks_without_the_argument(pytester: pytest.Pytester, brackets: Lines) -> None:
    pytester.makepyfile(
        'import pytest_rvads as rvads\n\n@rvads.scenario("zebra4", subject=0, classes=1, grid="C")\ndef test_it(run): ...\n'
    )
    assert brackets(pytester.runpytest("--collect-only", "-q")) == ["zebra4-class01-as1111-s0-cfgC"]


def test_each_pedestrian_has_a_cell_a_record_and_a_rerun(pytester: pytest.Pytester, reference: None, brackets: Lines) -> None:
    pytester.makepyfile(TEST)
    part = "as2222 and stopped and cfgC and no_collision"
    pytester.runpytest("-k", part, "--rvads-report=all.json").assert_outcomes(skipped=8)
    report = json.loads(Path("all.json").read_text())
    assert len(report["planned"]) == len({json.dumps(cell) for cell in report["planned"]}) == 2 * 2 * 8 * 2 * 2
    ran = [record for record in report["records"] if record["status"] != "NOT RUN"]
    assert len({record["pedestrians"] for record in ran}) == len({record["hash"] for record in ran}) == 8
    assert all(f"-w{record['pedestrians']}-" in record["nodeid"] for record in ran)
    assert all([agent["name"] for agent in record["agents"]][-1] == "p0" for record in ran)
    again = pytester.runpytest(ran[3]["nodeid"], "--rvads-report=one.json")
    again.assert_outcomes(skipped=1)
    (record,) = json.loads(Path("one.json").read_text())["records"]
    assert record["hash"] == ran[3]["hash"]
    selected = pytester.runpytest(
        "--collect-only", "-q", "-m", f"rvads(pedestrians='{ran[3]['pedestrians']}', rule='speed_limit')"
    )
    assert len(brackets(selected)) == 2 * 2 * (2 if ran[3]["pedestrians"].startswith("0") else 1)


def test_early_pedestrians_and_junctions_without_crosswalks_are_counted(pytester: pytest.Pytester, reference: None) -> None:
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario(
            ["stop4", "zebra4"], subject=0, scenarios="2222", grid="A", rules="no_collision", duration=0.1,
            pedestrians={"behaviour": "darts", "difference": [-3, 0]},
        )
        def test_it(rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest("-p", "no:randomly")
    count = sum(result.parseoutcomes().values())
    result.stdout.fnmatch_lines(
        [
            "1 junction left out: the junction has no crosswalk for pedestrians: *: stop4",
            f"1 test with scenarios left out in which a pedestrian would have crossed before the run begins: {8 - count} of *",
        ]
    )
    assert 0 < count < 8, "from rest at the line, crosswalk 0 is reached in about 1 s and crosswalk 2 later"


@pytest.mark.parametrize(
    ("label", "message"), [("0n.darts.l0.00", "2 tests collected*"), ("0n.darts.e1.00", "*matches none of*")]
)
def test_known_deficiency_names_a_pedestrian(pytester: pytest.Pytester, label: str, message: str) -> None:
    pytester.makepyfile(
        f"""
        import pytest_rvads as rvads

        @rvads.scenario("zebra4", subject=0, scenarios="2222", grid="C",
            pedestrians=[rvads.Pedestrian(0, "near", name) for name in ("darts", "waits")])
        @rvads.known("blind", pedestrians="{label}")
        def test_it(run): ...
        """
    )
    pytester.runpytest("--collect-only", "-q").stdout.fnmatch_lines([message])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ('pedestrians="runs"', "*test_*.py:3: pedestrians have the behaviours steady, *, got 'runs'*"),
        ("pedestrians=rvads.Pedestrian(9)", "*junction 'zebra4' has no crosswalk 9: its crosswalks are 0 to 3*"),
        ('pedestrians="steady", subject="all"', "*would expand to up to * items (162 scenarios × 68 pedestrians × 5 points *"),
        (
            'subject=0, scenarios="2222", pedestrians=rvads.Pedestrian(1)',
            "*no vehicle under test drives over a crosswalk at which pedestrians= lets pedestrians walk at junction 'zebra4'*",
        ),
        (
            'classes=1, grid="A", pedestrians=rvads.Pedestrian(0, "far", "darts", -9)',
            "*p0 would have crossed before the run begins, 9 s before the vehicle: choose a greater difference*",
        ),
    ],
)
def test_misuse_is_a_sentence_at_the_line_of_the_mark(pytester: pytest.Pytester, arguments: str, message: str) -> None:
    pytester.makepyfile(f'import pytest_rvads as rvads\n\n@rvads.scenario("zebra4", {arguments})\ndef test_it(run): ...\n')
    result = pytester.runpytest("--collect-only", "-q")
    result.stdout.fnmatch_lines([message])
    assert "Traceback" not in result.stdout.str()

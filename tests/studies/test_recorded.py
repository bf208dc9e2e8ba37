"""Recorded runs beside their predictions: what counts as agreement, and how much of it there is."""

import json
from pathlib import Path
from typing import Any

import pytest

from studies import prediction
from studies.predicted import Compared, compare, text_agreement

WAYS = {
    ("n0", "x1"): ("right", 12.5),
    ("n0", "x2"): ("straight", 21.6),
    ("n1", "x2"): ("right", 13.5),
    ("n1", "x0"): ("left", 23.5),
    ("n2", "x0"): ("straight", 21.5),
    ("n2", "x1"): ("left", 23.8),
}


def vehicle(entrance: int, exit: int, enters: int) -> dict[str, Any]:
    return {
        "itinerary": [f"r{entrance}", f"n{entrance}x{exit}", f"o{exit}"],
        "init_offset": 0.3,
        "init_speed": 0.0,
        "edge": [[0, f"r{entrance}"], [enters, f"n{entrance}x{exit}"]],
        "at_entrance": [[0, f"n{entrance}"], [enters, ""]],
    }


def document() -> dict[str, Any]:
    """A T with stop signs and one run, written by hand: all start 0.3 m before their lines and enter a second apart."""
    return {
        "graph": {
            "junction": "T",
            "entrances": ["n0", "n1", "n2"],
            "exits": ["x0", "x1", "x2"],
            "edges": [
                {"id": s + t, "source": s, "target": t, "turn": turn, "length": size} for (s, t), (turn, size) in WAYS.items()
            ],
            "signals": [{"id": f"s{k}", "kind": "stop_sign", "node": f"n{k}"} for k in range(3)],
        },
        "right_of": [["n1", "n0"], ["n2", "n1"]],
        "opposite": [["n0", "n2"], ["n2", "n0"]],
        "runs": [
            {
                "name": "hand_r=1",
                "ticks": 1500,
                "dt": 0.01,
                "vehicles": {"c0": vehicle(1, 2, 100), "c1": vehicle(2, 0, 200), "c2": vehicle(0, 1, 300)},
                "lights": {},
                "verdicts": {"one-car-in-junction": "True", "right-of-priority": "False", "fifo-priority": "None"},
            }
        ],
    }


def file_of(folder: Path, data: dict[str, Any]) -> Path:
    path = folder / "hand.json"
    path.write_text(json.dumps(data))
    return path


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return file_of(tmp_path, document())


def test_a_run_is_compared_vehicle_by_vehicle(file: Path) -> None:
    (found,) = compare(file, executor=1)
    assert {rule: one for rule, (one, _) in found.verdicts.items()} == {"p1": "PASS", "p2": "FAIL", "p3": "NA"}
    assert [one for one, _ in found.entries.values()] == [1.0, 2.0, 3.0]
    simulated = [two for _, two in found.entries.values()]
    assert simulated == sorted(simulated), "first in, first out, by creation"
    assert found.same_order
    # c0 goes first, so it drives as if it were alone; the others wait longer than they would alone.
    assert found.free["c0"] == pytest.approx(simulated[0] - 1.0)
    assert all(simulated[k] - (k + 1.0) > found.free[f"c{k}"] for k in (1, 2))


def test_entrances_may_be_empty(tmp_path: Path) -> None:
    data = document()
    del data["runs"][0]["vehicles"]["c1"]
    data["runs"][0]["verdicts"] = {"one-car-in-junction": "perhaps"}
    path = tmp_path / "two.json"
    path.write_text(json.dumps(data))
    (found,) = compare(path, executor=1)
    (whole,) = compare(file_of(tmp_path, document()), executor=1)
    assert list(found.entries) == ["c0", "c2"]
    assert found.entries["c0"] == whole.entries["c0"], "c0 goes first either way"
    assert found.entries["c2"][1] < whole.entries["c2"][1], "c2 no longer waits for c1"
    assert found.verdicts["p1"][0] == "perhaps", "a word that is not known stands as it is"


def run(times: dict[str, tuple[float | None, float | None]]) -> Compared:
    return Compared("run", {"p1": ("PASS", "PASS"), "p2": ("NA", "FAIL")}, times, dict.fromkeys(times, 0.5))


@pytest.mark.parametrize(
    ("one", "two", "same"),
    [
        ((1.0, 2.0), (3.0, 4.0), True),
        ((1.0, 2.0), (4.0, 3.0), False),
        ((1.0, 2.0), (3.0, 3.0), False),
        ((2.0, 1.0), (3.0, 3.0), False),
        ((1.0, 1.0), (3.0, 3.0), True),
        ((1.0, 1.0), (3.0, 4.0), False),
        ((1.0, None), (3.0, None), True),
        ((None, 1.0), (3.0, None), False),
    ],
)
def test_same_order_of_entries(one: tuple[float | None, ...], two: tuple[float | None, ...], same: bool) -> None:
    assert run({"c0": (one[0], two[0]), "c1": (one[1], two[1])}).same_order is same


def test_the_summary_is_arithmetic() -> None:
    times = {"c0": (1.0, 2.0), "c1": (2.0, 5.0), "c2": (None, 4.0)}
    lines = text_agreement([run(times)], "file").splitlines()
    assert lines[:3] == ["file", "  verdicts  1 of 2 as recorded", "  order     0 of 1 runs as recorded"]
    # One late by 1 s, one by 3 s; half a second less each without what a lone vehicle is late by.
    assert "raw: mean 2.00, mean absolute 2.00, 90 % below 2.80, worst 3.00" in lines[3]
    assert "mean 1.50" in lines[4]
    assert lines[5] == "  run: p2 is FAIL, recorded NA"
    assert "c2 4.00 s (recorded never)" in lines[6]


def test_the_command_compares_files(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert prediction.main(["--recorded", str(file)]) == 0
    assert capsys.readouterr().out.splitlines()[0] == str(file)


def without_start() -> dict[str, Any]:
    data = document()
    del data["runs"][0]["vehicles"]["c1"]["init_speed"]
    return data


def other_names() -> dict[str, Any]:
    data = document()
    data["runs"][0]["vehicles"] = {f"v{k}": v for k, v in enumerate(data["runs"][0]["vehicles"].values())}
    return data


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (without_start(), "needs a vehicle c0, a start for every vehicle"),
        (other_names(), "needs a vehicle c0"),
        ({}, "the field 'graph' is missing"),
    ],
)
def test_invalid_recorded_file_is_refused_in_one_line(
    data: dict[str, Any], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(data))
    assert prediction.main(["--recorded", str(path)]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert message in err


def agreement(found: list[Compared]) -> tuple[float, float]:
    """Shares of verdicts and of orders of entry that are as recorded."""
    cells = [one == two for run in found for one, two in run.verdicts.values()]
    return sum(cells) / len(cells), sum(run.same_order for run in found) / len(found)


@pytest.mark.extended
@pytest.mark.parametrize("name", ["t-way-stop", "t-way-light"])
def test_recorded_t_junctions_are_predicted(name: str, shared: Path, tmp_path: Path) -> None:
    data = json.loads((shared / "runs" / f"{name}.json").read_text())
    data["runs"] = data["runs"][::5]
    path = tmp_path / "some.json"
    path.write_text(json.dumps(data))
    # Of seven runs two at most may differ; the slow test asks for nine in ten of all.
    assert min(agreement(compare(path, executor=1))) >= 5 / 7


@pytest.mark.slow
def test_nine_in_ten_of_the_recorded_t_junctions_are_predicted(shared: Path) -> None:
    found = [run for name in ("t-way-stop", "t-way-light") for run in compare(shared / "runs" / f"{name}.json")]
    assert len(found) == 64
    assert min(agreement(found)) >= 0.9

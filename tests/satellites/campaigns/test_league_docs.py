"""The page on leagues: its configuration is one, its tables are those of its results, and what it quotes stands where it says."""

import json
import os
import re
from pathlib import Path

import msgspec
import pytest

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.satellites.campaigns.league import Config
from tests.tool_modules import tool

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
PAGE = (DOCS / "league.md").read_text(encoding="utf-8")
RESULTS = json.loads((DOCS / "league.json").read_text(encoding="utf-8"))
QUOTE = re.compile(r"`([\w/]+\.py)`, line (\d+):\n\n```diff\n- ( *\S.*)\n\+", re.MULTILINE)


def test_tables_are_made_of_the_results() -> None:
    assert tool("make_league").page() == PAGE, "python tools/make_league.py writes the tables"


def test_results_are_of_the_configuration_beside_them() -> None:
    config = Config.read(DOCS / "league.toml")
    assert msgspec.convert(RESULTS["config"], Config) == config
    assert [driver["name"] for driver in RESULTS["drivers"]] == list(config.drivers)


def test_every_driver_has_a_result_of_every_cell_and_line() -> None:
    for driver in RESULTS["drivers"]:
        assert driver["runs"] == RESULTS["cells"] == RESULTS["config"]["cells"]
        assert len(driver["sides"]) == 2 * RESULTS["lines"] == 2 * RESULTS["config"]["critical"]
        assert not driver["notes"]
        assert Outcome.ERROR not in {outcome for counts in driver["verdicts"].values() for outcome in counts}


def test_configuration_on_the_page_is_a_configuration(tmp_path: Path) -> None:
    (text,) = re.findall(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    file = tmp_path / "league.toml"
    file.write_text(text)
    config = Config.read(file)
    assert set(config.drivers) == {"reference", "mine", "other", "SUMO"}
    assert {name for name in Config.__struct_fields__ if name not in text} == set(), "the page names every field"


def test_quoted_lines_stand_in_the_files_of_carla() -> None:
    folder = os.environ.get("RVADS_CARLA") or pytest.skip("RVADS_CARLA names no folder of CARLA")
    quotes = QUOTE.findall(PAGE)
    assert len(quotes) == 4
    for file, line, text in quotes:
        lines = Path(folder, "agents", file).read_text(encoding="utf-8").splitlines()
        assert lines[int(line) - 1].strip() == text.strip()

"""The recipes of CONTRIBUTING.md: nine, each of one to five steps that begin with a file that is there, each with its test."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
(SECTION,) = re.findall(r"^## Recipes\n(.*?)(?=^## )", (ROOT / "CONTRIBUTING.md").read_text("utf-8"), re.MULTILINE | re.DOTALL)
RECIPES = dict(re.findall(r"^### Add ([^\n]*)\n(.*?)(?=^### |\Z)", SECTION, re.MULTILINE | re.DOTALL))
TRIED = {
    "a rule": "tests/recipes/test_add_a_rule.py",
    "a word": "tests/recipes/test_add_a_word.py",
    "a simulator": "tests/recipes/test_add_a_simulator.py",
    "a report format": "tests/recipes/test_add_a_report_format.py",
    "a kind of agent": "tests/recipes/test_add_a_kind_of_agent.py",
    "a way": "tests/recipes/test_add_a_way.py",
    "a map format": "tests/maps/test_maps_formats.py",
    "a log format": "tests/recipes/test_add_a_log_format.py",
    "a driver or traffic policy": "tests/recipes/test_add_a_driver.py",
}
EDITED = {
    "a rule": ["pytest_rvads/logic/rules/rulebooks.py", "tests/logic/test_road_rules.py", "docs/rules.md"],
    "a word": [
        "pytest_rvads/logic/conduct/",
        "tests/conduct/test_blocks.py",
        "pytest_rvads/logic/rules/lexicon.py",
        "docs/rules.md",
    ],
    "a simulator": [
        "pytest_rvads/satellites/NAME/",
        "pyproject.toml",
        "tests/simulators/test_conformance.py",
    ],
    "a report format": ["pytest_rvads/report/NAME.py", "pytest_rvads/report/files.py"],
    "a kind of agent": [
        "pytest_rvads/runs/states.py",
        "clients/c/rvads.h",
        "docs/attach-your-stack.md",
        "pytest_rvads/satellites/openscenario/writing.py",
        "pytest_rvads/report/draw/scene.py",
    ],
    "a way": [
        "pytest_rvads/geometry/NAME.py",
        "pytest_rvads/geometry/road_map.py",
        "pytest_rvads/runs/junctionfile.py",
        "pytest_rvads/logic/rules/lexicon.py",
        "pytest_rvads/report/draw/scene.py",
    ],
    "a map format": ["pytest_rvads/satellites/NAME/", "pyproject.toml", "docs/maps.md"],
    "a log format": [
        "pytest_rvads/satellites/NAME/",
        "pyproject.toml",
        "docs/bring-recorded-runs.md",
    ],
    "a driver or traffic policy": [
        "pytest_rvads/drivers/NAME.py",
        "pytest_rvads/drivers/traffic.py",
        "docs/attach-your-stack.md",
    ],
}
"""What each recipe touches, in order; NAME is for its reader to choose."""


def test_there_is_a_recipe_for_all_that_is_added_most() -> None:
    assert list(RECIPES) == list(TRIED) == list(EDITED)


@pytest.mark.parametrize("what", EDITED)
def test_its_steps_begin_with_the_files_to_touch(what: str) -> None:
    steps = re.findall(r"^(\d)\. (?:A module of )?`([^`]+)`", RECIPES[what], re.MULTILINE)
    assert [int(number) for number, _ in steps] == list(range(1, len(EDITED[what]) + 1))
    assert [file for _, file in steps] == EDITED[what]
    assert len(re.findall(r"^\d", RECIPES[what], re.MULTILINE)) == len(steps) <= 5


@pytest.mark.parametrize("what", TRIED)
def test_it_is_tried_by_a_test(what: str) -> None:
    (tried,) = re.findall(r"Tried\s+by\s+`([^`]+)`", RECIPES[what])
    assert tried == TRIED[what]
    assert "def test_" in (ROOT / tried).read_text("utf-8")


def test_every_path_it_names_is_there() -> None:
    named = [path for path in re.findall(r"`([\w.-]+(?:/[\w.-]*)+|[\w-]+\.toml|[A-Z]+\.md)`", SECTION) if "NAME" not in path]
    assert len(set(named)) > 20
    assert [path for path in named if not (ROOT / path).exists()] == []


@pytest.mark.parametrize(
    ("place", "names"),
    [
        ("simulators/loop.py", ["Loop"]),
        ("conformance/checks.py", ["CHECKS"]),
        ("report/files.py", ["FORMATS"]),
        ("report/outline.py", ["outline", "plain"]),
        ("satellites/tracks/logformats.py", ["Format", "Reader"]),
        ("satellites/tracks/samples.py", ["Gather", "Log"]),
        ("satellites/tracks/source.py", ["opened"]),
        ("runs/states.py", ["Kind"]),
        ("geometry/conflicts.py", ["Way"]),
        ("geometry/junction.py", ["Further", "Junction"]),
        ("drivers/traffic.py", ["POLICIES"]),
        ("drivers/reference.py", ["make_gate"]),
        ("drivers/follower.py", ["target_speed"]),
        ("support/decoding.py", ["decode"]),
        ("logic/rules/vocabulary.py", ["Word", "Attribute"]),
    ],
)
def test_every_name_it_speaks_of_is_defined(place: str, names: list[str]) -> None:
    source = (ROOT / "pytest_rvads" / place).read_text("utf-8")
    for name in names:
        assert re.search(rf"\b{name}\b", SECTION), name
        assert re.search(rf"^ *(def |class )?{name}\b", source, re.MULTILINE), name

"""The recipes of CONTRIBUTING.md, followed in a copy of the project: what tables lack there tells the files of every recipe."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from .changes import CHANGES, ROOT, copied, edit, install

(SECTION,) = re.findall(r"^## Recipes\n(.*?)(?=^## )", (ROOT / "CONTRIBUTING.md").read_text("utf-8"), re.MULTILINE | re.DOTALL)
RECIPES = dict(re.findall(r"^### Add ([^\n]*)\n(.*?)(?=^### |\Z)", SECTION, re.MULTILINE | re.DOTALL))
EXAMINE = """
import json
from pathlib import Path
from tests.recipes.changes import CHANGES
from tests.recipes.tables import lacks

for change in CHANGES.values():
    exec(change.works, {})
print(json.dumps(list(lacks(Path()))))
"""
"""Fails unless every change works, and prints what tables lack."""
OF_ALL = (
    "tests/conduct/test_blocks.py",
    "tests/report/test_outline.py",
    "tests/drivers/stacks/test_docs.py",
    "tests/satellites/openscenario/test_runs_exported.py::test_kind_and_size_survive_export",
    "tests/logic/test_rules.py",
    "tests/test_layers.py",
)
"""Tests of all words, formats, policies, kinds and modules that there are."""
NAMED = re.compile(r"(test_)?[a-z_]+\.py$")
"""The part of a path for which a recipe says NAME."""


def python(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python on the package of a copy."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    return subprocess.run([sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False)


def examined(folder: Path) -> list[tuple[str, str]]:
    """Return each file of a copy that lacks a name, with the name, provided that every change works."""
    done = python(folder, "-c", EXAMINE)
    assert done.returncode == 0, done.stderr
    return [(file, name) for file, name in json.loads(done.stdout)]


@pytest.fixture(scope="module")
def lacking(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Return which files lack which names in a copy with the code of all changes, before and after the tables are completed."""
    folder = tmp_path_factory.mktemp("copy")
    copied(folder)
    for change in CHANGES.values():
        edit(folder, change.code)
    install(folder)
    before = examined(folder)
    for change in CHANGES.values():
        edit(folder, change.tables)
    return before, examined(folder)


def test_there_is_a_change_for_every_recipe() -> None:
    """A way that is read from maps is no small change; its recipe is tried from outside."""
    assert RECIPES.keys() == {*CHANGES, "a way"}


@pytest.mark.parametrize("what", CHANGES)
def test_steps_name_the_code_and_the_tables_that_lack_it(what: str, lacking: tuple[list[tuple[str, str]], ...]) -> None:
    change = CHANGES[what]
    files = [*change.code, *(file for file, name in lacking[0] if name == change.name)]
    new = {file for file, edits in {**change.code, **change.tables}.items() if isinstance(edits, str)}
    steps = re.findall(r"^(\d)\. `([^`]+)`", RECIPES[what], re.MULTILINE)
    assert [int(number) for number, _ in steps] == list(range(1, len(steps) + 1))
    assert {file for _, file in steps} == {NAMED.sub(r"\1NAME.py", file) if file in new else file for file in files}
    assert len(steps) <= 4


def test_tables_lack_what_is_added_and_nothing_where_all_steps_are_followed(lacking: tuple[list[tuple[str, str]], ...]) -> None:
    before, after = lacking
    assert {name for _, name in before} == {change.name for change in CHANGES.values()}
    assert after == []


@pytest.mark.extended
@pytest.mark.parametrize(("what", "file"), [(what, file) for what, change in CHANGES.items() for file in change.code])
def test_nothing_works_without_a_file_of_its_code(what: str, file: str, tmp_path: Path) -> None:
    copied(tmp_path)
    edit(tmp_path, {name: edits for name, edits in CHANGES[what].code.items() if name != file})
    install(tmp_path)
    assert python(tmp_path, "-c", CHANGES[what].works).returncode == 1


@pytest.mark.extended
def test_tests_pass_where_all_steps_are_followed(tmp_path: Path) -> None:
    copied(tmp_path)
    for change in CHANGES.values():
        edit(tmp_path, change.code)
        edit(tmp_path, change.tables)
    install(tmp_path)
    own = {file for change in CHANGES.values() for file in change.tables if file.startswith("tests/")}
    done = python(tmp_path, "-m", "pytest", "-p", "no:cacheprovider", *sorted(own), *OF_ALL)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("what", RECIPES)
def test_it_is_tried_by_a_test(what: str) -> None:
    (tried,) = re.findall(r"Tried\s+by\s+`([^`]+)`", RECIPES[what])
    assert "def test_" in (ROOT / tried).read_text("utf-8")


def test_every_path_it_names_is_there() -> None:
    named = [path for path in re.findall(r"`([\w.-]+(?:/[\w.-]*)+|[\w-]+\.toml|[A-Z]+\.md)`", SECTION) if "NAME" not in path]
    assert len(set(named)) > 20
    assert [path for path in named if not (ROOT / path).exists()] == []


@pytest.mark.parametrize(
    ("place", "names"),
    [
        ("simulators/loop.py", ["Loop"]),
        ("satellites/conformance/test_conformance.py", ["CHECKS"]),
        ("report/files.py", ["FORMATS", "markdown"]),
        ("report/outline.py", ["outline", "plain"]),
        ("satellites/tracks/logformats.py", ["Format", "Reader"]),
        ("satellites/tracks/samples.py", ["Gather", "Log"]),
        ("satellites/tracks/source.py", ["opened"]),
        ("runs/states.py", ["Kind"]),
        ("geometry/ways.py", ["Way", "Further"]),
        ("geometry/junction.py", ["Junction"]),
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

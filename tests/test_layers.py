"""The layers of ARCHITECTURE.md, held by import-linter, and the modules that alone may import a library."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import pytest_rvads

ROOT = Path(__file__).parents[1]
PACKAGE = Path(pytest_rvads.__file__).parent


def test_data_flows_one_way() -> None:
    done = subprocess.run(
        [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("library", "homes"),
    [
        ("pybullet", {"physics/world.py"}),
        ("rich", {"report/terminal.py"}),
        ("hypothesis", {"search/strategies.py", "search/falsify.py", "studies/methods.py"}),
        ("platformdirs", {"physics/cache.py"}),
        ("pytest", {"plugin.py", "hooks.py", "options.py", "collection", "fixtures", "session"}),
    ],
)
def test_a_library_has_its_home(library: str, homes: set[str]) -> None:
    found = set()
    for file in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            if any(name.split(".")[0] == library for name in names):
                place = file.relative_to(PACKAGE)
                found.add(place.parts[0] if place.parts[0] in homes else place.as_posix())
    assert found <= homes
    assert found


def test_nothing_private_of_pytest_is_imported() -> None:
    for file in PACKAGE.rglob("*.py"):
        assert "_pytest" not in file.read_text(encoding="utf-8"), file

"""The layers of ARCHITECTURE.md, held by import-linter, and the modules that alone may import a library."""

import ast
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import networkx as nx
import pytest

import pytest_rvads

ROOT = Path(__file__).parents[1]
PACKAGE = Path(pytest_rvads.__file__).parent
PUBLIC_MODULES = ("errors", "files", "values")


@cache
def statements(file: Path) -> tuple[ast.Import | ast.ImportFrom, ...]:
    """All imports of a module, also in functions and for type checkers only."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return tuple(node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom))


@pytest.mark.extended
def test_data_flows_one_way() -> None:
    pytest.importorskip("importlinter")
    done = subprocess.run(
        [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.extended
@pytest.mark.parametrize(
    ("library", "homes"),
    [
        ("pybullet", {"physics/engines.py"}),
        ("mujoco", {"physics/engines.py"}),
        ("libsumo", {"satellites/sumo/libsumo_server.py"}),
        ("rich", {"report/terminal.py"}),
        ("hypothesis", {"search/strategies.py", "search/falsify.py"}),
        ("platformdirs", {"physics/braking.py"}),
        ("psutil", {"drivers/stacks/descendants.py"}),
        ("jinja2", {"satellites/pages/page.py"}),
        ("pytest", {"plugin.py", "satellites", "fixtures", "session", "clients"}),
    ],
)
def test_a_library_has_its_home(library: str, homes: set[str]) -> None:
    found = set()
    for file in sorted(PACKAGE.rglob("*.py")):
        for node in statements(file):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            if any(name.split(".")[0] == library for name in names):
                place = file.relative_to(PACKAGE)
                found.add(place.parts[0] if place.parts[0] in homes else place.as_posix())
    assert found <= homes
    assert found


def test_nothing_private_of_pytest_is_imported() -> None:
    for file in PACKAGE.rglob("*.py"):
        assert "_pytest" not in file.read_text(encoding="utf-8"), file


def imports() -> nx.DiGraph:
    """The modules of the package and what each imports, anywhere in its text: also in functions and for type checkers only."""
    modules = {}
    for file in PACKAGE.rglob("*.py"):
        name = ".".join((PACKAGE.name, *file.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__")
        modules[name] = file
    graph = nx.DiGraph()
    graph.add_nodes_from(modules)
    for name, file in modules.items():
        for node in statements(file):
            if isinstance(node, ast.ImportFrom):
                said = [f"{node.module}.{alias.name}" for alias in node.names]
                graph.add_edges_from((name, s if s in modules else node.module) for s in said if {s, node.module} & set(modules))
            else:
                graph.add_edges_from((name, alias.name) for alias in node.names if alias.name in modules)
    return graph


def test_core_names_no_satellite() -> None:
    """The stub and the public modules apart, which hold names of both."""
    public = [PACKAGE / f"{name}.py" for name in PUBLIC_MODULES]
    core = [file for file in PACKAGE.rglob("*.py") if PACKAGE / "satellites" not in file.parents and file not in public]
    assert [file for file in core if "satellites" in file.read_text(encoding="utf-8")] == []


def test_no_modules_import_each_other_not_even_late() -> None:
    assert [circle for circle in nx.strongly_connected_components(imports()) if len(circle) > 1] == []


def test_no_two_modules_have_one_name() -> None:
    rooms = {file.parent.name for file in PACKAGE.rglob("__init__.py")}
    files = [file for file in PACKAGE.rglob("*.py") if file.parent != PACKAGE or file.stem not in PUBLIC_MODULES]
    names = Counter(file.stem for file in files if file.stem != "__init__")
    assert [name for name, count in names.items() if count > 1 or name in rooms] == []


def test_public_modules_only_hold_names_of_the_rooms() -> None:
    """Such a module may have the name of a module of a room, as `errors` has, because a contributor edits nothing in it."""
    nodes = ast.parse((PACKAGE / "errors.py").read_text(encoding="utf-8")).body
    assert [type(node) for node in nodes if not isinstance(node, ast.ImportFrom)] == [ast.Expr, ast.Assign]
    (listed,) = (ast.literal_eval(node.value) for node in nodes if isinstance(node, ast.Assign))
    assert listed == sorted(alias.name for node in nodes if isinstance(node, ast.ImportFrom) for alias in node.names)
    for name in ("files", "values"):
        names = ast.parse((PACKAGE / f"{name}.pyi").read_text(encoding="utf-8")).body
        assert [type(node) for node in names if not isinstance(node, ast.ImportFrom)] == [ast.AnnAssign], name
        nodes = ast.parse((PACKAGE / f"{name}.py").read_text(encoding="utf-8")).body
        assert [type(node) for node in nodes] == [ast.Expr, ast.ImportFrom, ast.Assign], name

"""The tables that are written by hand beside the code: names of what is shipped, and the files that have to hold these names."""

import re
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

from pytest_rvads.drivers.traffic import policies
from pytest_rvads.logic.rules.lexicon import BUILT_IN
from pytest_rvads.logic.rules.rulebooks import PAPER, ROAD, VARIANTS
from pytest_rvads.report.files import FORMATS
from pytest_rvads.runs.states import Kind


def lacks(root: Path) -> Iterator[tuple[str, str]]:
    """Yield each name that a file has to hold and does not hold, after the file.

    Args:
        root: folder of the checkout.
    """
    declared = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    simulators, maps, logs = (declared.get(f"rvads.{group}", {}) for group in ("simulators", "maps", "logs"))
    rules = [rule.name for rule in (*PAPER, *VARIANTS, *ROAD)]
    tables: list[tuple[str, str, Iterable[str]]] = [
        ("docs/rules.md", r"^\| `(paper|variants|road)` \|.*\b{}\b", rules),
        ("docs/rules.md", r"`{0}\(| {0} ", BUILT_IN.keys() - {"@"}),
        ("tests/simulators/test_conformance.py", '^SHIPPED = .*"{}": ', simulators),
        ("docs/simulators.md", r"^\| `{}` \|", simulators),
        ("docs/sessions.md", "format: .*`{}`", FORMATS),
        ("clients/c/rvads.h", r"(?i)^enum \{{.*\brvads_{}\b.*/\* kind \*/", Kind),
        ("docs/attach-your-stack.md", r"`kind` \([^)]*\b{}\b", Kind),
        ("docs/attach-your-stack.md", r'^\| `"{}"` \|', policies()),
        ("tests/honesty/catalogue.py", '"reference_among_{}"', set(policies()) - {"sumo"}),
        ("docs/maps.md", r"`\.{}`", maps),
        ("docs/bring-recorded-runs.md", r"^\|.*\| `{}`", logs),
    ]
    for file, pattern, names in tables:
        content = (root / file).read_text(encoding="utf-8")
        yield from ((file, name) for name in names if not re.search(pattern.format(re.escape(name)), content, re.MULTILINE))
    tests = "\n".join(file.read_text(encoding="utf-8") for file in (root / "tests" / "logic").glob("*.py"))
    yield from (("tests/logic/test_road_rules.py", rule) for rule in rules if f'"{rule}"' not in tests)
    tested = {file.name.removesuffix(".py").removeprefix("test_") for file in (root / "tests" / "satellites").iterdir()}
    modules = {name: value.split(":")[0].split(".")[2] for name, value in (*maps.items(), *logs.items())}
    yield from ((f"tests/satellites/test_{module}.py", name) for name, module in modules.items() if module not in tested)

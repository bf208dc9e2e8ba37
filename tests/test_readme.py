"""README and guides tell the truth: their Python runs, their commands print what they say, their links lead somewhere."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.simulators.loop import usual

ROOT = Path(__file__).parents[1]
GUIDES = (
    "tutorial",
    "write-a-test",
    "bring-an-autopilot",
    "foreign-drivers",
    "pedestrians",
    "bring-recorded-runs",
    "read-a-failure",
    "rules",
    "concepts/subject",
)
PAGES = {page: (ROOT / page).read_text(encoding="utf-8") for page in ("README.md", *(f"docs/{guide}.md" for guide in GUIDES))}
ALL = sorted(p.relative_to(ROOT).as_posix() for p in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")))
FAILURES = [page for page, text in PAGES.items() if "\nrerun     pytest" in text]
TEXT = "\n".join(PAGES.values())
PYTHON = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
SCRIPTS = [code for code in PYTHON if "def test_" not in code]
CONSOLE = re.findall(r"^\$ (rvads .*)\n((?:(?!\$ |```).*\n)*)", TEXT, re.MULTILINE)
FEW = "not class or class00 or class01 or class07 or class13 or class19"
"""Of the items of an example, as `-k` takes it: all of a test without classes, else the classes that the pages talk of."""


@pytest.mark.extended
@pytest.mark.parametrize("code", [pytest.param(c, id=f"block{n}") for n, c in enumerate(PYTHON) if "def test_" in c])
def test_examples_of_tests_pass_or_fail_as_said(pytester: pytest.Pytester, code: str) -> None:
    pytester.makepyfile(code)
    if "@rvads.recorded" in code:
        shutil.copytree(ROOT / "examples" / "drives", pytester.path / "drives", ignore=shutil.ignore_patterns("rolls.*"))
    own = "def rvads_autopilot" in code or "falsify" in code
    result = pytester.runpytest("-k", FEW, *([] if own else ["--rvads-autopilot=reference"]))
    outcomes = result.parseoutcomes()
    assert "errors" not in outcomes
    assert ("failed" in outcomes) == ("# fails" in code)
    assert result.ret == int("# fails" in code)
    assert outcomes.get("passed", 0) + outcomes.get("failed", 0) > 0


@pytest.mark.extended
@pytest.mark.parametrize("page", FAILURES)
def test_the_failure_shown_is_the_one_printed(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, page: str) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    code = next(c for c in re.findall(r"^```python\n(.*?)^```", PAGES[page], re.MULTILINE | re.DOTALL) if "# fails" in c)
    pytester.makepyfile(**{f"test_{Path(page).stem.lower().replace('-', '_')}": code})
    printed = [line.rstrip() for line in pytester.runpytest("--tb=short").outlines]
    (shown,) = [block for block in re.findall(r"^```text\n(.*?)^```", PAGES[page], re.MULTILINE | re.DOTALL) if "rerun" in block]
    # The page shows what pybullet prints. Where another engine is the usual one its name stands there, and all else is the same.
    for line in shown.replace(f"simulated by {rvads.bullet.name}", f"simulated by {usual().name}").splitlines():
        assert line in printed or line.startswith("---"), line
    if page == "README.md":
        assert main(shlex.split("replay full_stop -o failure.svg")) == 0
        drawn = (pytester.path / "failure.svg").read_bytes()
        assert (ROOT / "docs" / "failure.svg").read_bytes() == drawn, "run the README's failing test, draw it as it says"


def test_the_picture_is_drawn_by_the_command_that_the_readme_names() -> None:
    assert "`rvads replay full_stop -o failure.svg`" in PAGES["README.md"]
    assert len(PAGES["README.md"].splitlines()) <= 120


@pytest.mark.extended
@pytest.mark.parametrize("code", SCRIPTS, ids=[f"script{n}" for n in range(len(SCRIPTS))])
def test_scripts_run(tmp_path: Path, code: str) -> None:
    """A comment behind a line that prints says what it prints."""
    done = _run([sys.executable, "-c", code], tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == re.findall(r"^print\(.*\)  # (.*)$", code, re.MULTILINE)


@pytest.mark.extended
@pytest.mark.parametrize(("command", "said"), CONSOLE, ids=[command for command, _ in CONSOLE])
def test_commands_print_what_is_shown(tmp_path: Path, command: str, said: str) -> None:
    """A command about a file runs where the script or command of the page that makes it ran, others in the checkout."""
    program, *arguments = shlex.split(command)
    made = _make(arguments, command, tmp_path)
    done = _run([str(Path(sys.executable).with_name(program)), *arguments], tmp_path if made else ROOT)
    assert done.returncode in (0, 1), done.stderr
    shown = [line for line in said.splitlines() if line.strip()]
    got = [line.rstrip() for line in done.stdout.splitlines() if line.strip()]
    if "..." in shown:
        cut = shown.index("...")
        head, tail = shown[:cut], shown[cut + 1 :]
        assert got[: len(head)] == head
        assert got[len(got) - len(tail) :] == tail
    else:
        assert got == shown


def _make(words: list[str], command: str, folder: Path) -> bool:
    """Make the files that a command reads, as the pages say, or copy public files; return whether there are any."""
    public = [ROOT.parent / "shared" / "maps" / "commonroad" / word for word in words if word.endswith(".xml")]
    for file in public:
        if not file.is_file():
            pytest.skip(f"the public file ../shared/maps/commonroad/{file.name} is absent")
        shutil.copy(file, folder)
    files = [word for word in words if word.endswith((".csv", ".npz", ".json")) and f"-o {word}" not in command]
    scripts = [code for code in SCRIPTS if any(f'"{file}"' in code for file in files)]
    commands = [other for other, _ in CONSOLE if any(f"-o {file}" in other for file in files)]
    for code in scripts:
        assert _run([sys.executable, "-c", code], folder).returncode == 0
    for other in commands:
        program, *arguments = shlex.split(other)
        assert _make(arguments, other, folder)
        assert _run([str(Path(sys.executable).with_name(program)), *arguments], folder).returncode == 0
    return bool(scripts or commands or public)


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_options_exist(pytester: pytest.Pytester) -> None:
    offered = {"--rvads-help", *re.findall(r"--rvads-[a-z-]*[a-z]", pytester.runpytest("--rvads-help").stdout.str())}
    named = {
        (page, name) for page in ALL for name in re.findall(r"--rvads-[a-z-]*[a-z]", (ROOT / page).read_text(encoding="utf-8"))
    }
    assert [(page, name) for page, name in sorted(named) if name not in offered] == []


@pytest.mark.parametrize("page", ALL)
def test_links_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```|`[^`\n]*`", "", text, flags=re.MULTILINE | re.DOTALL)
    links = [link for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", prose) if "://" not in link]
    missing = [link for link in links if not (ROOT / page).parent.joinpath(link).exists()]
    assert not missing


def test_the_table_of_rooms_is_the_contract() -> None:
    """A row per layer, in order; what is in one layer stands in one row."""
    page = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").partition("## Rooms")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| ((?:`[\w.]+/?`(?:, )?)+) \|.*\|.*\|$", page.partition("Within `logic/`")[0], re.MULTILINE)
    rooms = [re.findall(r"`(\w+)(?:\.py|/)`", row) for row in rows]
    contract, within, *_ = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    assert rooms == [layer.split(" | ") for layer in contract["layers"]]
    told = page.partition("Within `logic/`")[2].partition("\n\n")[0]
    layers = [name for layer in within["layers"] for name in sorted(layer.split(" | "))]
    assert [name for name in re.findall(r"`(\w+)/?`", told) if name in layers][: len(layers)] == layers


def test_the_page_on_the_architecture_and_its_route_stay_short() -> None:
    """In the route, a name without a folder lies in the folder of the name before."""
    page = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    route, vocabulary = (page.partition(f"\n## {title}\n")[2].partition("\n## ")[0] for title in ("A route", "Vocabulary"))
    modules, folder = [], ""
    for name in re.findall(r"`([\w/]+)`", " ".join(re.findall(r"^\d+\. ([^:]*):", route, re.MULTILINE))):
        room, _, module = name.rpartition("/")
        folder = room or folder
        modules.append(ROOT / "pytest_rvads" / folder / f"{module}.py")
    assert f"These {len(set(modules))} modules" in route
    assert len(modules) <= 40
    assert sum(len(module.read_text(encoding="utf-8").splitlines()) for module in modules) <= 10_000
    assert len(page.splitlines()) <= 140
    _header, *rows = re.findall(r"^\| ", vocabulary, re.MULTILINE)
    assert len(rows) <= 26

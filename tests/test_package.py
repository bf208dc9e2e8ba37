"""What is published tells the truth: metadata, the README as PyPI shows it, pages that messages name."""

import ast
import re
import subprocess
import tomllib
from collections.abc import Iterator
from importlib.metadata import metadata
from pathlib import Path

import pytest

import pytest_rvads
from pytest_rvads.cli import main
from pytest_rvads.support.wording import page

ROOT = Path(__file__).parents[1]
PACKAGE = Path(pytest_rvads.__file__).parent
CONFIGURATION = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
REPOSITORY = "https://github.com/pytest-rvads/pytest-rvads"


def on_pypi() -> str:
    """The README as hatch-fancy-pypi-readme makes it."""
    text = (ROOT / "README.md").read_text("utf-8")
    for one in CONFIGURATION["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]["substitutions"]:
        text = re.sub(one["pattern"], one["replacement"], text)
    return text


def test_every_link_on_pypi_leads_to_a_file_that_exists() -> None:
    """PyPI has no other files and gives headings no names; GitHub shows the former at blob, pictures at raw."""
    prose = re.sub(r"^```.*?^```", "", on_pypi(), flags=re.MULTILINE | re.DOTALL)
    links = re.findall(r"\]\(([^)\s]+)", prose) + re.findall(r'(?:href|src)="([^"]+)"', prose)
    assert links
    homes = (f"{REPOSITORY}/blob/main/", "https://raw.githubusercontent.com/pytest-rvads/pytest-rvads/main/")
    for link in links:
        assert re.match(r"https?://|data:", link), link
        for home in homes:
            if link.startswith(home):
                assert (ROOT / link.removeprefix(home).partition("#")[0]).is_file(), link
    shown = re.findall(r"!\[[^\]]*\]\(([^)\s]+)", prose) + re.findall(r'src="([^"]+)"', prose)
    assert not [link for link in shown if "/blob/" in link]


def test_substitutions_leave_whole_addresses_and_code_alone() -> None:
    text = '[a](https://x.org) [b](docs/b.md#c) ![d](docs/d.svg) [e](#f) <img width=3 src="g.gif"> `test_x[stop4-p1]` (h)'
    raw, blob = "https://raw.githubusercontent.com/pytest-rvads/pytest-rvads/main", f"{REPOSITORY}/blob/main"
    for one in CONFIGURATION["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]["substitutions"]:
        text = re.sub(one["pattern"], one["replacement"], text)
    assert text == (
        f"[a](https://x.org) [b]({blob}/docs/b.md#c) ![d]({raw}/docs/d.svg) [e]({blob}/README.md#f) "
        f'<img width=3 src="{raw}/g.gif"> `test_x[stop4-p1]` (h)'
    )


def test_metadata_names_where_to_go() -> None:
    urls = CONFIGURATION["project"]["urls"]
    assert set(urls) == {"Homepage", "Documentation", "Source", "Issues", "Changelog"}
    assert f"site_url: {urls['Documentation']}\n" in (ROOT / "mkdocs.yml").read_text("utf-8")
    assert (ROOT / urls["Changelog"].removeprefix(f"{REPOSITORY}/blob/main/")).is_file()
    supported = [name.rpartition(" ")[2] for name in CONFIGURATION["project"]["classifiers"] if ":: 3." in name]
    assert CONFIGURATION["project"]["requires-python"] == f">={supported[0]}"


def test_the_readme_is_in_the_metadata() -> None:
    """Of what is installed; an editable install keeps the README of when it was made, so only its kind is looked at."""
    found = metadata("pytest-rvads")
    assert found["Description-Content-Type"] == "text/markdown"
    assert "# pytest-rvads" in found.json["description"]


def test_the_sdist_holds_all_that_git_does() -> None:
    """No list of what goes in can grow old: a source archive without docs was made by one."""
    assert set(CONFIGURATION["tool"]["hatch"]["build"]["targets"]["sdist"]) <= {"exclude"}
    if (ROOT / ".git").exists():
        ignored = subprocess.run(
            ["git", "ls-files", "--cached", "--ignored", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
        assert not ignored.stdout


def spoken(tree: ast.Module) -> Iterator[str]:
    """The strings of a module that may reach somebody at run time: all but docstrings."""
    silent = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in silent:
            yield node.value


def test_named_pages_exist() -> None:
    """Who has installed the package alone has no folder `docs`."""
    titles = [path.read_text("utf-8").partition("\n")[0].removeprefix("# ") for path in (ROOT / "docs").glob("*.md")]
    named = set()
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text("utf-8")
        if not re.search(r"docs/|\.md\b|README|\bpage\(|in the documentation", text):
            continue
        named |= set(re.findall(r"docs/([\w-]+)\.md", text)) | set(re.findall(r"\bpage\([\"']([\w-]+)[\"']\)", text))
        for said in spoken(ast.parse(text)) if path.stem != "first_commands" else ():
            assert not re.search(r"docs/|\b(README|ARCHITECTURE|CONTRIBUTING|CHANGELOG|SECURITY)\b", said), (path, said)
            assert all(title in titles for title in re.findall(r"'([^']+)' in the documentation", said)), (path, said)
    assert {"attach-your-stack", "ci", "replication", "tutorial"} <= named
    assert sorted(name for name in named if not (ROOT / "docs" / f"{name}.md").is_file()) == []


def test_no_address_of_the_site_is_printed_before_it_is_published() -> None:
    for path in sorted(PACKAGE.rglob("*.py")):
        assert "github.io" not in path.read_text("utf-8"), path


def test_help_says_where_the_documentation_is(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    assert f"documentation: {page()}" in pytester.runpytest("--help").stdout.str()
    with pytest.raises(SystemExit):
        main(["--help"])
    assert f"documentation: {page()}" in capsys.readouterr().out


def test_the_pages_ship_with_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    assert CONFIGURATION["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]["docs"] == "pytest_rvads/docs"
    assert main(["docs"]) == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()[:-1]]
    assert sorted(listed) == sorted(
        p.relative_to(ROOT / "docs").with_suffix("").as_posix() for p in (ROOT / "docs").rglob("*.md")
    )
    assert listed[0] == "README"
    assert main(["docs", "concepts/zones.md"]) == 0
    assert capsys.readouterr().out.startswith("# Zones\n")
    assert main(["docs", "../README"]) == 2
    assert "'../README': rvads docs lists all pages" in capsys.readouterr().err
    assert main(["docs", "/etc/\x1b[2J\u202e"]) == 2
    told = capsys.readouterr().err
    assert told.removesuffix("\n").isprintable(), "neither the terminal nor the direction of writing changes"


def test_help_of_pytest_is_short_and_explains_every_option_elsewhere(pytester: pytest.Pytester) -> None:
    shown = pytester.runpytest("--help").stdout.str()
    begin = shown.index("traffic-rule validation")
    everyday = shown[begin : shown.index("\n\n", begin)]
    assert len(everyday.splitlines()) <= 20
    result = pytester.runpytest("--rvads-help")
    assert result.ret == 0
    every = set(re.findall(r"^  (--rvads-[a-z-]+)", result.stdout.str(), re.MULTILINE))
    assert set(re.findall(r"^  (--rvads-[a-z-]+)", everyday, re.MULTILINE)) - {"--rvads-help"} < every
    page = (ROOT / "docs" / "everything-else.md").read_text("utf-8")
    told = {
        f"--rvads-{name}" for name in re.findall(r"`([a-z-]+)`", page.partition("## Further options")[2].partition("## In")[0])
    }
    assert every - set(re.findall(r"^  (--rvads-[a-z-]+)", everyday, re.MULTILINE)) == told - {"--rvads-simulator"}
    ini = {f"--{name.replace('_', '-')}" for name in re.findall(r"^  (rvads_\w+)", shown, re.MULTILINE)}
    assert ini == every
    assert f"show all {len(every)} options of this plugin" in " ".join(everyday.split())
    assert len(every) <= 24


def test_help_of_the_tool_explains_at_most_twelve_commands_and_names_all(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    shown = capsys.readouterr().out
    explained = re.findall(r"^  ([a-z][\w-]*) ", shown, re.MULTILINE)
    assert len(explained) <= 12
    assert all(f"\n{group}:\n" in shown for group in ("start", "judge", "measure"))
    with pytest.raises(SystemExit):
        main(["no-such-command"])
    offered = set(re.findall(r"[a-z][\w-]+", capsys.readouterr().err.partition("choose from")[2]))
    further = set(re.findall(r"[\w-]+", shown.partition("further commands: ")[2].partition("(")[0]))
    assert {*explained} | further == offered
    page = (ROOT / "docs" / "everything-else.md").read_text("utf-8")
    assert set(re.findall(r"^\| `rvads ([\w-]+)`", page, re.MULTILINE)) == further

"""README and guides tell the truth: their Python runs, their commands print what they say, their links lead somewhere."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GUIDES = ("tutorial", "write-a-test", "bring-an-autopilot", "bring-recorded-runs", "read-a-failure")
PAGES = {page: (ROOT / page).read_text(encoding="utf-8") for page in ("README.md", *(f"docs/{guide}.md" for guide in GUIDES))}
FAILURES = [page for page, text in PAGES.items() if "\nrerun     pytest" in text]
TEXT = "\n".join(PAGES.values())
PYTHON = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
CONSOLE = re.findall(r"^\$ (rvads .*)\n((?:(?!\$ |```).*\n)*)", TEXT, re.MULTILINE)


@pytest.mark.parametrize("code", [pytest.param(c, id=f"block{n}") for n, c in enumerate(PYTHON) if "def test_" in c])
def test_examples_of_tests_pass_or_fail_as_said(pytester: pytest.Pytester, code: str) -> None:
    pytester.makepyfile(code)
    result = pytester.runpytest()
    outcomes = result.parseoutcomes()
    assert "errors" not in outcomes
    assert ("failed" in outcomes) == ("# fails" in code)
    assert outcomes.get("passed", 0) + outcomes.get("failed", 0) > 0


@pytest.mark.parametrize("page", FAILURES)
def test_the_failure_shown_is_the_one_printed(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, page: str) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    code = next(c for c in re.findall(r"^```python\n(.*?)^```", PAGES[page], re.MULTILINE | re.DOTALL) if "# fails" in c)
    pytester.makepyfile(**{f"test_{Path(page).stem.lower().replace('-', '_')}": code})
    printed = [line.rstrip() for line in pytester.runpytest("--tb=short").outlines]
    (shown,) = [block for block in re.findall(r"^```text\n(.*?)^```", PAGES[page], re.MULTILINE | re.DOTALL) if "rerun" in block]
    for line in shown.splitlines():
        assert line in printed or line.startswith("---"), line


@pytest.mark.parametrize("code", [pytest.param(c, id=f"block{n}") for n, c in enumerate(PYTHON) if "def test_" not in c])
def test_scripts_run(tmp_path: Path, code: str) -> None:
    """A comment behind a line that prints says what it prints."""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == re.findall(r"^print\(.*\)  # (.*)$", code, re.MULTILINE)


@pytest.mark.parametrize(("command", "said"), CONSOLE, ids=[command for command, _ in CONSOLE])
def test_commands_print_what_is_shown(command: str, said: str) -> None:
    program = Path(sys.executable).with_name("rvads")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [str(program), *shlex.split(command)[1:]], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    shown = [line for line in said.splitlines() if line.strip()]
    got = [line.rstrip() for line in done.stdout.splitlines() if line.strip()]
    if "..." in shown:
        cut = shown.index("...")
        head, tail = shown[:cut], shown[cut + 1 :]
        assert got[: len(head)] == head
        assert got[len(got) - len(tail) :] == tail
    else:
        assert got == shown


@pytest.mark.parametrize("page", sorted(p.relative_to(ROOT).as_posix() for p in (*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"))))
def test_links_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```|`[^`\n]*`", "", text, flags=re.MULTILINE | re.DOTALL)
    links = [link for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", prose) if "://" not in link]
    missing = [link for link in links if not (ROOT / page).parent.joinpath(link).exists()]
    assert not missing

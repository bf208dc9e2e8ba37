"""The Python code of docs/rules.md and docs/judge-live.md runs."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs" / "rules.md"


def test_the_code_in_the_documentation_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # one block keeps a run
    blocks = re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 5
    for block in blocks:
        exec(compile(block, str(DOCS), "exec"), {})


def test_the_code_of_the_page_on_live_monitors_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = re.findall(r"```python\n(.*?)```", DOCS.with_name("judge-live.md").read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(block, "judge-live.md", "exec"), {})
    assert capsys.readouterr().out == "full_stop {'a': 'v17', 'j.en': 'entrance 0'} F 0.02\n"


def test_the_rulebooks_of_the_documentation_are_the_shipped_ones() -> None:
    from pytest_rvads.logic.rules.book import rulebook

    text = DOCS.read_text(encoding="utf-8")
    for name in ("paper", "variants", "road"):
        row = next(line for line in text.splitlines() if line.startswith(f"| `{name}` |"))
        for rule in rulebook(name):
            assert re.search(rf"\b{rule.name}\b", row), rule.name


def test_the_file_of_rules_in_the_documentation_loads(tmp_path: Path) -> None:
    from pytest_rvads.logic.rules.book import load_rules

    (block,) = re.findall(r"```ini\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "own.rules").write_text(block)
    assert [r.requirement for r in load_rules(tmp_path / "own.rules")] == ["REQ-7"]

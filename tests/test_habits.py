"""What a commit is checked by is what CI checks it by."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
TOOLS = ("ruff", "mypy", "lint-imports")


def test_the_hooks_of_a_commit_run_what_ci_runs() -> None:
    hooks = re.findall(r"^ +entry: (.*)$", (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"), re.MULTILINE)
    lines = re.findall(r'^ *"\$work/dev/bin/([\w-]+)"(.*)$', (ROOT / ".ci" / "run").read_text(encoding="utf-8"), re.MULTILINE)
    assert hooks == [f"{tool}{arguments}" for tool, arguments in lines if tool in TOOLS]
    assert {hook.split()[0] for hook in hooks} == set(TOOLS)

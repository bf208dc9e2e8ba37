"""What docs/ci.md prints for GitHub, and the action of this repository, run as they stand."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.cli import main
from pytest_rvads.cli.first_commands import WORKFLOW, template

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "ci.md").read_text("utf-8")
PRINTED = re.findall(r"^```yaml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
EXPRESSION = re.compile(r"\$\{\{ *(.*?) *\}\}")
VALUES = {
    "github.event_name == 'push' && 'scenario' || 'class'": "class",
    "github.sha": "94d5f58",
    "matrix.part": "stop4",
    "strategy.job-index": "0",
}
"""What GitHub puts in place of the expressions in workflows."""


def yaml(text: str) -> dict[str, Any]:
    """The value of a text in YAML, but for its `on`, which is read as true."""
    found: dict[str, Any] = pytest.importorskip("yaml").safe_load(text)
    return found


def steps(workflow: str) -> Iterator[dict[str, Any]]:
    """All steps of a workflow, its expressions filled in."""
    for job in yaml(EXPRESSION.sub(lambda found: VALUES.get(found[1], "unknown"), workflow))["jobs"].values():
        yield from job["steps"]


def commands(workflow: str) -> list[str]:
    return [step["run"] for step in steps(workflow) if "run" in step]


def run(script: str, folder: Path, shell: tuple[str, ...] = ("bash", "-e"), **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a step as GitHub does, on one worker, with the commands of this environment."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), "PYTEST_XDIST_AUTO_NUM_WORKERS": "1", **variables}
    return subprocess.run([*shell, "-c", script], cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_the_page_shows_the_workflow_that_is_written() -> None:
    assert template("rules.yml") in PRINTED
    assert WORKFLOW in PAGE


@pytest.mark.parametrize("workflow", PRINTED, ids=[f"workflow{n}" for n in range(len(PRINTED))])
def test_what_is_printed_is_a_workflow_of_known_parts(workflow: str) -> None:
    """Each step uses an action at a version or runs what bash can read; no text of others, as a title, gets into a script."""
    found = yaml(workflow)
    assert set(found) <= {"name", True, "env", "jobs"}
    for step in steps(workflow):
        assert ("uses" in step) != ("run" in step)
        assert re.fullmatch(r"[\w-]+(/[\w-]+)+@(v\d+|main)", step.get("uses", "actions/checkout@v4"))
    for script in commands(workflow):
        done = subprocess.run(["bash", "-n", "-c", script], capture_output=True, text=True, check=False)
        assert not done.stderr
    expressions = [
        one for script in re.findall(r"run: .*?(?=\n      - |\Z)", workflow, re.DOTALL) for one in EXPRESSION.findall(script)
    ]
    assert set(expressions) <= set(VALUES) | {"github.ref_name"}


def test_the_options_in_what_is_printed_exist(pytester: pytest.Pytester) -> None:
    offered = pytester.runpytest("--rvads-help").stdout.str()
    action = (ROOT / "action.yml").read_text("utf-8")
    for text in (*PRINTED, action):
        for option in set(re.findall(r"--rvads-[a-z-]*[a-z]", text)):
            assert f"{option} " in offered, option


def test_inputs_of_the_action_match_the_page() -> None:
    action = yaml((ROOT / "action.yml").read_text("utf-8"))
    rows = dict(re.findall(r"^\| `([\w-]+)` \| .* \| (.*) \|$", PAGE, re.MULTILINE))
    defaults = {name: rows[name].strip("`").replace("nothing", "").replace("none", "") for name in action["inputs"]}
    assert defaults == {name: one["default"] for name, one in action["inputs"].items()}
    used = set(re.findall(r"inputs\.([\w-]+)", (ROOT / "action.yml").read_text("utf-8")))
    assert used == set(action["inputs"])
    for workflow in PRINTED:
        for step in steps(workflow):
            if step.get("uses", "").startswith("pytest-rvads/"):
                assert set(step["with"]) <= set(action["inputs"])


@pytest.mark.extended
def test_the_workflow_runs_as_printed(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    """All that it runs, but for installing: on the main branch, where a test fails, then on a branch with that baseline."""
    pytest.importorskip("xdist")
    assert main(["init"]) == 0
    install, tests, check = commands(template("rules.yml"))
    assert install.startswith("pip install ")
    done = run(tests, pytester.path)
    assert done.returncode == 1, done.stdout
    assert re.search(r"[1-9]\d* failed", done.stdout)
    assert run(check, pytester.path).returncode == 1
    again = run(tests, pytester.path)
    assert again.returncode == 0, again.stdout
    assert "failed as in the baseline" in again.stdout
    assert run(check, pytester.path).returncode == 0
    kept = next(step["with"]["path"] for step in steps(template("rules.yml")) if "upload-artifact" in step.get("uses", ""))
    lacking = [name for name in kept.split() if not (pytester.path / name).exists()]
    assert lacking == ["verdicts.json.journal"], "which is there only where a session did not come to its end"


def test_broken_report_is_no_baseline(pytester: pytest.Pytester) -> None:
    check = commands(template("rules.yml"))[2]
    (pytester.path / "verdicts.json").write_text("{", "utf-8")
    assert run(check, pytester.path).returncode == 2
    assert not (pytester.path / "baseline.json").exists()


@pytest.mark.extended
def test_the_action_runs(pytester: pytest.Pytester, capsys: pytest.CaptureFixture[str]) -> None:
    """All that it runs, but for installing; what stands in an input is an argument and nothing else."""
    assert main(["init", "rules"]) == 0
    action = yaml((ROOT / "action.yml").read_text("utf-8"))
    by_id = {step.get("id", "check"): step for step in action["runs"]["steps"] if "run" in step}
    for step in action["runs"]["steps"]:
        assert not EXPRESSION.findall(step.get("run", ""))
        assert "shell" in step or "uses" in step
    compile(by_id["install"]["run"], "install", "exec")
    folder = pytester.path / "rules"
    variables = {
        "ARGUMENTS": "-k 'full_stop or keep_lane' -p no:cacheprovider",
        "REPORT": "out.json",
        "BASELINE": "main.json",
        "FAIL_ON": "new",
        "GITHUB_OUTPUT": str(pytester.path / "output"),
        "GITHUB_WORKSPACE": str(pytester.path),
        "GITHUB_ACTIONS": "true",
    }
    python = (sys.executable,)
    done = run(by_id["rules"]["run"], folder, python, **variables)
    assert done.returncode == 1, done.stdout + done.stderr
    assert re.search(r"\n::error file=rules/test_rules\.py,line=\d+,title=full_stop%2C \d items::", done.stdout)
    assert (pytester.path / "output").read_text("utf-8") == "name=rules/out\nreport=rules/out.json\n"
    assert run(by_id["check"]["run"], folder, REPORT="out.json").returncode == 1
    (folder / "out.json").rename(folder / "main.json")
    assert {path.name for path in folder.iterdir()} >= {"main.json", "out.html", "out.xml", ".rvads"}
    done = run(by_id["rules"]["run"], folder, python, **variables)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "\n::warning file=rules/test_rules.py," in done.stdout
    run(by_id["rules"]["run"], folder, python, **{**variables, "ARGUMENTS": "'$(touch broken)' `touch broken`"})
    assert not (folder / "broken").exists()

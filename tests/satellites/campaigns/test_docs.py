"""The page on many machines: its script runs and prints what it says."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[3] / "docs" / "many-machines.md").read_text(encoding="utf-8")


@pytest.mark.extended
def test_the_script_of_the_page_prints_what_it_says_and_its_results_make_reports(tmp_path: Path) -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    script = tmp_path / "script.py"
    script.write_text(code)
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines() == re.findall(r"print\(.*\)  # (.*)$", code, re.MULTILINE), done.stderr
    (command,) = re.findall(r"^\$ rvads (.*)$", PAGE, re.MULTILINE)
    rvads = Path(sys.executable).with_name("rvads")
    made = subprocess.run([rvads, *command.split()], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    assert "6 runs, 60 verdicts" in made.stdout
    assert {"report.html", "report.csv"} <= {path.name for path in tmp_path.iterdir()}

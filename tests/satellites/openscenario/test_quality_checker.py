"""What ASAM's quality checker says of our files, where somebody has it: ``RVADS_QC`` names the Python that it is installed in.

It needs an environment of its own: ``python -m venv qc && qc/bin/pip install asam-qc-openscenarioxml``.
"""

import json
import os
import subprocess
from pathlib import Path

import pytest

import pytest_rvads as rvads

from .failures import FAILURES

pytestmark = [
    pytest.mark.usefixtures("library"),
    pytest.mark.skipif(not os.environ.get("RVADS_QC"), reason="RVADS_QC names no Python with asam-qc-openscenarioxml"),
]
ASK = """
import json, logging, sys
logging.disable(logging.CRITICAL)
from qc_baselib import Configuration, Result
from qc_openscenario import constants, main
found = {}
for path in sys.argv[1:]:
    configuration, result = Configuration(), Result()
    configuration.set_config_param(name="InputFile", value=path)
    result.register_checker_bundle(name=constants.BUNDLE_NAME, description="", version="1.0.0", summary="")
    result.set_result_version("1.0.0")
    main.run_checks(configuration, result)
    checks = result.get_checker_results(constants.BUNDLE_NAME)
    issues = [issue.description for check in checks for issue in check.issues]
    found[path] = {"states": [check.status.name for check in checks], "issues": issues}
print(json.dumps(found))
"""


def check_results(files: list[Path]) -> dict[str, dict[str, list[str]]]:
    """Return per file the states of all checks, and their issues."""
    command = [os.environ["RVADS_QC"], "-c", ASK, *map(str, files)]
    answer = subprocess.run(command, check=True, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": ""})
    results: dict[str, dict[str, list[str]]] = json.loads(answer.stdout.splitlines()[-1])
    return results


def test_runs_and_scenarios_pass_every_check(maps: Path, tmp_path: Path) -> None:
    files = []
    for number, failure in enumerate(FAILURES):
        run = failure.run(maps)
        rvads.files.export_run(run, tmp_path / f"{number}.xosc", verdict=rvads.check(run, failure.rule))
        place = run.junction
        scenario = rvads.Scenario(place, failure.directions, **failure.more)
        rvads.files.save_scenario(scenario, tmp_path / f"{number}s.xosc")
        files += [tmp_path / f"{number}.xosc", tmp_path / f"{number}s.xosc"]
    for path, result in check_results(files).items():
        assert result["issues"] == [], path
        assert set(result["states"]) == {"COMPLETED"}, path


def test_quality_checker_reports_a_damaged_file(maps: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.xosc"
    rvads.files.export_run(FAILURES[3].run(maps), path)
    path.write_text(path.read_text("utf-8").replace("<LogicFile", "<LogicalFile"), encoding="utf-8")
    assert check_results([path])[str(path)]["issues"]

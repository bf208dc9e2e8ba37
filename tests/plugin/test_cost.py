"""The plugin is imported by every pytest run of its environment, so it must cost next to nothing."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import get_origin

import pytest

HEAVY = ("numpy", "networkx", "rich", "hypothesis", "lark", "pybullet", "mujoco", "msgspec")


def test_importing_the_plugin_loads_nothing_heavy() -> None:
    code = f"import sys, pytest_rvads.plugin; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_session_without_tests_of_ours_loads_nothing_heavy(tmp_path: Path) -> None:
    (tmp_path / "test_other.py").write_text(
        f"import sys\n\ndef test_other():\n    assert not {set(HEAVY)!r} & set(sys.modules)\n"
    )
    command = [sys.executable, "-m", "pytest", "-p", "pytest_rvads.plugin", "--rootdir=.", "test_other.py"]
    environment = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.extended
def test_hypothesis_is_imported_by_searches_only(tmp_path: Path) -> None:
    tests = """
        import sys
        import pytest_rvads as rvads

        def test_plain():
            assert "hypothesis" not in sys.modules

        @rvads.scenario("stop3", grid="B", rules=("p1",))
        def test_rules(run, rule, monitor):
            monitor.check(rule)
            assert "hypothesis" not in sys.modules
    """
    (tmp_path / "test_own.py").write_text(textwrap.dedent(tests))
    command = [sys.executable, "-m", "pytest", "--rvads-autopilot=reference", "--rootdir=.", "test_own.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_every_public_name_is_there_and_documented() -> None:
    import pytest_rvads

    for name in pytest_rvads.__all__:
        value = getattr(pytest_rvads, name)
        assert value.__doc__ or get_origin(value), (
            name
        )  # an alias of a type has none; what the API page says of it is tested there
    assert dir(pytest_rvads) == sorted(pytest_rvads.__all__)

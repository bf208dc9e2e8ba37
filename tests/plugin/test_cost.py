"""The plugin is imported by every pytest run of its environment, so it must cost next to nothing."""

import subprocess
import sys

HEAVY = ("numpy", "networkx", "rich", "hypothesis", "lark", "pybullet", "msgspec")


def test_importing_the_plugin_loads_nothing_heavy() -> None:
    code = f"import sys, pytest_rvads.plugin; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there_and_documented() -> None:
    import pytest_rvads

    for name in pytest_rvads.__all__:
        assert getattr(pytest_rvads, name).__doc__, name
    assert dir(pytest_rvads) == sorted(pytest_rvads.__all__)

"""Fixtures shared by the tests of all packages."""

import os
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

import pytest_rvads
from pytest_rvads.logic.registry import registries_kept

pytest_plugins = ["pytester"]

os.environ["RVADS_CACHE"] = ""  # no test depends on, or leaves, what earlier ones found

# Inner sessions of pytester forget the modules they load: that costs a second each, and modules in C can't be loaded twice.
for _name in pytest_rvads.__all__:
    getattr(pytest_rvads, _name)
for _name in ("hypothesis", "pytest_rvads.draw.picture", "pytest_rvads.draw.replay", "pytest_rvads.report.terminal"):
    import_module(_name)


@pytest.fixture(autouse=True)
def _registries() -> Iterator[None]:
    """What a test registers, or a command that it runs in this process, is forgotten at its end."""
    with registries_kept():
        yield


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of maps and recordings by other people; tests that need it skip where it is absent."""
    folder = Path(__file__).parents[2] / "shared"
    if not folder.is_dir():
        pytest.skip("the folder ../shared with maps and recordings by other people is absent")
    return folder

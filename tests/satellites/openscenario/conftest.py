"""Map files, and the library for writing; tests of reading don't need the library."""

from pathlib import Path

import pytest

from .failures import write_maps


@pytest.fixture(scope="session")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of map files of junctions that are not built in."""
    return write_maps(tmp_path_factory.mktemp("maps"))


@pytest.fixture
def library() -> None:
    """Skip the test if the library for writing is not installed."""
    pytest.importorskip("scenariogeneration")

"""Maps of files, and the library that writes; what only reads does without."""

from pathlib import Path

import pytest

from .failures import write_maps


@pytest.fixture(scope="session")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of maps that are not built in."""
    return write_maps(tmp_path_factory.mktemp("maps"))


@pytest.fixture
def library() -> None:
    """Skip where files can't be written."""
    pytest.importorskip("scenariogeneration")

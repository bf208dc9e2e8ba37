"""The versions that verdicts depend on."""

from __future__ import annotations

import platform
from importlib.metadata import version

from pytest_rvads import __version__

__all__ = ["versions"]


def versions() -> dict[str, str]:
    """Return the versions of this package and of what its runs depend on, by name."""
    return {
        "pytest-rvads": __version__,
        "pybullet": version("pybullet"),
        "numpy": version("numpy"),
        "python": platform.python_version(),
    }

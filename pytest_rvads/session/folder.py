"""The folder of a session: all processes of the session share one path, and the folder is made when a file is written to it."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

from pytest_rvads.options import Options

__all__ = ["FOLDER", "SessionFolder"]

_TOKEN = "rvads_session"
"""Key of what a worker is told."""


class SessionFolder:
    """Where a session leaves pages, reports and runs; nothing is made before there is something to leave.

    Args:
        config: of the session.
        options: of the session.
    """

    def __init__(self, config: pytest.Config, options: Options) -> None:
        self._token: str = getattr(config, "workerinput", {}).get(_TOKEN) or uuid4().hex
        self._here, self._artefacts, self._keep = config.invocation_params.dir, options.artefacts or "", options.keep_sessions

    def made(self) -> Path:
        """Return the folder, which is there from now on.

        Raises:
            OSError: it can't be made.
        """
        from pytest_rvads.report.folders import claimed

        return claimed(self._here / self._artefacts, self._token, self._keep)

    def told(self, path: Path) -> str:
        """Return a path in the folder from where the session was started, as it was named there."""
        return (Path(self._artefacts) / path.relative_to(self._here / self._artefacts)).as_posix()

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Tell a worker which session it works for."""
        node.workerinput[_TOKEN] = self._token


FOLDER: pytest.StashKey[SessionFolder] = pytest.StashKey()

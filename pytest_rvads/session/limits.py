"""How long drivers and runs of a session may take, and where its last words go."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from pytest_rvads.options import OPTIONS
from pytest_rvads.simulators.patience import Limits

__all__ = ["limits"]


@contextmanager
def limits(config: pytest.Config) -> Iterator[Limits]:
    """Give the limits of real time that the options say.

    Where pytest itself ends what hangs (``faulthandler_timeout``), ours ends no process: there is one such timer only.
    """
    options = config.stash[OPTIONS]
    dump = None if _has_a_timer(config) else _standard_error()
    try:
        yield Limits(options.decision_limit, options.run_limit, dump)
    finally:
        if dump is not None:
            os.close(dump)


def _has_a_timer(config: pytest.Config) -> bool:
    try:
        return float(config.getini("faulthandler_timeout") or 0) > 0
    except ValueError:  # its plugin is switched off
        return False


def _standard_error() -> int | None:
    """Return a descriptor of its own for the standard error of the process, which pytest redirects while items run."""
    try:
        return os.dup(2)
    except OSError:
        return None

"""Which code drives and simulates, told in the head of a session where its options name it."""

from __future__ import annotations

from typing import Any

import pytest

from pytest_rvads.drivers.chosen import chosen
from pytest_rvads.options import OPTIONS

__all__ = ["code_of_driver", "code_of_simulator"]


def code_of_driver(config: pytest.Config) -> str:
    """Return where the code of what the options say drives is, with a digest of it or a version: `` (pilots.py 3fa29c01)``."""
    options = config.stash[OPTIONS]
    here = config.invocation_params.dir
    if options.autopilot is not None:
        return _told(chosen(options.autopilot, here), config)
    if options.sut is not None:
        from pytest_rvads.drivers.stacks.process import Process

        return _told(Process(options.sut), config)  # which starts nothing before a run asks for it
    return ""


def code_of_simulator(config: pytest.Config, simulator: Any) -> str:
    """Return where the code of a simulator is, likewise."""
    return _told(simulator, config)


def _told(thing: Any, config: pytest.Config) -> str:
    from pytest_rvads.drivers.identity import source

    found = source(thing, config.invocation_params.dir)
    return f" ({found})" if found else ""

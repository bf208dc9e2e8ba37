"""The options ``-j`` and ``--dask``: the executor of a command.

distributed is imported only for ``--dask``; callers of `rvads.campaign` bring an executor.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib.util import find_spec

from pytest_rvads.support.errors import RvadsError, ScenarioError, needs

__all__ = ["declare", "opened"]

_PATIENCE = 20
"""Longest time for a scheduler to answer, at the beginning and after a lost connection [s]."""


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options to a command."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("-j", "--workers", type=int, metavar="N", help="processes (default: one per processor)")
    where.add_argument(
        "--dask", metavar="ADDRESS", help="the workers of this Dask scheduler instead, such as tcp://10.0.0.1:8786"
    )


@contextmanager
def opened(options: argparse.Namespace) -> Iterator[Executor | int | None]:
    """Yield the executor that the options name, for `spread` and `campaign`; a connection to a scheduler is closed at the end.

    Raises:
        ScenarioError: the number of processes is less than 1.
        RvadsError: Dask is not installed, or no scheduler answers at the address.
    """
    if options.workers is not None and options.workers < 1:
        raise ScenarioError(f"--workers must be at least 1, got {options.workers}")
    if options.dask is None:
        yield options.workers
        return
    if not find_spec("distributed"):
        raise RvadsError(needs("--dask", "distributed", "dask"))
    from distributed import Client

    try:
        client = Client(options.dask, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise RvadsError(
            f"no Dask scheduler answers at {options.dask!r} ({type(error).__name__}: {error}): expected an address such as "
            "tcp://10.0.0.1:8786, as `dask scheduler` prints it"
        ) from error
    try:
        yield client.get_executor(pure=False)
    finally:
        client.close(timeout=_PATIENCE)

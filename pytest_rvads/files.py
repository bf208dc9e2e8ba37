"""The functions that read and write files of runs, recordings, scenarios and rules; the names stand in ``files.pyi``."""

from pytest_rvads.support.lazy import public_names

__getattr__, __dir__ = public_names(__name__)

"""What tests ask for by ``@rvads.scenario`` and ``@rvads.recorded``, and its expansion into items at collection."""

from pytest_rvads.collection.cells import KEYS, Cell, RecordedCell
from pytest_rvads.collection.expansion import expand, expand_recorded, idle, is_recorded, unused
from pytest_rvads.collection.marks import known, recorded, register_marks, scenario

__all__ = [
    "KEYS",
    "Cell",
    "RecordedCell",
    "expand",
    "expand_recorded",
    "idle",
    "is_recorded",
    "known",
    "recorded",
    "register_marks",
    "scenario",
    "unused",
]

"""What tests ask for by ``@rvads.scenario``, and its expansion into items at collection."""

from pytest_rvads.collection.cells import KEYS, Cell
from pytest_rvads.collection.expansion import expand, idle, unused
from pytest_rvads.collection.marks import known, register_marks, scenario

__all__ = ["KEYS", "Cell", "expand", "idle", "known", "register_marks", "scenario", "unused"]

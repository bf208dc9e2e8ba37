"""The classes of values that are parts of runs and junctions, or that functions return.

A test reads such values without their classes. Annotations, and code that makes a `Run`, need the classes.
"""

from pytest_rvads.geometry.ways import Entrance, Exit, Movement
from pytest_rvads.logic.conduct.validate import Finding
from pytest_rvads.logic.live.instant import Decided
from pytest_rvads.runs.measured import Kpis
from pytest_rvads.runs.run import Collision, Facts, Fault

__all__ = ["Collision", "Decided", "Entrance", "Exit", "Facts", "Fault", "Finding", "Kpis", "Movement"]

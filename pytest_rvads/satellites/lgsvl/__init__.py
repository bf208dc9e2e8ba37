"""The LGSVL-like autopilot of the paper's experiment, a calibrated surrogate with switchable deficiencies."""

from pytest_rvads.satellites.lgsvl.pilot import LgsvlLike
from pytest_rvads.satellites.lgsvl.scheduler import Constants, ZoneBox

__all__ = ["Constants", "LgsvlLike", "ZoneBox"]

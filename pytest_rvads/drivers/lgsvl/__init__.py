"""The LGSVL-like autopilot of the paper's experiment, a calibrated surrogate with switchable deficiencies."""

from pytest_rvads.drivers.lgsvl.constants import Constants, ZoneBox
from pytest_rvads.drivers.lgsvl.system import LgsvlLike

__all__ = ["Constants", "LgsvlLike", "ZoneBox"]

"""Autopilots that ship with the project: systems under test and helpers to write one."""

from pytest_rvads.autopilots.follower import Follower
from pytest_rvads.autopilots.reference import Reference
from pytest_rvads.autopilots.rolling import RollingStop

__all__ = ["Follower", "Reference", "RollingStop"]

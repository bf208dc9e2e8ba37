"""Autopilots that ship with the project: systems under test and helpers to write one."""

from pytest_rvads.autopilots.reference import Reference
from pytest_rvads.autopilots.rolling import RollingStop
from pytest_rvads.tracking.follower import Follower

__all__ = ["Follower", "Reference", "RollingStop"]

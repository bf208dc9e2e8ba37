"""The traffic policies for tests."""

from pytest_rvads.drivers.traffic import policies

EVERYWHERE = tuple(name for name in policies() if name != "sumo")
"""Names of the policies that drive in every simulator."""

"""SUMO's driver, named where drivers are: in the simulator ``sumo``, SUMO's own models drive the vehicles it is named for."""

from __future__ import annotations

from pytest_rvads.drivers.interface import Autopilot, Command, Observation
from pytest_rvads.support.errors import AutopilotError

__all__ = ["SumoDriver"]


class SumoDriver(Autopilot):
    """The driver of SUMO: its car-following and junction models; in another simulator than ``sumo`` it can't drive."""

    label = "sumo"

    def control(self, _seen: Observation) -> Command:
        """Raise: SUMO moves its vehicles by itself, and asks nobody.

        Raises:
            AutopilotError: always.
        """
        raise AutopilotError(
            "SUMO's driver drives in the simulator sumo alone: add --rvads-simulator sumo, and name rvads.SumoDriver itself"
        )

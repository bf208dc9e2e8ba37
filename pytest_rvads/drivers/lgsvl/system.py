"""The LGSVL-like autopilot: a traffic system with a scheduler, and the paper's five deficiencies as switches."""

from __future__ import annotations

from collections.abc import Sequence

from pytest_rvads.drivers.interface import Drives, TrafficSystem
from pytest_rvads.drivers.lgsvl.constants import Constants
from pytest_rvads.drivers.lgsvl.pilot import Pilot, Switches
from pytest_rvads.drivers.lgsvl.scheduler import Scheduler
from pytest_rvads.runs.states import Agent

__all__ = ["LgsvlLike"]


class LgsvlLike(TrafficSystem):
    """A calibrated surrogate of the controller that the paper examined, on vehicles with real dynamics.

    Args:
        i1: a vehicle sets off before its driver knows about the stop sign.
        i2: the scheduler mistakes a hidden box for the junction.
        i3: the scheduler ignores the vehicle to the right when two vehicles arrive together.
        i4: a vehicle turns right on red after a time, without regard to other vehicles.
        i5: a left turn yields by an incomplete list of oncoming movements.
        constants: the free constants.

    Example:
        >>> from functools import partial
        >>> without_hidden_zone = partial(LgsvlLike, i2=False)
    """

    def __init__(
        self,
        *,
        i1: bool = True,
        i2: bool = True,
        i3: bool = True,
        i4: bool = True,
        i5: bool = True,
        constants: Constants | None = None,
    ) -> None:
        self.switches = Switches(i1, i2, i3, i4, i5)
        self.constants = constants or Constants()

    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Drives]:
        """Return one autopilot per agent, in creation order."""
        scheduler = Scheduler((agent.name for agent in agents), self.switches.i3)
        return [Pilot(self.switches, self.constants, scheduler) for _ in agents]

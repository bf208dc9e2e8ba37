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
        i1: drives off before it knows that it has to stop.
        i2: the scheduler takes a hidden box for the junction.
        i3: the scheduler ignores who is to the right when two arrive together.
        i4: turns right on red after a time, without looking.
        i5: turns left by an incomplete list of whom to yield to.
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

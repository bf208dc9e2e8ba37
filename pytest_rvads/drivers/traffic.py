"""Traffic policies by name: how the vehicles around a subject drive."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from pytest_rvads.drivers.interface import Autopilot, Command, Factory, Observation
from pytest_rvads.drivers.lgsvl import LgsvlLike
from pytest_rvads.drivers.naming import in_ids
from pytest_rvads.drivers.policies import Hesitant, LateYielder, RedLightRunner, Stopped
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.rolling import RollingStop
from pytest_rvads.logic.conduct.standing import TIE
from pytest_rvads.support.errors import AutopilotError, ScenarioError, suggest

__all__ = ["DEFAULT", "EVERYWHERE", "POLICIES", "Policy", "SumoDriver", "policy_name", "traffic"]


class SumoDriver(Autopilot):
    """SUMO's own car-following and junction models, which drive in the simulator ``sumo`` only."""

    label = "sumo"

    def control(self, _seen: Observation) -> Command:
        """Raise an error, because SUMO moves its vehicles by itself.

        Raises:
            AutopilotError: always.
        """
        raise AutopilotError(
            "SUMO's driver drives in the simulator sumo alone: add --rvads-simulator sumo, and name rvads.SumoDriver itself"
        )


DEFAULT = "reference"
"""Name of the default policy, which ids leave out."""
POLICIES: dict[str, Factory] = {
    "reference": partial(Reference, tie=TIE),
    "hesitant": partial(Hesitant, tie=TIE),
    "rolling_stop": RollingStop,
    "late_yielder": partial(LateYielder, tie=TIE),
    "red_light_runner": RedLightRunner,
    "stopped": Stopped,
    "lgsvl": LgsvlLike,
    "sumo": SumoDriver,
}
"""The traffic policies by name."""
EVERYWHERE = tuple(name for name, factory in POLICIES.items() if factory is not SumoDriver)
"""Names of the policies that drive in every simulator."""


@dataclass(frozen=True, slots=True)
class Policy:
    """What drives the vehicles around a subject."""

    name: str
    """As in ids: letters, digits and underscores."""
    factory: Factory
    """Makes the autopilot of one vehicle, or the traffic system of a run."""

    @classmethod
    def of(cls, what: str | Factory) -> Policy:
        """Return the policy of that name, or the policy of a user's autopilot or traffic system.

        Raises:
            ScenarioError: no policy has this name, or the object can't be called.
        """
        if isinstance(what, str):
            return cls(what, traffic(what))
        if not callable(what):
            raise ScenarioError(f"traffic takes names of policies or classes of autopilots, got {what!r}")
        return cls(in_ids(what), what)


def policy_name(factory: Factory) -> str:
    """Return the name of a policy for ids: the key in `POLICIES`, or the name of the factory."""
    return next((name for name, policy in POLICIES.items() if policy is factory), "") or in_ids(factory)


def traffic(name: str, what: str = "traffic") -> Factory:
    """Return the traffic policy called `name`, for ``simulate(..., traffic=...)``.

    Args:
        name: one of `POLICIES`.
        what: role of the policy in the error message, such as ``traffic``.

    Raises:
        ScenarioError: no policy has this name.
    """
    if name not in POLICIES:
        raise ScenarioError(f"unknown {what} {name!r}, there are {', '.join(POLICIES)}{suggest(name, POLICIES)}")
    return POLICIES[name]

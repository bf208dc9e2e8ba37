"""The reference autopilot with one fault each: what rules and checks are measured against.

A name in `MUTANTS` says what is wrong, the class's docstring says how; everything else a mutant does like the
reference autopilot.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from pytest_rvads.drivers.reference import Reference
from studies.mutants import action, crosswalks, decision, sight

MUTANTS: Mapping[str, type[Reference]] = MappingProxyType(
    {
        "anticipates green": decision.Anticipates,
        "blind ahead": sight.BlindAhead,
        "blind inside": sight.BlindInside,
        "blind to the left": sight.BlindLeft,
        "blind to the right": sight.BlindRight,
        "creeps": action.Creeps,
        "dawdles": action.Dawdles,
        "deadlocks": decision.Deadlocks,
        "equal patience": decision.EqualPatience,
        "half yield": decision.HalfYield,
        "hits the leader": action.HitsLeader,
        "ignores stop": decision.IgnoresStop,
        "ignores yellow": sight.Yellow,
        "jostles": decision.Jostles,
        "last come first": decision.Backwards,
        "late brake": action.LateBrake,
        "late sight": sight.LateSight,
        "left first": decision.LeftFirst,
        "lowest number first": decision.NumberFirst,
        "never green": sight.Unlit,
        "no stop right on red": decision.NoRightOnRedStop,
        "no yield right on red": decision.NoRightOnRedYield,
        "no yield turning left": decision.NoYield,
        "runs red": sight.RunsRed,
        "short stop": decision.ShortStop,
        "short-sighted": sight.ShortSighted,
        "speeds": action.Speeds,
        "stops far": action.StopsFar,
        "tailgates": decision.Tailgates,
        "takes all for standing": sight.NoSpeeds,
        "weak brake": action.WeakBrake,
    }
)
"""By name, in alphabetical order."""
AT_CROSSWALKS: Mapping[str, type[Reference]] = MappingProxyType(
    {
        "blind turning right": crosswalks.BlindTurningRight,
        "brakes late at crosswalks": crosswalks.BrakesLate,
        "ignores occlusion": crosswalks.IgnoresOcclusion,
        "ignores the far side": crosswalks.IgnoresFarSide,
        "passes tightly": crosswalks.PassesTightly,
        "stops on crosswalks": crosswalks.StopsOnCrosswalk,
        "waits for ever": crosswalks.WaitsForEver,
        "yields in front only": crosswalks.FrontOnly,
    }
)
"""The mutants whose fault shows where pedestrians walk, by name, in alphabetical order."""

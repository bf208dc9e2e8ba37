"""All exceptions of the package. `RuleViolation` is also a name of ``pytest_rvads`` itself."""

from pytest_rvads.support.errors import (
    AutopilotError,
    FormulaError,
    MapError,
    MetamorphicViolation,
    OpenObligation,
    RuleViolation,
    RunError,
    RvadsError,
    ScenarioError,
)

__all__ = [
    "AutopilotError",
    "FormulaError",
    "MapError",
    "MetamorphicViolation",
    "OpenObligation",
    "RuleViolation",
    "RunError",
    "RvadsError",
    "ScenarioError",
]

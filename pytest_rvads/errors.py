"""All exceptions of the package. `RvadsError` and `RuleViolation` are also names of ``pytest_rvads`` itself."""

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

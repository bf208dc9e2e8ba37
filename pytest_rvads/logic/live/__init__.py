"""Rules on a run while it is being produced: one state at a time."""

from pytest_rvads.logic.live.rule_monitor import RuleMonitor
from pytest_rvads.logic.live.seeing import Decided, Seen

__all__ = ["Decided", "RuleMonitor", "Seen"]

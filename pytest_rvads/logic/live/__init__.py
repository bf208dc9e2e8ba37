"""Rules on a run while it is being produced: one state at a time."""

from pytest_rvads.logic.live.instant import Decided, Seen
from pytest_rvads.logic.live.rule_monitor import RuleMonitor

__all__ = ["Decided", "RuleMonitor", "Seen"]

"""The cost limit of a formula: counted in steps, not in seconds, so that the same formula always gets the same answer."""

from __future__ import annotations

from dataclasses import dataclass

from pytest_rvads.support.errors import FormulaError

__all__ = ["Budget"]


@dataclass(slots=True)
class Budget:
    """Counts the work that a formula causes, so that a formula that blows up is refused."""

    limit: int
    size: int
    """Size of the formula, for the message."""
    spent: int = 0
    what: str = "a monitor too large to build"
    """The result that would need more than the limit, for the message."""

    def spend(self, work: int) -> None:
        """Add `work` steps.

        Raises:
            FormulaError: the limit is exceeded.
        """
        self.spent += work
        if self.spent > self.limit:
            raise FormulaError(
                f"the formula, of size {self.size}, needs {self.what} "
                f"(more than {self.limit:,} steps): split it into smaller rules"
            )

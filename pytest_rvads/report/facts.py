"""What stands beside the replay of a failure, the same whoever draws it."""

from __future__ import annotations

from pytest_rvads.report.record import Record, SimulatedItem

__all__ = ["facts"]


def facts(record: Record, start: str, rerun: str) -> tuple[tuple[str, str], ...]:
    """Return word and text of what there is to know of an item's run, without what is not known.

    Args:
        record: of the item.
        start: how the run began, or which file it was recorded in.
        rerun: the command that runs the item once more.
    """
    verdict = record.verdicts[-1] if record.verdicts else None
    rule = verdict.rule if verdict is not None else record.rule or ""
    run: tuple[tuple[str, str], ...] = (("recorded", start),)
    if isinstance(record, SimulatedItem):
        driver = f"{record.driver} ({record.source})" if record.source else record.driver
        if record.traffic and verdict is not None and verdict.subject:
            driver = f"{driver}, {verdict.subject} alone; the others by {record.traffic}"
        run = ("scenario", start), ("driven by", driver), ("simulated by", record.simulator)
    found = (
        *run,
        ("rule", f"{rule}: {verdict.title}" if verdict is not None and verdict.title else rule),
        ("requirements", ", ".join(record.requirements)),
        ("rerun", rerun),
    )
    return tuple((word, text) for word, text in found if text)

"""Runs of which only some states were seen."""

from dataclasses import replace

from pytest_rvads.runs.run import Run


def coarse(run: Run, every: int, first: int = 0) -> Run:
    """Return a run of every so many states of a run, from a state on."""
    part = slice(first, None, every)
    arrays = {name: array[part] for name in ("station", "speed", "pose", "spread") if (array := getattr(run, name)) is not None}
    return replace(run, zone=run.zone[part], lights=run.lights[part], dt=run.dt * every, **arrays)

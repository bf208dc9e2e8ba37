"""The doubt on which an UNSURE instance depends, in words."""

from __future__ import annotations

import math

from pytest_rvads.logic.judging.judge import Happening, Judgement
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone

__all__ = ["hangs", "since"]

_CAME = {
    Zone.ENTRANCE: ("arrived", "had arrived"),
    Zone.JUNCTION: ("entered", "had entered"),
    Zone.EXIT: ("was through", "was through"),
    Zone.GONE: ("was gone", "was gone"),
}
"""Per zone, the verb for a vehicle that came to the zone, and the verb for a vehicle that may never have come."""


def hangs(run: Run, j: Judgement) -> str:
    """Return the doubt on which an instance depends, and its size; empty for a definite instance.

    An example is ``a4 arrived at 12.31 s, a7 arrived at 12.34 s: 0.03 s apart, known to 0.05 s``.
    """
    hinge = j.hinge
    if hinge is None:
        return ""
    if hinge.reading:
        who = " and ".join(dict.fromkeys(name for _, name in _agents(j)))
        return f"it hangs on {hinge.reading}" + (f" ({who})" if who else "")
    told = ", ".join(_happened(run, happening) for happening in hinge.what)
    if math.isinf(hinge.known):
        return f"{told}; how long before is not known"
    if hinge.apart is None:
        return f"{told}, known to {hinge.known:.2f} s"
    tie = f", where up to {hinge.tie:.2f} s count as at the same time" if hinge.tie else ""
    return f"{told}: {abs(hinge.apart):.2f} s apart, known to {hinge.known:.2f} s{tie}"


def since(run: Run, j: Judgement) -> float | None:
    """Return the time of the doubtful events on the clock of the recording [s], else of the trigger."""
    times = [h.time for h in j.hinge.what if h.time is not None] if j.hinge else []
    tick = None if j.trigger is None else j.trigger * run.dt
    time = max(times) if times else tick
    return None if time is None else round(run.start + time, 9)


def _agents(j: Judgement) -> list[tuple[str, str]]:
    return [(name, element.name) for name, element in j.template.binding if element.sort == Sort.AGENT]


def _happened(run: Run, happening: Happening) -> str:
    """Return an event in words: the vehicle or light, its change, and the time."""
    if happening.agent is None:
        what, ended = f"light {happening.light} turned {Colour(happening.code).name.lower()}", ""
    else:
        did, had = _CAME[Zone(happening.code)]
        name = run.agents[happening.agent].name
        what, ended = f"{name} {did}", f"nothing tells whether {name} {had} when its recording ends"
    return ended if happening.time is None else f"{what} at {run.start + happening.time:.2f} s"

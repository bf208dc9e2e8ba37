"""Simulates and judges a case in any process. The question travels with the case; a process with other code refuses to answer."""

from __future__ import annotations

import multiprocessing
from dataclasses import dataclass
from functools import lru_cache

import msgspec

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.kpis import kpis
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.run_record import of_run, sentence, unjudged, verdict_by
from pytest_rvads.satellites.campaigns.judged import Judged
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.ids import run_id
from pytest_rvads.simulators.choice import Choice, choosing
from pytest_rvads.simulators.patience import Limits
from pytest_rvads.simulators.simulator import Simulator, made_by, simulate
from pytest_rvads.support.decoding import encode
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.versions import code, versions

__all__ = ["Job", "Question", "judge", "undecided"]

_STANDARD_ERROR = 2


@dataclass(frozen=True, slots=True)
class Question:
    """The question of a campaign about every case."""

    rules: tuple[str | Rule, ...]
    """Shipped rules and rulebooks as names, other rules as `Rule`."""
    simulator: Simulator
    limits: Limits
    """Limits of real time."""
    code: str
    """Checksum of the package that asks."""
    versions: dict[str, str]
    """Version of each package on which results depend, by name of the package."""


@dataclass(frozen=True, slots=True)
class Job:
    """One case of a campaign."""

    number: int
    key: str
    """Hash of the case."""
    case: Case
    driver: str
    """Name of the driver in reports."""
    traffic: str | None
    """Policy of the traffic around a subject."""


def judge(question: Question, job: Job) -> bytes:
    """Return the verdicts of all rules on a case, as a `Judged` in JSON; an error of simulating or judging is an ERROR in it.

    Raises:
        RvadsError: the code or the versions of this process differ from those of the asking process.
    """
    own_versions = _versions(tuple(question.versions))
    if (code(), own_versions) != (question.code, question.versions):
        raise RvadsError(
            f"a worker has other code ({code()[:8]}, {_listed(own_versions)}) than who asks it ({question.code[:8]}, "
            f"{_listed(question.versions)}): install the same version of pytest-rvads and of what it needs on all machines"
        )
    # A process of the campaign may end if a driver can't be stopped otherwise: the campaign continues without the process.
    ends = multiprocessing.parent_process() is not None
    limits = question.limits._replace(dump=_STANDARD_ERROR) if ends else question.limits
    try:
        with choosing(Choice(question.simulator, limits)):
            run = simulate(_at_home(job.case), question.simulator)
    except Exception as error:
        return encode(undecided(question, job, sentence(error)))
    return encode(
        msgspec.structs.replace(
            _started(job),
            simulator=made_by(question.simulator, run),
            kpis=kpis(run),
            verdicts=tuple(msgspec.structs.replace(verdict_by(run, r), explanation="") for r in _rules(question, job)),
            **of_run(run),
        )
    )


def _at_home(case: Case) -> Case:
    """Return a case with the first of equal junctions: every batch brings a copy of its junction, and caches are per copy."""
    place = _first(case.scenario.place)
    return case if place is case.scenario.place else case.but(place=place)


@lru_cache(maxsize=256)
def _first(place: Junction) -> Junction:
    return place


@lru_cache(maxsize=8)
def _versions(names: tuple[str, ...]) -> dict[str, str]:
    """Return the versions of packages in this process; the look-up takes as long as judging a run."""
    return {name: version for name, version in versions(*names).items() if name in names}


def _started(job: Job) -> Judged:
    """Return the result of a case as far as it is known before the simulation."""
    scenario = job.case.scenario
    place, name = scenario.place, run_id(scenario, job.traffic)
    return Judged(
        case=job.key,
        number=job.number,
        nodeid=name,
        run=name,
        junction=place.name,
        control=str(place.control),
        ways=place.ways,
        cls=scenario.number,
        scenario=scenario.label,
        cfg=scenario.point,
        rotation=scenario.rotation,
        seat=scenario.subject,
        traffic=job.traffic,
        orbit=scenario.orbit,
        driver=job.driver,
        simulator="",
        place=place.digest[:12],
        verdicts=(),
    )


def undecided(question: Question, job: Job, reason: str) -> Judged:
    """Return the result of a case without a run: an ERROR by every rule, with the reason."""
    return msgspec.structs.replace(_started(job), verdicts=tuple(unjudged(rule, reason) for rule in _rules(question, job)))


def _rules(question: Question, job: Job) -> tuple[Rule, ...]:
    return rules_for(question.rules, job.case.scenario.place)


def _listed(versions: dict[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in versions.items())

"""Simulates and judges one case of a campaign in any process, given the rules and settings of the campaign with the case.

A process whose code differs from the code of the process that started the campaign refuses to judge.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import msgspec

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.check import sentence, unjudged, verdict_by
from pytest_rvads.logic.conduct.kpis import arrival_differences, kpis
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.record import of_run
from pytest_rvads.satellites.campaigns.resultsfile import Judged
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.ids import run_id
from pytest_rvads.simulators.simulator import Choice, made_by, simulate
from pytest_rvads.support.decoding import encode
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.installed import code, versions


@dataclass(frozen=True, slots=True)
class Question:
    """What a campaign uses for every case: its rules, simulator and limits of real time, and the code that workers must have."""

    rules: tuple[str | Rule, ...]
    """Shipped rules and rulebooks as names, other rules as `Rule`."""
    simulator: Choice
    code: str
    """Checksum of this package's code in the process that started the campaign."""
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
    """Name of the traffic's driver, if the case has a subject (vehicle under test)."""


def judge(question: Question, job: Job) -> bytes:
    """Return the verdicts of all rules on a case, as a `Judged` in JSON; every verdict is ERROR if the simulation fails."""
    own_versions = _versions(tuple(question.versions))
    if (code(), own_versions) != (question.code, question.versions):
        raise RvadsError(
            f"a worker has other code ({_told(code(), own_versions)}) than the process that asks it "
            f"({_told(question.code, question.versions)}): install the same version of pytest-rvads and of its dependencies on "
            "all machines"
        )
    try:
        # Each case arrives with a copy of its junction, and caches are kept per junction object.
        place = _first_equal(job.case.scenario.place)
        case = job.case if place is job.case.scenario.place else job.case.but(place=place)
        run = simulate(case, question.simulator)
    except (Exception, SystemExit) as error:
        return encode(undecided(question, job, sentence(error)))
    return encode(
        msgspec.structs.replace(
            _unjudged_result(job),
            simulator=made_by(question.simulator, run),
            kpis=kpis(run),
            arrivals=arrival_differences(run),
            verdicts=tuple(msgspec.structs.replace(verdict_by(run, r), explanation="") for r in _case_rules(question, job)),
            **of_run(run),
        )
    )


@lru_cache(maxsize=256)
def _first_equal(place: Junction) -> Junction:
    return place


@lru_cache(maxsize=8)
def _versions(names: tuple[str, ...]) -> dict[str, str]:
    """Return the versions of packages in this process, from a cache, because a lookup takes as long as judging a run."""
    return {name: version for name, version in versions(*names).items() if name in names}


def _unjudged_result(job: Job) -> Judged:
    """Return a result without verdicts, filled with what is known of a case before its simulation: ids, junction, driver."""
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
        pedestrians=scenario.walking,
        traffic=job.traffic,
        orbit=scenario.orbit,
        driver=job.driver,
        simulator="",
        place=place.digest[:12],
        verdicts=(),
    )


def undecided(question: Question, job: Job, reason: str) -> Judged:
    """Return the result of a case without a run: the verdict ERROR with a reason for every rule."""
    return msgspec.structs.replace(
        _unjudged_result(job), verdicts=tuple(unjudged(rule, reason) for rule in _case_rules(question, job))
    )


def _case_rules(question: Question, job: Job) -> tuple[Rule, ...]:
    return rules_for(question.rules, job.case.scenario.place)


def _told(code: str, versions: dict[str, str]) -> str:
    return ", ".join([code[:8], *(f"{name} {version}" for name, version in versions.items())])

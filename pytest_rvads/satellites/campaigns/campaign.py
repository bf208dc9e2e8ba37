"""Judges many cases on any executor, and writes each result to disk when it arrives.

A campaign that was interrupted and is started again continues after its last result. A process with other code than the process
that started the campaign refuses to judge.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence, Sized
from concurrent.futures import Executor
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from pytest_rvads.drivers.identity import identity
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.naming import called
from pytest_rvads.drivers.traffic import policy_name
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.check import sentence, unjudged, verdict_by
from pytest_rvads.logic.conduct.kpis import arrival_differences, kpis
from pytest_rvads.logic.rules.book import SHIPPED, get_rule, is_rulebook, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.record import of_run
from pytest_rvads.satellites.campaigns.resultsfile import Head, Judged, Results
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.ids import run_id
from pytest_rvads.simulators.simulator import Choice, Simulator, made_by, simulate
from pytest_rvads.support.decoding import encode
from pytest_rvads.support.errors import FormulaError, RvadsError, ScenarioError, require
from pytest_rvads.support.executors import DIED, ExecutorGone, Failed, Progress, gathered
from pytest_rvads.support.installed import code, versions


@dataclass(frozen=True, slots=True)
class Question:
    """What a campaign uses for every case: its rules and simulator, and the code that workers must have."""

    rules: tuple[str | Rule, ...]
    """The names of shipped rules and rulebooks, and the values of all other rules."""
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


def campaign(
    cases: Iterable[Case],
    rules: str | Rule | Iterable[str | Rule] = "road",
    *,
    executor: Executor | int | None = None,
    results: str | os.PathLike[str] | None = None,
    simulator: Simulator | None = None,
    progress: Progress | None = None,
    total: int | None = None,
) -> Results:
    """Simulate cases and judge every run by all rules, on many processes and machines.

    The results are bit-identical for every executor and for every order in which cases end. A case that can't be simulated or
    judged, or that kills its worker process, gets the verdict ERROR by every rule, and all other cases are judged. A case whose
    worker process died of another cause runs again. A case in which a vehicle has no room at its start is left out and counted.

    Args:
        cases: any number of cases. An iterator is asked for a case only when a process is free, and no case is kept in memory
            after its result.
        rules: rulebooks and rules, as for `check`. Of a rulebook, only the rules about the junction of a case judge its run.
        executor: a number of processes, by default a process per processor; 1 simulates in this process. Or any executor, such
            as the executor of a Dask client; its workers must have this package and the code of the drivers.
        results: the file of results, to which every new result is appended. Cases with a result in the file are not run again,
            so that an interrupted campaign continues. None for a temporary file.
        simulator: the simulator of the runs, as for `simulate`.
        progress: function that is called after every case, with the number of finished cases and the number of all cases.
        total: the number of cases, if `cases` has no length.

    Returns:
        All results in the file, including the results of an earlier call with the same file.

    Raises:
        RvadsError: a case, rule or driver can't be sent to other processes; the executor takes no more work (a second call with
            the same file continues); or the file holds results of another campaign, is in use by another process, or can't be
            written.
        ScenarioError: an element of `cases` is no case.
        FormulaError: a rule is unknown.
    """
    require(cases, Iterable, "a campaign takes cases, any number of rvads.Case(scenario, driver)", ScenarioError)
    choice = Choice.of(simulator)
    remaining = iter(cases)
    first = next(remaining, None)
    keys = Keys(choice)
    question = Question(_portable_rules(rules), choice, code(), versions(*getattr(choice.simulator, "libraries", ())))
    if first is not None:
        require(first, Case, "a campaign takes cases: rvads.Case(scenario, driver)", ScenarioError)
        remaining = chain((first,), remaining)
    if total is None:
        total = len(cases) if isinstance(cases, Sized) else 0
    stored = Results(results, _campaign_head(question, keys, first))
    try:
        _judge_all(remaining, question, keys, stored, executor, progress, total)
    except ExecutorGone as error:
        advice = "no result is kept: a campaign with a file as results= continues after its last result"
        if stored.path is not None:
            advice = (
                f"{len(stored):,} results are kept in {stored.path}: run the campaign again, it continues after these results"
            )
        stored.close()
        raise RvadsError(f"{error}; {advice}") from error
    except BaseException:
        stored.close()
        raise
    stored.release()
    return stored


def continued(
    cases: Iterable[Case],
    rules: Sequence[str | Rule],
    results: Path | None,
    simulator: Simulator,
    executor: Executor | int | None,
    progress: Progress,
    total: int,
) -> tuple[Results | None, KeyboardInterrupt | RvadsError | None]:
    """Judge the cases that an interrupted campaign left; return the results so far, if any, and what cut the campaign short."""
    try:
        judged = campaign(cases, rules, executor=executor, results=results, simulator=simulator, progress=progress, total=total)
    except (KeyboardInterrupt, RvadsError) as stopped:
        return (reopened(results) if results else None), stopped
    return judged, None


def reopened(path: Path) -> Results | None:
    """Return the results so far in a file; None without a result."""
    with suppress(RvadsError, OSError):
        results = Results(path)
        if len(results):
            return results
        results.close()
    return None


def _judge_all(
    cases: Iterator[Case],
    question: Question,
    keys: Keys,
    stored: Results,
    executor: Executor | int | None,
    progress: Progress | None,
    total: int,
) -> None:
    """Judge the cases that have no result yet, and store the results."""
    unfit: Counter[str] = Counter()
    in_flight: dict[int, Job] = {}
    """Jobs that have no answer yet, by the number of the job in the order of sending."""
    asked = finished = 0

    def report_progress() -> None:
        nonlocal finished
        finished += 1
        if progress is not None:
            progress(finished, max(total, asked))

    def jobs() -> Iterator[Job]:
        """Yield a job for each case without a result, and leave out each case in which a vehicle has no room at its start."""
        nonlocal asked
        sent = 0
        for number, case in enumerate(cases):
            require(case, Case, "a campaign takes cases: rvads.Case(scenario, driver)", ScenarioError)
            asked += 1
            try:
                case.starts()
            except ScenarioError:
                unfit[case.scenario.place.name] += 1
                report_progress()
                continue
            key = keys.of(case)
            if stored.holds(key):
                report_progress()
                continue
            driver, traffic = keys.identified(case.driver), case.traffic and keys.identified(case.traffic)
            # The class of the driver with other parameters may drive the traffic, so the two identities need different names.
            identities = {driver.name: driver.identity} | ({f"{traffic.policy} traffic": traffic.identity} if traffic else {})
            changed = next((name for name, own in identities.items() if stored.head.drivers.get(name, own) != own), None)
            if changed is not None:
                raise RvadsError(
                    f"two different drivers of a campaign have the name {changed}: give each driver a name or a campaign of its "
                    "own"
                )
            stored.tell(msgspec.structs.replace(stored.head, drivers=stored.head.drivers | identities, cases=None))
            in_flight[sent] = Job(number, key, case, driver.name, traffic.policy if traffic else None)
            sent += 1
            yield in_flight[sent - 1]

    with closing(gathered(partial(judge, question), jobs(), executor)) as answers:
        for number, answer in answers:
            job = in_flight.pop(number)
            if isinstance(answer, Failed):
                if not answer.lost:
                    raise answer.error
                answer = encode(undecided(question, job, f"the process that simulated it {DIED}"))
            stored.add(answer)
            report_progress()
    end_facts = {"cases": asked, "results": len(stored), "unfit": dict(sorted(unfit.items()))}
    stored.tell(msgspec.structs.replace(stored.head, **end_facts))


def _portable_rules(rules: str | Rule | Iterable[str | Rule]) -> tuple[str | Rule, ...]:
    """Return rules in a form for other processes: shipped rules by name, other rules as parsed rules."""
    require(rules, str | Rule | Iterable, "rules are named one by one, or as a list of names and of Rules", FormulaError)
    parts = (rules,) if isinstance(rules, str | Rule) else tuple(rules)
    rules_for(parts)
    portable_rules: list[str | Rule] = []
    for part in parts:
        rule = None if isinstance(part, str) and is_rulebook(part) else get_rule(part)
        if rule is not None and rule.name not in SHIPPED.rules:
            rule.formula  # noqa: B018 - parses the rule, which stores the words of this process in the rule
            portable_rules.append(rule)
        else:
            portable_rules.append(part if isinstance(part, str) else part.name)
    return tuple(portable_rules)


def _campaign_head(question: Question, keys: Keys, first: Case | None) -> Head:
    """Return the first line of the file of results: what is equal for every case, and the driver of the first case."""
    origins: dict[str, Any] = {
        "package": question.code,
        "rules": _named(question.rules),
        "simulator": f"{question.simulator.name} {identity(question.simulator.simulator)}",
    }
    drivers = {}
    if first is not None:
        driver = keys.identified(first.driver)
        origins |= {"driver": driver.name, "bodies": bodies(first.fleet)}
        drivers[driver.name] = driver.identity
    return Head(made=origins, drivers=drivers, versions=question.versions)


def _named(rules: Iterable[str | Rule]) -> str:
    """Return rules and rulebooks by name, with the identity of rules that are no shipped rules."""
    return ", ".join(rule if isinstance(rule, str) else f"{rule.name} {identity(rule)}" for rule in rules)


def digest(cases: Iterable[Case], rules: Iterable[str | Rule], simulator: Simulator, *more: str) -> str:
    """Return a digest of everything on which the results of a campaign depend, for the name of their file."""
    keys = Keys(simulator)
    parts = [code(), _named(rules), *map(keys.of, cases), *more]
    return sha256("\n".join(parts).encode("utf-8", "surrogatepass")).hexdigest()[:12]


class IdentifiedDriver(NamedTuple):
    """A driver with its name and its identity (a hash that changes if the code or a parameter of the driver changes)."""

    factory: Factory
    """The driver, kept alive so that its id() cannot be reused for another object."""
    name: str
    policy: str
    """Name of the driver in ids if it drives the traffic."""
    identity: str


class Keys:
    """Computes the hash by which the file of results recognises a case; the identity of each driver is computed once."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator.name, identity(Choice.of(simulator).simulator)
        self._drivers: dict[int, IdentifiedDriver] = {}

    def identified(self, driver: Factory) -> IdentifiedDriver:
        """Return a driver with its name and identity; both are computed at the first call for the driver."""
        identified_driver = self._drivers.get(id(driver))
        if identified_driver is None:
            if len(self._drivers) >= 64:  # most campaigns have one driver, and none has thousands
                self._drivers.clear()
            identified_driver = IdentifiedDriver(driver, called(driver), policy_name(driver), identity(driver))
            self._drivers[id(driver)] = identified_driver
        return identified_driver

    def of(self, case: Case) -> str:
        """Return the SHA-256 of everything on which the run of a case depends, without the names of map and code files."""
        scenario = case.scenario
        fields = {**scenario.record(), "map": None, "place": scenario.place.digest}
        drivers = [factory and self.identified(factory)[1:] for factory in (case.driver, case.traffic)]
        key_parts = [fields, drivers, _fleet(case.fleet), self._simulator]
        return sha256(json.dumps(key_parts, sort_keys=True).encode("utf-8", "surrogatepass")).hexdigest()


def bodies(fleet: Fleet) -> str:
    """Return a digest of a fleet (the vehicle parameters of a case)."""
    return sha256(json.dumps(_fleet(fleet), sort_keys=True).encode()).hexdigest()[:12]


def _fleet(fleet: Fleet) -> list[Any]:
    return [asdict(fleet.vehicle), {name: asdict(vehicle) for name, vehicle in fleet.others.items()}]

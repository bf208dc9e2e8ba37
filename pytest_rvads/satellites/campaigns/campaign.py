"""Judges many cases on any executor, with results on disk as they arrive; a campaign that is started again continues."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sized
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import asdict
from functools import partial
from hashlib import sha256
from itertools import chain
from typing import Any, NamedTuple

import msgspec

from pytest_rvads.drivers.identity import identity
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.naming import called
from pytest_rvads.drivers.traffic import policy_name
from pytest_rvads.logic.rules.book import SHIPPED, get_rule, is_rulebook, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.satellites.campaigns.answering import Job, Question, judge, undecided
from pytest_rvads.satellites.campaigns.judged import Head
from pytest_rvads.satellites.campaigns.resultsfile import Results
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.simulators.choice import choice
from pytest_rvads.simulators.simulator import Simulator, meant
from pytest_rvads.support.decoding import encode
from pytest_rvads.support.errors import FormulaError, RvadsError, ScenarioError, require
from pytest_rvads.support.executors import ExecutorGone, Failed, Progress, gathered
from pytest_rvads.support.versions import code, versions

__all__ = ["Keys", "campaign"]

_MOST = 64
"""Most drivers that are cached; a campaign often has one driver, and never thousands."""


def campaign(  # noqa: PLR0913 - keywords; a campaign has many settings
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

    The results are bit-identical for every executor and in every order. A case that can't be simulated or judged, or that ends
    its process, is an ERROR by every rule; the other cases are not affected. A case that was in flight when its process died of
    another cause runs again. A case in which a vehicle has no room at its start is left out, and counted.

    Args:
        cases: any number of cases; they are taken only when a process is free, and not kept.
        rules: rulebooks and rules, as for `check`; of a rulebook only the rules about the junction of the case.
        executor: a number of processes, by default one per processor; 1 is this process. Or any executor, such as that of a Dask
            client, whose workers have this package and the code of the drivers.
        results: the file of results, to which every new result is appended. Cases with a result in the file are not run again,
            so that an interrupted campaign continues. None for a temporary file.
        simulator: the simulator of the runs, as for `simulate`.
        progress: called after every case, with the number of finished cases and the number of all cases.
        total: the number of cases, if `cases` has no length.

    Returns:
        All results in the file, including the results of an earlier call with the same file.

    Raises:
        RvadsError: a case, rule or driver can't be sent to other processes, the executor is gone (a second call with the same
            file continues), or the file holds results of another campaign, is in use by another process, or can't be written.
        ScenarioError: an element of `cases` is no case.
        FormulaError: a rule is unknown.
    """
    require(cases, Iterable, "a campaign takes cases, any number of rvads.Case(scenario, driver)", ScenarioError)
    maker = meant(simulator)
    remaining = iter(cases)
    first = next(remaining, None)
    keys = Keys(maker)
    question = Question(_asked(rules), maker, choice().limits, code(), versions(*_libraries(maker)))
    if first is not None:
        require(first, Case, "a campaign takes cases: rvads.Case(scenario, driver)", ScenarioError)
        remaining = chain((first,), remaining)
    if total is None:
        total = len(cases) if isinstance(cases, Sized) else 0
    stored = Results(results, _head(question, keys, first))
    try:
        _Campaign(question, keys, stored, progress, total).run(remaining, executor)
    except ExecutorGone as error:
        advice = "nothing is kept, name a file as results= to go on where it was"
        if stored.path is not None:
            advice = f"{len(stored):,} results are kept in {stored.path}, run the campaign again and it goes on where it was"
        stored.close()
        raise RvadsError(f"{error}; {advice}") from error
    except BaseException:
        stored.close()
        raise
    stored.release()
    return stored


class _Campaign:
    """The state of a running campaign."""

    def __init__(self, question: Question, keys: Keys, results: Results, progress: Progress | None, total: int) -> None:
        self._question, self._keys, self._results = question, keys, results
        self._progress, self._total = progress, total
        self._cases = self._done = self._sent = 0
        self._unfit: Counter[str] = Counter()
        self._away: dict[int, Job] = {}
        """Jobs in flight, by their number in the order of sending."""

    def run(self, cases: Iterator[Case], executor: Executor | int | None) -> None:
        """Judge the cases that have no result yet."""
        with closing(gathered(partial(judge, self._question), self._jobs(cases), executor)) as answers:
            for number, answer in answers:
                job = self._away.pop(number)
                if isinstance(answer, Failed):
                    if not answer.lost:
                        raise answer.error
                    answer = encode(
                        undecided(self._question, job, "the process that simulated it died, perhaps for lack of memory")
                    )
                self._results.add(answer)
                self._tell()
        ended = {"cases": self._cases, "results": len(self._results), "unfit": dict(sorted(self._unfit.items()))}
        self._results.tell(msgspec.structs.replace(self._results.head, **ended))

    def _jobs(self, cases: Iterator[Case]) -> Iterator[Job]:
        """Yield the cases that fit and have no result yet."""
        for number, case in enumerate(cases):
            require(case, Case, "a campaign takes cases: rvads.Case(scenario, driver)", ScenarioError)
            self._cases += 1
            try:
                case.starts()
            except ScenarioError:
                self._unfit[case.scenario.place.name] += 1
                self._tell()
                continue
            key = self._keys.of(case)
            if self._results.holds(key):
                self._tell()
                continue
            job = Job(number, key, case, *self._named(case))
            self._away[self._sent] = job
            self._sent += 1
            yield job

    def _named(self, case: Case) -> tuple[str, str | None]:
        """Return the names of the driver and the traffic, and register both in the file of results."""
        head = self._results.head
        driver, traffic = self._keys.known(case.driver), case.traffic and self._keys.known(case.traffic)
        # A policy may be the driver's class with other numbers, so it has another name.
        identities = {driver.name: driver.identity} | ({f"{traffic.policy} traffic": traffic.identity} if traffic else {})
        changed = next((name for name, key in identities.items() if head.drivers.get(name, key) != key), None)
        if changed is not None:
            raise RvadsError(
                f"two drivers of a campaign are called {changed} and are not the same: give each a name of its own, or a campaign"
            )
        self._results.tell(msgspec.structs.replace(head, drivers=head.drivers | identities, cases=None))
        return driver.name, traffic.policy if traffic else None

    def _tell(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, max(self._total, self._cases))


def _asked(rules: str | Rule | Iterable[str | Rule]) -> tuple[str | Rule, ...]:
    """Return rules in a form for other processes: shipped rules by name, other rules as parsed rules."""
    require(rules, str | Rule | Iterable, "rules are named one by one, or as a list of names and of Rules", FormulaError)
    parts = (rules,) if isinstance(rules, str | Rule) else tuple(rules)
    rules_for(parts)
    asked: list[str | Rule] = []
    for part in parts:
        rule = None if isinstance(part, str) and is_rulebook(part) else get_rule(part)
        if rule is not None and rule.name not in SHIPPED.rules:
            rule.formula  # noqa: B018 - parses the rule, which stores the words known here
            asked.append(rule)
        else:
            asked.append(part if isinstance(part, str) else part.name)
    return tuple(asked)


def _libraries(simulator: Simulator) -> tuple[str, ...]:
    return tuple(getattr(simulator, "libraries", ()))


def _head(question: Question, keys: Keys, first: Case | None) -> Head:
    """Return the head of the results: everything that is the same for every case, and the driver of the first case."""
    origins: dict[str, Any] = {
        "package": question.code,
        "rules": ", ".join(rule if isinstance(rule, str) else f"{rule.name} {identity(rule)}" for rule in question.rules),
        "simulator": f"{question.simulator.name} {identity(question.simulator)}",
    }
    drivers = {}
    if first is not None:
        driver = keys.known(first.driver)
        origins |= {"driver": driver.name, "bodies": bodies(first.fleet)}
        drivers[driver.name] = driver.identity
    return Head(made=origins, drivers=drivers, versions=question.versions)


class Known(NamedTuple):
    """Name and identity of a driver."""

    made: Factory
    """The driver, kept alive so that its id() cannot be reused for another object."""
    name: str
    policy: str
    """Name of the driver in ids if it drives the traffic."""
    identity: str


class Keys:
    """Computes the hashes of cases; names and identities of drivers are computed once."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator.name, identity(simulator)
        self._known: dict[int, Known] = {}

    def known(self, driver: Factory) -> Known:
        """Return name and identity of a driver."""
        known_driver = self._known.get(id(driver))
        if known_driver is None:
            if len(self._known) >= _MOST:
                self._known.clear()
            known_driver = Known(driver, called(driver), policy_name(driver), identity(driver))
            self._known[id(driver)] = known_driver
        return known_driver

    def of(self, case: Case) -> str:
        """Return the SHA-256 of everything that decides the run of a case, without the path of its map and names of files."""
        scenario = case.scenario
        fields = {**scenario.record(), "map": None, "place": scenario.place.digest}
        drivers = [factory and self.known(factory)[1:] for factory in (case.driver, case.traffic)]
        whole = [fields, drivers, _fleet(case.fleet), self._simulator]
        return sha256(json.dumps(whole, sort_keys=True).encode("utf-8", "surrogatepass")).hexdigest()


def bodies(fleet: Fleet) -> str:
    """Return a digest of a fleet."""
    return sha256(json.dumps(_fleet(fleet), sort_keys=True).encode()).hexdigest()[:12]


def _fleet(fleet: Fleet) -> list[Any]:
    return [asdict(fleet.vehicle), {name: asdict(vehicle) for name, vehicle in fleet.others.items()}]

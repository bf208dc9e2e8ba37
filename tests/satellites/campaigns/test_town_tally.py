"""What comes of a junction, summed up: the same whatever the order, in memory that does not grow with runs."""

from itertools import permutations

import pytest
from msgspec import structs

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.satellites.campaigns.resultsfile import Judged
from pytest_rvads.satellites.campaigns.town_tally import Tally, cell


def result(name: str, *outcomes: Outcome, violated: str = "a left too early", cfg: str = "A") -> Judged:
    """A run with a verdict of rules r0, r1, ... each, the later the rule the later violated."""
    verdicts = tuple(
        Verdict(
            f"r{k}",
            Status(outcome.value),
            f"r{k} {outcome}",
            time=float(k) if outcome is Outcome.FAIL else None,
            violated=f"{violated} (r{k})" if outcome is Outcome.FAIL else "",
            roles="a right from entrance +0" if outcome is Outcome.FAIL else "",
        )
        for k, outcome in enumerate(outcomes)
    )
    return Judged(
        case=name,
        nodeid=name,
        junction="town.1",
        control="stop",
        ways=3,
        cls=1,
        scenario="111",
        cfg=cfg,
        driver="d",
        simulator="s",
        hash=name,
        verdicts=verdicts,
    )


def of(*results: Judged) -> Tally:
    found = Tally()
    for one in results:
        found.add(one)
    return found


@pytest.mark.parametrize(
    ("outcomes", "mark"),
    [
        ((Outcome.PASS, Outcome.NA), "good"),
        ((Outcome.PASS, Outcome.FAIL), "bad"),
        ((Outcome.FAIL, Outcome.ERROR), "bad"),
        ((Outcome.OPEN, Outcome.ERROR), "error"),
        ((Outcome.PASS, Outcome.OPEN), "doubt"),
        ((Outcome.PASS, Outcome.UNSURE), "doubt"),
        ((Outcome.NA,), "none"),
    ],
)
def test_a_junction_is_marked_by_the_worst_that_happened(outcomes: tuple[Outcome, ...], mark: str) -> None:
    assert of(*(result(f"run{k}", outcome) for k, outcome in enumerate(outcomes))).mark == mark


def test_nothing_is_neither_good_nor_bad() -> None:
    assert Tally().mark == "none"


def test_what_broke_first_explains_the_rest_of_its_run() -> None:
    tally = of(result("run", Outcome.PASS, Outcome.FAIL, Outcome.FAIL))
    ((title, (cause,)),) = tally.grouped()
    assert title == "causes of failures"
    assert (cause.text, cause.rule, cause.count, cause.rules) == ("a left too early (r1)", "r1", 2, ("r1", "r2"))


def test_a_fault_is_one_cause_whatever_rules_would_have_judged() -> None:
    verdicts = tuple(Verdict(rule, Status.ERROR, f"{rule} ERROR: it broke", reason="it broke") for rule in "pq")
    ((_, (cause,)),) = of(structs.replace(result("run"), verdicts=verdicts)).grouped()
    assert (cause.text, cause.count, cause.rules) == ("it broke", 2, ("p", "q"))


def test_the_order_of_results_does_not_matter() -> None:
    results = [
        result("run1", Outcome.FAIL, Outcome.PASS),
        result("run2", Outcome.FAIL, Outcome.FAIL),
        result("run3", Outcome.PASS, Outcome.FAIL, violated="a never stopped"),
        result("run4", Outcome.ERROR, Outcome.ERROR),
    ]
    told = [(tally.text, [*tally.grouped()]) for tally in (of(*order) for order in permutations(results))]
    assert all(one == told[0] for one in told)
    causes = [cause for _, group in told[0][1] for cause in group]
    assert [cause.run for cause in causes if "left" in cause.text or "stopped" in cause.text] == ["run1", "run3"]


def test_causes_beyond_the_hundredth_are_counted() -> None:
    tally = of(*(result(f"run{k:03}", Outcome.FAIL, violated=f"cause {k}") for k in range(130)))
    assert len(tally.causes) == 100
    assert tally.unlisted == 30
    assert tally.text == "130 fail"


@pytest.mark.parametrize(
    ("counts", "shown"),
    [
        ({}, ("", "none")),
        ({Outcome.PASS: 3}, ("pass", "good")),
        ({Outcome.PASS: 3, Outcome.FAIL: 1}, ("1/4 fail", "bad")),
        ({Outcome.FAIL: 2}, ("FAIL", "bad")),
        ({Outcome.NA: 1, Outcome.PASS: 2}, ("2/3 pass", "good")),
    ],
)
def test_a_cell_tells_the_worst_with_its_share(counts: dict[Outcome, int], shown: tuple[str, str]) -> None:
    from collections import Counter

    assert cell(Counter(counts)) == shown

"""What the package knows about a word is part of the word: a copy of a word under another name serves alike."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pytest_rvads.logic.check import check
from pytest_rvads.logic.rules.book import rulebook
from pytest_rvads.logic.rules.lexicon import BUILT_IN
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Excerpt, Run
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor

Make = Callable[..., Run]
GREEN, RED = Colour.GREEN, Colour.RED
COPIES = {name: replace(word, name=f"copied_{name}", place="here:1") for name, word in BUILT_IN.items() if word.says}
RULES = [rule for rule in rulebook("road") if any(f"{name}(" in rule.text for name in COPIES)]


def copied(rule: Rule) -> Rule:
    """Return a rule in which every word that has a name of letters is a copy under another name."""
    text = re.sub(r"\b(\w+)\(", lambda match: f"copied_{match[0]}" if match[1] in COPIES else match[0], rule.text)
    return replace(
        rule,
        name=f"copied_{rule.name}",
        text=text,
        words=tuple(word for word in COPIES.values() if f"{word.name}(" in text),
        place="here:1",
    )


@pytest.fixture(scope="module")
def runs(drive: Make) -> dict[str, Run]:
    """Vehicles that roll through, stand in the junction, touch, wait in vain and vanish; the second run is known to 10 cm."""
    ways = {
        0: (2, -6.0, [(0, 4.0), (110, 0.05), (120, 4.0), (500, 0.0), (940, 3.0)]),
        1: (1, -1.5, [(0, 5.0)], 1.4),
        2: (3, -0.8, [(0, 0.0), (60, 6.0), (200, 13.0)]),
        3: (2, -3.0, [(0, 1.0), (200, 0.0), (1500, 5.0)]),
    }
    lights = {e: [(0, RED if e % 2 else GREEN), (400, GREEN if e % 2 else RED)] for e in range(4)}
    stop, light = drive("stop4", ways, 1600), drive("light4", ways, 1600, lights, [(310, "a0", "a2")])
    known = Excerpt(position_accuracy=0.1, speed_accuracy=0.3)
    return {"stop": stop, "light": light, "measured": replace(stop, excerpt=known, spread=np.full(stop.zone.shape, 0.3))}


def answers(run: Run, rule: Rule) -> list[str]:
    """Return what a verdict says, with words under their first names, and columns as narrow as can be."""
    verdict = check(run, rule)
    texts = (verdict.status, verdict.responsible, verdict.message, verdict.notes, verdict.explanation, verdict.instances)
    return [" ".join(str(text).replace("copied_", "").split()) for text in texts]


@pytest.mark.parametrize("rule", RULES, ids=[rule.name for rule in RULES])
def test_verdict_by_copied_words(runs: dict[str, Run], rule: Rule) -> None:
    for run in runs.values():
        assert answers(run, copied(rule)) == answers(run, rule)


def test_runs_in_which_words_have_consequences(runs: dict[str, Run]) -> None:
    """In these runs a vehicle is to blame alone, and other readings of what was measured say something else."""
    assert len(check(runs["light"], "no_collision").responsible) == 1
    unsure = {rule.name for rule in RULES if check(runs["measured"], rule).status == "UNSURE"}
    assert unsure >= {"full_stop", "first_come", "right_first"}


def test_live_verdict_by_copied_words(runs: dict[str, Run]) -> None:
    run = runs["light"]
    rules = [rule for rule in RULES if rule.concerns(run.junction)]
    pair = [RuleMonitor(of, run.junction, run.agents, dt=0.1, speed_limit=13.0) for of in (rules, list(map(copied, rules)))]
    motion = {name: run.need(name) for name in ("station", "speed", "pose")}
    for tick in range(0, run.steps, 10):
        for monitor in pair:
            monitor.step(run.zone[tick], run.lights[tick], **{name: array[tick] for name, array in motion.items()})
        assert list(pair[0].verdicts.values()) == list(pair[1].verdicts.values()), tick
    assert {str(truth) for truth in pair[0].verdicts.values()} >= {"F", "?"}

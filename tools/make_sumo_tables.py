"""Write the tables of docs/sumo.md: which rules SUMO's driver breaks, junction by junction and class by class.

Run it as ``python tools/make_sumo_tables.py``; it takes two minutes. Tables stand between comments with the name of a junction.
"""

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import pytest_rvads as rvads
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.rulebooks import PAPER, ROAD
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.selection import Selection

PAGE = Path(__file__).parents[1] / "docs" / "sumo.md"
PLACES = ("stop4", "stop3", "light4", "yield4", "right4")
GRID = "ACDE"
SEEDS = range(3)
VARIANTS = "seeds"
"""Name of the table of other seeds, and of no dawdling."""
BROKEN = ("FAIL", "OPEN")
Verdicts = dict[tuple[str, int, str], rvads.Verdict]
"""By rule, class and configuration."""


def judged(place: str, rules: Iterable[Rule], simulator: rvads.Sumo = rvads.sumo, seed: int = 0) -> Verdicts:
    """Judge every class of a junction, with SUMO's driver everywhere."""
    junction = rvads.find(place)
    points = grid(GRID, len(junction.entrances), junction.control)
    found = {}
    for scenario in Selection(junction, points, senses=(rvads.Senses(seed=seed),)):
        run = rvads.simulate(rvads.Case(scenario, rvads.traffic("sumo")), simulator)
        for rule in rules:
            found[rule.name, scenario.number, scenario.configuration] = rvads.check(run, rule)
    return found


def rules_of(place: str) -> list[Rule]:
    """Return the rules of the paper and of the road that concern a junction."""
    control = rvads.find(place).control
    return [rule for rule in (*PAPER, *ROAD) if rule.concerns(control)]


def totals(verdicts: Verdicts) -> list[str]:
    """Return how often every rule is broken, kept, and asks for nothing; in brackets how often nobody could have kept it."""
    names = list(dict.fromkeys(name for name, _, _ in verdicts))
    lines = ["| rule | broken | kept | NA |", "|---|---|---|---|"]
    for name in names:
        of = [verdict for (rule, _, _), verdict in verdicts.items() if rule == name]
        count = Counter("broken" if verdict.status in BROKEN else str(verdict.status) for verdict in of)
        assert sum(count[key] for key in ("broken", "PASS", "NA")) == len(of)
        helpless = sum(verdict.unavoidable for verdict in of)
        lines.append(f"| `{name}` | {count['broken']}{f' ({helpless})' if helpless else ''} | {count['PASS']} | {count['NA']} |")
    return lines


def by_class(place: str, verdicts: Verdicts) -> list[str]:
    """Return per class in which configurations each rule is broken that is broken at all."""
    names = [
        name
        for name in dict.fromkeys(n for n, _, _ in verdicts)
        if any(v.status in BROKEN for (n, _, _), v in verdicts.items() if n == name)
    ]
    if not names:
        return []
    lines = [f"| class | {' | '.join(f'`{name}`' for name in names)} |", "|---" * (len(names) + 1) + "|"]
    orbits = Selection(rvads.find(place), ()).orbits
    for number, code in enumerate(orbits, start=1):
        cells = []
        for name in names:
            of = {point: verdicts[name, number, point] for point in GRID}
            broken = "".join(point for point, verdict in of.items() if verdict.status in BROKEN)
            cells.append(broken or ("-" if any(v.status == "PASS" for v in of.values()) else "NA"))
        lines.append(f"| {number:02d} {''.join(map(str, code))} | {' | '.join(cells)} |")
    return lines


def variants() -> list[str]:
    """Return how often the rules of the all-way stop are broken with other seeds, and without dawdling."""
    rules = [rule for rule in rules_of("stop4") if rule.name in ("p1", "p2", "p3", "full_stop", "right_first", "no_conflict")]
    tried = [(f"seed {seed}", rvads.sumo, seed) for seed in SEEDS] + [("`Sumo(sigma=0)`", rvads.Sumo(sigma=0), 0)]
    lines = [f"| | {' | '.join(f'`{rule.name}`' for rule in rules)} |", "|---" * (len(rules) + 1) + "|"]
    for label, simulator, seed in tried:
        verdicts = judged("stop4", rules, simulator, seed)
        counts = Counter(name for (name, _, _), verdict in verdicts.items() if verdict.status in BROKEN)
        lines.append(f"| {label} | {' | '.join(str(counts[rule.name]) for rule in rules)} |")
    return lines


def written(page: str, name: str, lines: Iterable[str]) -> str:
    """Return the page with other lines between the comments of that name."""
    block = "".join(f"{line}\n" for line in lines)
    return re.sub(rf"(<!-- {name} -->\n).*?(<!-- end -->)", rf"\g<1>{block}\g<2>", page, flags=re.DOTALL)


def main() -> None:
    """Write all tables."""
    page = PAGE.read_text(encoding="utf-8")
    for place in PLACES:
        verdicts = judged(place, rules_of(place))
        page = written(page, place, totals(verdicts))
        page = written(page, f"{place} by class", by_class(place, verdicts))
    PAGE.write_text(written(page, VARIANTS, variants()), encoding="utf-8")


if __name__ == "__main__":
    main()

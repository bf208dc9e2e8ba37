"""``rvads rules check``: checks whether vehicles can obey the rules in every scenario."""

from __future__ import annotations

import argparse
from functools import partial

from pytest_rvads.cli.common import progress, say
from pytest_rvads.errors import ScenarioError

__all__ = ["declare"]

_JUNCTIONS = {("stop", 3): "stop3", ("stop", 4): "stop4", ("lights", 3): "light3", ("lights", 4): "light4"}


def declare(rules: argparse.ArgumentParser) -> None:
    """Add ``check`` to the command ``rules``."""
    commands = rules.add_subparsers(metavar="COMMAND")
    check = commands.add_parser(
        "check",
        help="find scenarios and orders of arrival in which nobody can obey the rules",
        description="Find scenarios and orders of arrival in which no behaviour satisfies all rules and lets everyone through; "
        "exit status 1 if there are any.",
    )
    check.add_argument(
        "--rules",
        action="append",
        default=argparse.SUPPRESS,
        metavar="RULE",
        help="a rule, rulebook or file of rules, may be repeated (default: paper)",
    )
    check.add_argument("--ways", type=int, choices=(3, 4), default=4, help="entrances of the junction (default: 4)")
    check.add_argument("--control", choices=("stop", "lights"), help="of the junction (default: both)")
    check.add_argument("--scenario", metavar="DIRECTIONS", help="one scenario, such as 1133; 0 where nobody stands")
    check.add_argument("--arrivals", metavar="SECONDS", help="one order of arrival: a time per entrance, such as 0,0,0.4,2")
    check.set_defaults(command=_check)


def _check(options: argparse.Namespace) -> int:
    from pytest_rvads.cli.answers import named_rules
    from pytest_rvads.junctions.finder import find
    from pytest_rvads.maps.control import JunctionControl
    from pytest_rvads.scenarios.classes import parse
    from pytest_rvads.search.survey import show, survey

    rules = named_rules(options.rules or ["paper"])
    code = parse(options.scenario) if options.scenario else None
    if code and len(code) != options.ways:
        raise ScenarioError(f"scenario {options.scenario!r} names {len(code)} entrances, expected {options.ways}: see --ways")
    arrivals = _times(options.arrivals) if options.arrivals else None
    found = False
    for control in (options.control,) if options.control else ("stop", "lights"):
        about = [rule for rule in rules if rule.concerns(JunctionControl(control))]
        if about:
            result = survey(
                find(_JUNCTIONS[control, options.ways]),
                about,
                scenarios=[code] if code else None,
                arrivals=arrivals,
                progress=partial(progress, what="pairs"),
            )
            say(show(result))
            found = found or bool(result.contradictions)
    return 1 if found else 0


def _times(text: str) -> list[float]:
    try:
        times = [float(part) for part in text.split(",")]
    except ValueError:
        times = [-1.0]
    if not all(0 <= time < 3600 for time in times):
        raise ScenarioError(f"--arrivals takes times in seconds, one per entrance, such as 0,0,0.4,2, got {text!r}")
    return times

"""Verdicts of monitors on words, and monitors shown to people and tools."""

import re
import time
from collections.abc import Callable
from itertools import combinations

import pytest

from pytest_rvads.cli.check_commands import list_rules
from pytest_rvads.logic.ltl.export import describe, to_dot
from pytest_rvads.logic.ltl.ltl3 import Machine, Monitor, Truth, synthesize
from pytest_rvads.logic.ltl.parser import parse_ltl
from pytest_rvads.logic.rules.rulebooks import PAPER, ROAD, VARIANTS
from pytest_rvads.support.errors import FormulaError
from tests.words import holds_on, verdicts_on


def ask(formula: str, *words: str) -> dict[str, object]:
    """Words are written like ``p,q | | q``: states between bars."""
    given = [[[p for p in state.strip().split(",") if p] for state in word.split("|")] for word in words]
    tree = parse_ltl(formula)
    machine = synthesize(tree)
    return {
        "states": machine.states,
        "verdicts": [[str(verdict) for verdict in verdicts_on(machine, word)] for word in given],
        "finite": [holds_on(tree, word) for word in given],
    }


def test_words_have_size_verdicts_and_finite_values() -> None:
    assert ask("[](p -> q U r)", "p,q|q|r", "p,q|", "q,r|p,q") == {
        "states": 3,
        "verdicts": [["?", "?", "?"], ["?", "F"], ["?", "?"]],
        "finite": [True, False, False],
    }


@pytest.mark.parametrize(
    ("formula", "word", "verdicts", "finite"),
    [
        ("p U q", "", "F", False),
        ("p U q", "p|p", "??", False),
        ("p W q", "p|p", "??", True),
        ("q R p", "p|p", "??", True),
        ("F p", "q|p|", "?TT", True),
        ("G p", "p|p", "??", True),
        ("X p", "q", "?", False),
        ("!X p", "q", "?", True),
        ("X true", "q", "T", False),
        ("G F p", "p|p", "??", True),
        ("p & !p", "p", "F", False),
        ("t U f & r", "f,r", "T", True),
    ],
)
def test_verdicts_and_finite_values_by_hand(formula: str, word: str, verdicts: str, finite: bool) -> None:
    got = ask(formula, word)
    assert (got["verdicts"], got["finite"]) == ([list(verdicts)], [finite])


def test_empty_word_has_no_verdicts_and_weak_formulas_hold() -> None:
    assert verdicts_on(synthesize(parse_ltl("G p")), []) == []
    assert holds_on(parse_ltl("G p"), [])
    assert not holds_on(parse_ltl("F p | X p | p U p | p"), [])


@pytest.mark.parametrize(
    "text",
    [
        "G p & F !p",
        "X(G p & F !p)",
        "F G p & G F !p",
        "F(G p & G F !p)",
        "(p U q) & G !q",
        "X q | X !q & !X(G p & F !p)",
        "G(p & X !p)",
        "G(p -> X !p) & G(!p -> X p) & F G p",
        "X(G p & F !p) | X(q & (r U s) & X(G p & F !p))",
    ],
)
def test_contradictions_are_seen_at_once(text: str) -> None:
    # The sixth is a tautology.
    wanted = "T" if text.startswith("X q") else "F"
    assert ask(text, "p|q")["states"] == 1
    assert ask(text, "p|q")["verdicts"] == [[wanted, wanted]]
    negation = {"T": "F", "F": "T"}[wanted]
    assert ask(f"!({text})", "p|q")["verdicts"] == [[negation, negation]]


def test_a_blow_up_is_refused_with_the_size() -> None:
    # The least monitor of this formula has to remember the last 13 values of p: more than 2^13 states.
    formula = parse_ltl("G(p -> " + "X " * 13 + "q)")
    start = time.process_time()
    with pytest.raises(FormulaError, match=r"of size 17, needs a monitor too large to build"):
        synthesize(formula)
    assert time.process_time() - start < 5


@pytest.mark.parametrize(
    "text",
    [
        " & ".join(f"G p{i}" for i in range(2000)),
        " & ".join(f"(a{i} | b{i})" for i in range(900)),
        " U ".join(f"p{i}" for i in range(100)),
        " <-> ".join(f"F p{i}" for i in range(12)),
        "G F " * 70 + "p",
        " ^ ".join(f"X X X (p{i} U q)" for i in range(9)),
    ],
    ids=["many always", "wide guard", "chain of until", "equivalences", "deep", "exclusive"],
)
def test_large_formulas_are_refused_not_left_to_run(text: str) -> None:
    start = time.process_time()
    with pytest.raises(FormulaError, match="split it into"):
        synthesize(parse_ltl(text))
    assert time.process_time() - start < 5


@pytest.mark.parametrize(
    ("text", "states"),
    [
        (" <-> ".join(f"p{i}" for i in range(140)), 3),
        (" <-> ".join("(a U X b)" for _ in range(60)), 1),
        ("X " * 140 + "p", 143),
        ("(" * 40 + "a" + " U b)" * 40, 3),
    ],
    ids=["parity", "the same on both sides", "next", "nested until"],
)
def test_large_formulas_with_small_monitors_are_answered(text: str, states: int) -> None:
    assert synthesize(parse_ltl(text)).states == states


def test_wide_guards_are_no_blow_up() -> None:
    machine = synthesize(parse_ltl("(" + " | ".join(f"p{i}" for i in range(40)) + ") U q"))
    assert (machine.states, len(machine.codes)) == (3, 4)


def test_a_monitor_of_many_guards_reads_every_state() -> None:
    """More guards than a table of their codes has room for: in state k exactly one of the k-th pair of propositions holds."""
    pairs = list(combinations("abcdefg", 2))[:17]
    text = " & ".join("X " * k + f"({one} ^ {two})" for k, (one, two) in enumerate(pairs))
    machine = synthesize(parse_ltl(text))
    assert len(machine.guards) == 17
    kept = "|".join(pair[k % 2] for k, pair in enumerate(pairs))
    assert ask(text, kept)["verdicts"] == [["?"] * 16 + ["T"]]
    for k, pair in enumerate(pairs):
        broken = "|".join(",".join(pair) if i == k else other[0] for i, other in enumerate(pairs))
        verdicts = ["?"] * k + ["F"] * (17 - k)
        assert ask(text, broken)["verdicts"] == [verdicts]
        monitor = Monitor(machine)
        assert [str(monitor.step(state.split(","))) for state in broken.split("|")] == verdicts


@pytest.mark.parametrize("text", ["p <-> q", "G(p -> q)", "(p ^ q) U r", "p & q | !r", "!(d | e) U c"])
def test_guards_of_every_form_are_exported(text: str) -> None:
    machine = synthesize(parse_ltl(text))
    names = [str(a) for a in machine.atoms]
    edges = re.findall(r'^  0 -> (\d+) \[label="(.*)"\];$', to_dot(machine), re.MULTILINE)
    for letter in range(1 << len(names)):
        state = [name for k, name in enumerate(names) if letter >> k & 1]
        (target,) = [int(target) for target, guard in edges if holds_on(parse_ltl(guard), [state])]
        assert Truth(int(machine.output[target])) is Monitor(machine).step(state)


def test_machines_are_values() -> None:
    machine = synthesize(parse_ltl("p U q"))
    for array in (machine.delta, machine.output):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_the_exported_texts_are_whole() -> None:
    machine = synthesize(parse_ltl("p U q"))
    assert to_dot(machine).splitlines() == [
        "digraph monitor {",
        "  rankdir=LR;",
        '  node [shape=circle, style=filled, fontname="sans-serif"];',
        '  start [shape=point, style=""]; start -> 0;',
        '  0 [label="0\\n?", fillcolor="#ffffff"];',
        '  1 [label="1\\nF", fillcolor="#f4b6b6"];',
        '  2 [label="2\\nT", fillcolor="#b9e3b9"];',
        '  0 -> 0 [label="p & !q"];',
        '  0 -> 1 [label="!p & !q"];',
        '  0 -> 2 [label="q"];',
        '  1 -> 1 [label="true"];',
        '  2 -> 2 [label="true"];',
        "}",
    ]


def test_a_monitor_is_shown_in_words() -> None:
    assert describe(synthesize(parse_ltl("p U q"))).splitlines() == [
        "formula       p U q",
        "propositions  p, q",
        "states        3, the smallest monitor there is; it starts in 0",
        "0  ?  still undecided",
        "     stays when p & !q",
        "     to 1 when !p & !q",
        "     to 2 when q",
        "1  F  no continuation satisfies the formula",
        "     stays when true",
        "2  T  every continuation satisfies the formula",
        "     stays when true",
    ]


def test_the_list_of_rules_names_every_rule_with_its_source() -> None:
    text = list_rules()
    for name in ("p1", "p6g", "full_stop", "right_on_red", "speed_limit"):
        assert f"\n  {name}  " in text
    assert "\n      No two vehicles touch.\n" in text
    assert text.count("responsible:") == text.count("source:") == len((*PAPER, *VARIANTS, *ROAD))


@pytest.mark.parametrize("write", [describe, to_dot])
def test_too_large_monitor_is_refused_with_its_size(write: Callable[[Machine], str]) -> None:
    machine = synthesize(parse_ltl(" ^ ".join(f"(p{i} U q{i})" for i in range(5))))
    with pytest.raises(FormulaError, match="63 states and 845 edges over 1024 letters, too many to be written out"):
        write(machine)

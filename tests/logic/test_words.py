"""Questions about words, as ``rvads monitor --jsonl`` asks them, and monitors shown to people and tools."""

import json
import time
from collections.abc import Callable
from itertools import combinations

import pytest

from pytest_rvads.cli.check_commands import list_rules
from pytest_rvads.logic.ltl.export import answer, describe, to_dot, to_hoa
from pytest_rvads.logic.ltl.ltl3 import Machine, Monitor, Truth, synthesize
from pytest_rvads.logic.ltl.parser import parse_ltl
from pytest_rvads.logic.rules.rulebooks import PAPER, ROAD, VARIANTS
from pytest_rvads.support.errors import FormulaError


def ask(formula: str, *words: str, name: object = 1) -> dict[str, object]:
    """Words are written like ``p,q | | q``: states between bars."""
    given = [[[p for p in state.strip().split(",") if p] for state in word.split("|")] for word in words]
    return answer(json.dumps({"id": name, "formula": formula, "words": given}).encode())


def test_an_answer_has_size_verdicts_and_finite_values() -> None:
    assert ask("[](p -> q U r)", "p,q|q|r", "p,q|", "q,r|p,q", name="x7") == {
        "id": "x7",
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
    assert ask(formula, word) == {"id": 1, "states": synthesize(parse_ltl(formula)).states} | {
        "verdicts": [list(verdicts)],
        "finite": [finite],
    }


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


def test_an_empty_word_has_no_verdicts_and_weak_formulas_hold() -> None:
    line = json.dumps({"id": 1, "formula": "G p", "words": [[]]}).encode()
    assert answer(line) == {"id": 1, "states": 2, "verdicts": [[]], "finite": [True]}
    assert answer(line.replace(b"G p", b"F p | X p | p U p | p"))["finite"] == [False]


@pytest.mark.parametrize(
    ("line", "name", "message"),
    [
        ("nonsense", None, "task: not JSON: "),
        ("[1]", None, "task: it must be an object, got [1]"),
        ('{"id": 4}', 4, "task: the field 'formula' is missing"),
        ('{"id": 4, "formula": null}', 4, "task: the field 'formula' must be a text, got None"),
        ('{"id": NaN, "formula": "p"}', None, "task: not JSON: "),
        ('{"id": -Infinity, "formula": "p"}', None, "task: not JSON: "),
        ('{"id": 1e999, "formula": "p"}', None, "task: not JSON: "),
        ('{"id": "\\ud800", "formula": "p"}', None, "task: not JSON: "),
        ('{"id": "\ud800", "formula": "p"}', None, "task: not JSON: "),
        ('{"id": 4, "formula": "p", "words": 7}', 4, "task: the field 'words' must be a list, got 7"),
        ('{"id": 4, "formula": "p", "words": NaN}', None, "task: not JSON: "),
        ('{"id": 4, "formula": "\x1b"}', None, "task: not JSON: "),
        (
            '{"id": [4], "formula": "p"}',
            None,
            "task: the field 'id' must be a whole number or a number or a text or null, got [4]",
        ),
        ('{"id": 4, "formula": "p \\u202e"}', 4, "unexpected '\\u202e'"),
        ('{"id": 4, "formula": "p &", "words": []}', 4, "unexpected the end, expected a formula"),
        ('{"id": 4, "formula": "p", "words": [["p"]]}', 4, "the field 'words[0][0]' must be a list, got 'p'"),
        ('{"id": 4, "formula": "' + "&".join(f"F p{i}" for i in range(12)) + '", "words": []}', 4, "valuations"),
        ("[" * 100_000, None, "task: not JSON: "),
    ],
)
def test_what_cannot_be_answered_says_why(line: str, name: object, message: str) -> None:
    got = answer(line.encode("utf-8", "surrogatepass"))
    assert got.keys() == {"id", "error"}
    assert got["id"] == name
    assert message in got["error"]
    json.dumps(got, allow_nan=False, ensure_ascii=False).encode()


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


def test_hoa_and_dot_say_the_same_machine() -> None:
    machine = synthesize(parse_ltl("!(d | e) U c"))
    hoa = to_hoa(machine).splitlines()
    assert hoa[0] == "HOA: v1"
    assert 'AP: 3 "d" "e" "c"' in hoa
    body = hoa[hoa.index("--BODY--") + 1 : hoa.index("--END--")]
    assert [line for line in body if line.startswith("State")] == ['State: 0 "?"', 'State: 1 "F"', 'State: 2 "T"']
    # Every letter has exactly one edge in every state.
    for state in range(machine.states):
        start = next(i for i, line in enumerate(body) if line.startswith(f"State: {state}"))
        edges = []
        for line in body[start + 1 :]:
            if line.startswith("State"):
                break
            guard, _, target = line[1:].rpartition("] ")
            edges.append((guard, int(target)))
        for letter in range(8):
            true = [bool(letter >> k & 1) for k in range(3)]
            hit = [t for g, t in edges if holds(g, true)]
            assert len(hit) == 1
            assert hit[0] == expected(state, *true)
    dot = to_dot(machine)
    assert dot.startswith("digraph monitor {")
    assert '0 -> 2 [label="c"]' in dot


@pytest.mark.parametrize("text", ["p <-> q", "G(p -> q)", "(p ^ q) U r", "p & q | !r"])
def test_guards_of_every_form_are_exported(text: str) -> None:
    machine = synthesize(parse_ltl(text))
    names = [str(a) for a in machine.atoms]
    body = to_hoa(machine).split("--BODY--\n")[1].split("State: ")
    edges = [line[1:].rpartition("] ") for line in body[1].splitlines()[1:]]
    for letter in range(1 << len(names)):
        true = [bool(letter >> k & 1) for k in range(len(names))]
        monitor = Monitor(machine)
        verdict = monitor.step([n for n, v in zip(names, true, strict=True) if v])
        (target,) = [int(t) for guard, _, t in edges if holds(guard, true)]
        assert Truth(int(machine.output[target])) is verdict


def test_machines_are_values() -> None:
    machine = synthesize(parse_ltl("p U q"))
    for array in (machine.delta, machine.output):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_the_exported_texts_are_whole() -> None:
    machine = synthesize(parse_ltl("p U q"))
    assert to_hoa(machine).splitlines() == [
        "HOA: v1",
        'name: "LTL3 monitor of p U q"',
        "States: 3",
        "Start: 0",
        'AP: 2 "p" "q"',
        "acc-name: all",
        "Acceptance: 0 t",
        "properties: trans-labels explicit-labels deterministic complete",
        "--BODY--",
        'State: 0 "?"',
        "[(0) & (!1)] 0",
        "[(!0) & (!1)] 1",
        "[1] 2",
        'State: 1 "F"',
        "[t] 1",
        'State: 2 "T"',
        "[t] 2",
        "--END--",
    ]
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


def holds(guard: str, true: list[bool]) -> bool:
    """Evaluate a label of HOA, whose ``& | !`` and digits Python reads after small changes."""
    if guard == "t":
        return True
    text = guard.replace("!", " not ").replace("&", " and ").replace("|", " or ")
    return bool(eval("".join(f"true[{c}]" if c.isdigit() else c for c in text).strip(), {"true": true}))


def expected(state: int, d: bool, e: bool, c: bool) -> int:
    if state:
        return state
    return 2 if c else 1 if d or e else 0


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


@pytest.mark.parametrize("write", [describe, to_dot, to_hoa])
def test_too_large_monitor_is_refused_with_its_size(write: Callable[[Machine], str]) -> None:
    machine = synthesize(parse_ltl(" ^ ".join(f"(p{i} U q{i})" for i in range(5))))
    with pytest.raises(FormulaError, match="63 states and 845 edges over 1024 letters, too many to be written out"):
        write(machine)

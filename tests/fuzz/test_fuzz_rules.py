"""Whatever stands in a formula or a file of rules, it is read or refused in one sentence, and what is read can be judged by."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pytest_rvads.logic.check import check
from pytest_rvads.logic.ltl.ltl3 import synthesize
from pytest_rvads.logic.ltl.parser import parse_ltl
from pytest_rvads.logic.rules.book import load_rules
from pytest_rvads.logic.rules.current import own_desk
from pytest_rvads.logic.rules.rule import Rule, parse
from pytest_rvads.logic.rules.rulebooks import PAPER, ROAD
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import FormulaError

from .mutations import QUICK, damaged, hostile_text

SEED = "".join(f"[mine_{r.name}]\ntext = {r.text}\ntitle = {r.title}\ntie = 0.5\n" for r in (*PAPER[:3], *ROAD[:2])).encode()
PIECES = [
    *(
        "forall a. ",
        "forall a, b: agent. ",
        "exists j.en. ",
        "a@j",
        "a@j.en",
        "b@j",
        "a.wt > b.wt",
        "G ",
        "F ",
        "N ",
        "!",
        "(",
        ")",
    ),
    *(
        " U ",
        " W ",
        " R ",
        " & ",
        " | ",
        " -> ",
        " <-> ",
        "d(a) := ",
        "d(b)",
        ";",
        "true",
        "false",
        ",",
        ".",
        "@",
        "a",
        "j",
        "1e9",
        "\x00",
    ),
]
WORDS = ["p", "q", "r", "G ", "F ", "X ", "!", "(", ")", " U ", " W ", " R ", " & ", " | ", " -> ", " <-> ", "true", "\ud800"]


@pytest.fixture(scope="module")
def run(make: Callable[..., Run]) -> Run:
    return make("stop4", {0: (2, 10, 50, 200), 1: (1, 20, 150, 300), 2: (3, 20, 30, 40)}, 301)


def judge(run: Run, rule: Rule) -> None:
    try:
        check(run, rule)
    except FormulaError as error:
        assert "too" in str(error)  # noqa: PT017 - one that is read may still be too large


@given(content=damaged(SEED))
@QUICK
def test_files_of_rules(run: Run, tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "own.rules"
    path.write_bytes(content)
    with own_desk():
        try:
            rules = load_rules(path)
        except FormulaError as error:
            assert str(error).startswith(f"{path}: ")  # noqa: PT017
            return
        for rule in rules:
            judge(run, rule)


@given(text=st.lists(st.sampled_from(PIECES), max_size=30).map("".join) | hostile_text)
@example(f"forall {', '.join(f'a{k}' for k in range(3000))}. G a1@j")
@example(f"forall a. G (a@j | {''.join(f'exists a{k}. ' for k in range(30))}true)")
@QUICK
def test_formulas(run: Run, text: str) -> None:
    try:
        assert parse(str(parse(text))) == parse(text)
        rule = Rule("mine", text)
    except FormulaError as error:
        assert str(error)  # noqa: PT017
        return
    judge(run, rule)


@given(text=st.lists(st.sampled_from(WORDS), max_size=40).map("".join))
@QUICK
def test_propositional_formulas(text: str) -> None:
    try:
        formula = parse_ltl(text)
        assert parse_ltl(str(formula)) == formula
        synthesize(formula)
    except FormulaError as error:
        assert str(error)  # noqa: PT017

"""Every entry of the catalogue is shown by one test, and every test shows an entry."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from pytest_rvads.logic.rules.rulebooks import PAPER, ROAD
from tests.tool_modules import tool

from .catalogue import CHEATS, INNOCENTS, UNWATCHED
from .shown import SHOWN

ROOT = Path(__file__).parents[2]
EVERY = (*CHEATS, *INNOCENTS, *UNWATCHED)


@pytest.fixture(autouse=True, scope="module")
def _all_read() -> None:
    """Where only this file was asked for, the others have not been read."""
    for file in sorted(Path(__file__).parent.glob("test_*.py")):
        import_module(f"{__package__}.{file.stem}")


def test_every_entry_is_shown_by_one_test() -> None:
    assert {name: tests for name, tests in SHOWN.items() if len(tests) != 1} == {}
    assert {entry.name for entry in EVERY} ^ SHOWN.keys() == set()


def test_catalogue_entries_match_the_modules_of_their_tests() -> None:
    innocent = {name for name, tests in SHOWN.items() if all(".test_innocent_" in test for test in tests)}
    assert innocent == {entry.name for entry in INNOCENTS}
    assert {name for name, tests in SHOWN.items() if all(".test_unwatched." in test for test in tests)} == {
        entry.name for entry in UNWATCHED
    }


@pytest.mark.extended
def test_the_page_of_the_documentation_has_every_row() -> None:
    catalogue = tool("make_catalogue")
    assert catalogue.PAGE.read_text(encoding="utf-8") == catalogue.page(), "run: python tools/make_catalogue.py"
    assert all(f"| {entry.tries} | {entry.told} |" in catalogue.page() for entry in EVERY)


def test_catalogue_has_at_least_60_cheats_and_30_innocents() -> None:
    assert len({entry.name for entry in EVERY}) == len(EVERY)
    assert len(CHEATS) >= 60
    assert len(INNOCENTS) >= 30


def test_entries_are_sentences_about_rules_that_exist() -> None:
    known = {rule.name for rule in (*PAPER, *ROAD)} | {"run", "monitor", "rule", "-k", "rvads check"}
    for entry in EVERY:
        assert entry.name.isidentifier()
        for text in (entry.tries, entry.told):
            assert 0 < len(text) <= 120, text
            assert not text.endswith(".")
            assert {name for name in re.findall(r"`([^`]*)`", text) if not name.startswith("pytest.")} <= known

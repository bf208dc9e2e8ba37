"""Every entry of the catalogue is shown by one test, and every test shows an entry."""

import re
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from pytest_rvads.logic.rules.rulebooks import PAPER, ROAD

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
    spec = spec_from_file_location("make_catalogue", ROOT / "tools" / "make_catalogue.py")
    assert spec is not None
    assert spec.loader is not None
    tool = module_from_spec(spec)
    spec.loader.exec_module(tool)
    assert tool.PAGE.read_text(encoding="utf-8") == tool.page(), "run: python tools/make_catalogue.py"
    assert all(f"| {entry.tries} | {entry.told} |" in tool.page() for entry in EVERY)


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

"""The reference of public names is what the docstrings say."""

import re
from pathlib import Path

import pytest

import pytest_rvads
from tests.tool_modules import tool

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def written() -> str:
    return str(tool("make_api").page())


@pytest.mark.extended
def test_the_page_is_up_to_date(written: str) -> None:
    assert (ROOT / "docs" / "api.md").read_text(encoding="utf-8") == written, "run: python tools/make_api.py"


def test_every_public_name_is_explained(written: str) -> None:
    for name in pytest_rvads.__all__:
        _, _, section = written.partition(f"\n## {name}\n")
        assert len(section.partition("\n## ")[0].strip()) > 20, name
    for module in (pytest_rvads.errors, pytest_rvads.files, pytest_rvads.values):
        for name in module.__all__:
            place = f"{module.__name__.removeprefix('pytest_rvads.')}.{name}"
            assert len(re.findall(rf"^\*\*`{re.escape(place)}[(`].*\*\*$", written, re.MULTILINE)) == 1, place


def test_the_page_of_public_names_stays_short_enough_to_read() -> None:
    assert len(pytest_rvads.__all__) <= 75

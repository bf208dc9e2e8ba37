"""``tools/oracle.py`` says which verdicts differ between two dumps."""

import json
from types import ModuleType

import pytest

from tests.tool_modules import tool

ENTRY = {"status": "PASS", "message": "p1 holds"}


@pytest.fixture(scope="module")
def oracle() -> ModuleType:
    return tool("oracle")


def test_compare_counts_and_shows_every_difference(oracle: ModuleType) -> None:
    old = {"cells": {"run1 p1": ENTRY, "run2 p1": ENTRY}, "maps": {}}
    new = {"cells": {"run1 p1": ENTRY, "run2 p1": {**ENTRY, "status": "FAIL"}}, "maps": {}}
    assert oracle.compare(old, new) == [
        "cells: 1 of 2 entries differ (status 1)",
        "  run2 p1: status 'PASS' -> 'FAIL'",
        "maps: 0 of 0 entries differ",
    ]


def test_compare_counts_an_entry_that_only_the_new_dump_has(oracle: ModuleType) -> None:
    lines = oracle.compare({"maps": {}}, {"maps": {"town": {"exit": 0}}})
    assert lines == ["maps: 1 of 1 entries differ (exit 1)", "  town: exit None -> 0"]


@pytest.mark.extended
def test_two_dumps_of_random_crowds_are_equal(oracle: ModuleType) -> None:
    first, second = (json.dumps(oracle.dump(["crowds"]), default=str) for _ in range(2))
    assert first == second
    statuses = {entry.get("status", entry.get("verdict")) for entry in json.loads(first)["crowds"].values()}
    assert {"PASS", "FAIL", "NA"} <= statuses, "the crowds break some rules and keep others"

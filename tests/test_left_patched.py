"""The look at the package after each test, which finds what a test left replaced."""

from types import ModuleType

import pytest

from pytest_rvads.satellites.starts import lines

from .left_patched import Attributes

LEAVES = {
    "wrong order": lambda outer, inner: (outer.undo(), inner.undo()),
    "never undone": lambda outer, inner: None,
    "half undone": lambda outer, inner: inner.undo(),
}


@pytest.fixture
def attributes(monkeypatch: pytest.MonkeyPatch) -> Attributes:
    monkeypatch.setattr(pytest.MonkeyPatch, "setattr", pytest.MonkeyPatch.setattr)  # restored at the end, as by any other test
    attributes = Attributes()
    attributes.learn()
    return attributes


@pytest.mark.parametrize("everything", [False, True])
@pytest.mark.parametrize("leaves", LEAVES.values(), ids=LEAVES)
@pytest.mark.parametrize(("owner", "name"), [(lines.Setting, "judged"), (lines, "rank"), (lines, "_TIMID")])
def test_what_is_left_replaced_is_named_and_restored(
    attributes: Attributes, owner: type | ModuleType, name: str, leaves: object, everything: bool
) -> None:
    original = getattr(owner, name)
    outer, inner = pytest.MonkeyPatch(), pytest.MonkeyPatch()
    outer.setattr(owner, name, 1)
    inner.setattr(owner, name, 2)
    leaves(outer, inner)  # type: ignore[operator]
    (left,) = attributes.restore(everything=everything)
    assert left in (f"pytest_rvads.satellites.starts.lines.{name}", f"pytest_rvads.satellites.starts.lines.Setting.{name}")
    assert getattr(owner, name) is original
    assert attributes.restore(everything=True) == []


def test_a_replacement_without_pytest_is_found_among_everything(attributes: Attributes) -> None:
    original, lines.rank = lines.rank, len  # type: ignore[assignment]
    assert attributes.restore(everything=False) == []
    assert attributes.restore(everything=True) == ["pytest_rvads.satellites.starts.lines.rank"]
    assert lines.rank is original


def test_what_a_wider_fixture_replaces_is_found_at_the_end_of_its_file(attributes: Attributes) -> None:
    patch = pytest.MonkeyPatch()
    patch.setattr(lines.Setting, "judged", 1)
    attributes.forget()
    assert attributes.restore(everything=False) == []
    assert attributes.restore(everything=True) == ["pytest_rvads.satellites.starts.lines.Setting.judged"]


def test_what_is_undone_is_not_named(attributes: Attributes) -> None:
    with pytest.MonkeyPatch.context() as outer, pytest.MonkeyPatch.context() as inner:
        outer.setattr(lines.Setting, "judged", 1)
        inner.setattr(lines.Setting, "judged", 2)
    assert attributes.restore(everything=False) == []

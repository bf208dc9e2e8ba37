"""Samples: even over groups within groups, the same in every process and order, in memory that grows with the sample only."""

import subprocess
import sys
import tracemalloc
from collections import Counter
from collections.abc import Iterable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.stratified import draw

Thing = tuple[str, str, str, int]
"""Junction, class, configuration, number: the first three are the strata, all together the name."""


def drawn(things: Iterable[Thing], size: int, seed: int = 0) -> list[Thing]:
    return draw(things, size, seed, lambda thing: thing[:3], str)


THINGS = st.lists(
    st.tuples(st.sampled_from("ABCDE"), st.sampled_from("123"), st.sampled_from("xy"), st.integers(0, 5)),
    unique=True,
    max_size=80,
)
SIZES = st.integers(1, 90)
SEEDS = st.integers(0, 2**30)


@given(THINGS, SIZES, SEEDS)
def test_a_sample_is_so_many_of_the_things_in_their_order(things: list[Thing], size: int, seed: int) -> None:
    found = drawn(things, size, seed)
    assert len(found) == min(size, len(things))
    rest = iter(things)
    assert all(thing in rest for thing in found), "in order, each once"


@given(THINGS, SIZES, SEEDS)
def test_draw_is_balanced_over_groups(things: list[Thing], size: int, seed: int) -> None:
    found = drawn(things, size, seed)
    for level in range(3):
        most, got = (Counter(thing[: level + 1] for thing in some) for some in (things, found))
        for outer in {thing[:level] for thing in things}:
            inside = [group for group in most if group[:level] == outer]
            unexhausted = [got[group] for group in inside if got[group] < most[group]]
            if unexhausted:
                assert max(got[group] for group in inside) <= min(unexhausted) + 1


@pytest.mark.extended
@given(THINGS, SIZES, SEEDS, st.randoms(use_true_random=False))
def test_the_order_of_the_things_does_not_matter(things: list[Thing], size: int, seed: int, random: object) -> None:
    other = list(things)
    random.shuffle(other)  # type: ignore[attr-defined]
    assert set(drawn(other, size, seed)) == set(drawn(things, size, seed))


@given(THINGS, SIZES, SIZES, SEEDS)
def test_sample_is_part_of_every_greater_sample(things: list[Thing], size: int, more: int, seed: int) -> None:
    assert set(drawn(things, size, seed)) <= set(drawn(things, size + more, seed))


def test_seeds_draw_others_and_every_thing_is_drawn_by_some_seed() -> None:
    things = [("A", "1", "x", k) for k in range(12)]
    samples = [frozenset(drawn(things, 3, seed)) for seed in range(60)]
    assert len(set(samples)) > 30
    assert set().union(*samples) == set(things)


def test_a_sample_is_the_same_in_another_process() -> None:
    code = "from pytest_rvads.support.stratified import draw; print(draw(range(1000), 9, 4, lambda k: (str(k % 7),), str))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(draw(range(1000), 9, 4, lambda k: (str(k % 7),), str))


def test_the_least_hashes_of_a_stratum_are_drawn() -> None:
    """`printf '5 a' | sha256sum` begins with 16, for b to e with a3, 80, d9 and b0."""
    assert draw("abcde", 2, 5, lambda _: ("all",), str) == ["a", "c"]


class Many:
    """Numbers that are made when they are asked for."""

    def __iter__(self) -> Iterator[int]:
        yield from range(1_000_000, 1_040_000)


@pytest.mark.extended
def test_memory_grows_with_the_sample_and_not_with_the_things() -> None:
    tracemalloc.start()
    found = draw(Many(), 400, 1, lambda k: (str(k % 300), str(k % 5)), str)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(found) == 400
    assert peak < 700_000, "40,000 numbers alone are 1.4 MB"
    assert set(Counter(k % 300 for k in found).values()) == {1, 2}


@pytest.mark.parametrize(
    ("things", "size", "says"),
    [([1, 2], 0, "a size of 1 or more, got 0"), (iter([1, 2]), 1, "gone through twice, got <list_iterator.*: make a list of it")],
)
def test_what_can_not_be_drawn_is_refused(things: Iterable[int], size: int, says: str) -> None:
    with pytest.raises(RvadsError, match=says):
        draw(things, size, 0, lambda _: ("all",), str)

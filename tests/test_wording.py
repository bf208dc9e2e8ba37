"""What comes from elsewhere is shown as text and as nothing else."""

from hypothesis import given
from hypothesis import strategies as st

from pytest_rvads.wording import one_line, printable


def test_what_steers_a_terminal_or_turns_the_writing_is_escaped() -> None:
    assert printable("a\x1b[31m\u202eb\x00\ud800\x9b") == r"a\x1b[31m\u202eb\x00\ud800\x9b"


def test_what_is_fit_stays() -> None:
    assert printable("Straße\t→ 車\n") == "Straße\t→ 車\n"


def test_one_line() -> None:
    assert one_line(" a\r\n b\x85c\u2028d ") == "a b c d"


@given(st.text(st.characters()), st.integers(1, 50))
def test_it_can_be_encoded_and_is_bounded(text: str, most: int) -> None:
    for shown in (printable(text, most), one_line(text, most)):
        shown.encode()
        assert shown.isprintable() or "\n" in shown or "\t" in shown or any(not c.isprintable() for c in text)
        assert len(shown) <= 6 * most + 40
        assert len(text) > most or shown == printable(shown, 6 * most + 40)


def test_a_huge_text_is_cut() -> None:
    assert printable("x" * 80_000_000, 10) == "xxxxxxxxxx... (80,000,000 characters)"

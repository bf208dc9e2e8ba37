"""What comes from elsewhere is shown as text and as nothing else."""

import io
import shlex
import subprocess
import xml.etree.ElementTree as ET
from html import unescape
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pytest_rvads.logic.check import sentence
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import encode_all, markup, named_error, one_line, printable, quoted


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


@given(st.text(st.characters()))
def test_in_markup_every_text_is_text(text: str) -> None:
    shown = markup(text)
    assert unescape(shown) == printable(text, len(text))
    root = ET.fromstring(f'<a b="{shown}">{shown}</a>')
    assert root.text or not text
    assert (root.text or "") == printable(text, len(text))
    assert len(root) == 0


@pytest.mark.parametrize(
    ("errors", "written"), [("strict", rb"\u2192\xfc"), ("surrogateescape", rb"\u2192\xfc"), ("replace", b"??")]
)
def test_streams_take_what_their_encoding_lacks(errors: str, written: bytes) -> None:
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="ascii", errors=errors)
    encode_all(stream, io.StringIO(), None)
    stream.write("→ü")
    stream.flush()
    assert raw.getvalue() == written


@pytest.mark.parametrize("name", ["a[b-c]", "a[b c]", "a[it's]", "a[;x&&y|z>w]", "a[*?~#%]", "a[b\nc]", "", "-x"])
def test_a_name_stands_in_quotes_that_every_shell_knows(name: str) -> None:
    assert quoted(name) == f'"{name}"'
    assert shlex.split(quoted(name)) == [name]


@pytest.mark.parametrize(
    "name",
    ["a[$(touch owned)]", "a[`touch owned`]", "a[$HOME]", 'a["; touch owned; "]', "a[b\\]", "a[!x]", "a['$(touch owned)'!]"],
)
def test_quoted_name_is_one_word_of_a_shell(name: str, tmp_path: Path) -> None:
    assert quoted(name).startswith("'"), "double quotes would not keep it; a shell at a prompt takes ! there for an earlier line"
    done = subprocess.run(["sh", "-c", f"printf %s {quoted(name)}"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == name
    assert list(tmp_path.iterdir()) == []


@given(st.text(st.characters(exclude_characters="\0")))
def test_a_quoted_name_is_one_word(name: str) -> None:
    assert shlex.split(quoted(name)) == [name]


@pytest.mark.parametrize("error", [StopIteration(), AssertionError(), MemoryError(), OSError(), RunError("")])
def test_error_without_a_text_has_the_name_of_its_type(error: Exception) -> None:
    assert named_error(error) == sentence(error) == type(error).__name__

"""Archives of arrays from elsewhere: whole ones come back, all others are refused before they take memory."""

import io
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pytest_rvads.runs.archive import MOST_BYTES, unpack

NUMBERS = np.arange(12.0).reshape(3, 4)


def archive(members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as file:
        for name, data in members.items():
            file.writestr(f"{name}.npy", data)
    return out.getvalue()


def npy(array: Any) -> bytes:
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def announced(descr: str = "'<f8'", shape: str = "(3, 4)", data: bytes = NUMBERS.tobytes()) -> bytes:
    """An array of which its header says something else than it holds."""
    head = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return archive({"a": b"\x93NUMPY\x01\x00v\x00" + head.encode() + data})


WHOLE = archive({"a": npy(NUMBERS)})
ENTRY = WHOLE.index(b"PK\x01\x02")


def directory(offset: int, value: int, width: str = "H") -> bytes:
    """The archive with another number in the entry of its directory."""
    changed = bytearray(WHOLE)
    struct.pack_into(f"<{width}", changed, ENTRY + offset, value)
    return bytes(changed)


REFUSED: list[tuple[Callable[[], bytes], str]] = [
    (lambda: b"", "not a zip file"),
    (lambda: b"hello", "not a zip file"),
    (lambda: WHOLE[:-30], "not a zip file"),
    (lambda: archive({"a": npy(NUMBERS).replace(b"NUMPY", b"NVMPY")}), "a is no array of numbers"),
    (lambda: WHOLE[:40] + b"\xff" * 8 + WHOLE[48:], "invalid|CRC|Error"),
    (lambda: directory(8, 1), "encrypted"),
    *((lambda method=method: directory(10, method), "another method than deflate") for method in (1, 9, 12, 14, 99)),
    (lambda: archive({"a": npy(NUMBERS)}, zipfile.ZIP_LZMA), "another method than deflate"),
    (lambda: directory(24, 2**31, "I"), "take 2,147,483,648 bytes"),
    (lambda: directory(24, 2000, "I"), "a has 224 bytes where 2,000 are announced"),
    (lambda: directory(24, 100, "I"), "CRC|no array"),
    (lambda: directory(42, 2**31, "I"), "not a zip|negative|magic|header"),
    (lambda: announced("'|O'"), "no array of numbers"),
    (lambda: announced("'<c16'"), "no array of numbers"),
    (lambda: announced("[('a', '<f8')]"), "no array of numbers"),
    (lambda: announced("(" * 60_000), "no array of numbers"),
    (lambda: announced(shape="(3, -4)"), "no array of numbers"),
    (lambda: announced(shape="(3, 40000000000000000)"), "do not fill the shape"),
    (lambda: announced(shape="(3, 3)"), "do not fill the shape"),
    (lambda: archive({"a": npy(np.array([{}]))}), "no array of numbers"),
    (lambda: archive({f"a{k}": b"" for k in range(1001)}), "holds 1,001 arrays, expected at most 1,000"),
    (lambda: archive({"a": npy(NUMBERS), "b": npy(NUMBERS)}).replace(b"b.npy", b"a.npy"), "two of its arrays have the same name"),
]


@pytest.mark.parametrize(
    "array", [NUMBERS, np.asfortranarray(NUMBERS), NUMBERS.astype(">f4"), np.array([1, 2], np.int8), np.zeros((0, 3))]
)
def test_what_numpy_wrote_comes_back(array: np.ndarray[Any, Any]) -> None:
    out = io.BytesIO()
    np.savez_compressed(out, a=array)
    back = unpack(out.getvalue())["a"]
    assert back.dtype == array.dtype
    assert np.array_equal(back, array)


@pytest.mark.parametrize(("content", "message"), REFUSED, ids=range(len(REFUSED)))
def test_hostile_archives_are_refused(content: Callable[[], bytes], message: str) -> None:
    with pytest.raises(ValueError, match=f"(?i){message}") as caught:
        unpack(content())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("said", [None, 1000], ids=["honest", "lies about its size"])
def test_a_bomb_takes_no_memory(said: int | None) -> None:
    size = MOST_BYTES + 1
    content = archive({"a": bytes(size)})
    if said is not None:
        content = content.replace(struct.pack("<I", size), struct.pack("<I", said))
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"take 67,108,865 bytes|CRC"):
        unpack(content)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2_000_000

"""XML files, read element by element within bounds on depth and tag length.

A document type declaration is refused when it begins, so a file can declare no entity and refer to nothing outside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any
from xml.parsers import expat

from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import one_line

__all__ = ["DEEPEST", "LONGEST_TAG", "XmlError", "read_xml"]

DEEPEST = 60
"""Deepest nesting that is read: a trajectory of OpenSCENARIO lies 16 levels deep, a lane of OpenDRIVE 10."""
LONGEST_TAG = 2**23
"""Longest tag or comment that is read [bytes]; a tag is held in memory as a whole."""


class XmlError(RvadsError):
    """A file is no XML, or exceeds a bound; the message names the row and leaves the name of the file to the caller."""


def read_xml(
    chunks: Iterable[bytes],
    expected: str,
    start: Callable[[str, dict[str, str], int], None],
    end: Callable[[str], None] | None = None,
    text: Callable[[str], None] | None = None,
) -> None:
    """Read XML and call a function for each element.

    Args:
        chunks: the content, in pieces; the caller bounds the number of bytes.
        expected: what the file should be, for the message about a file that is no XML.
        start: called with the tag of an element, its attributes, and the row of the file that the element begins in.
        end: called with the tag of an element when the element ends.
        text: called with text between tags.

    Raises:
        XmlError: the content is no XML, has a document type declaration or a tag that is too long, or nests elements too deep.
    """
    parser = expat.ParserCreate()
    # Expat may put off the end of a long tag; then the length of the tag can't be told from the position.
    getattr(parser, "SetReparseDeferralEnabled", bool)(False)
    depth = fed = 0

    def doctype(*_: Any) -> None:
        raise XmlError("it has a document type declaration (DTD), which can hide entity bombs; remove it")

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise XmlError(f"row {parser.CurrentLineNumber}: elements are nested deeper than {DEEPEST} levels")
        start(tag, attributes, parser.CurrentLineNumber)

    def finish(tag: str) -> None:
        nonlocal depth
        depth -= 1
        if end is not None:
            end(tag)

    parser.StartDoctypeDeclHandler, parser.StartElementHandler, parser.EndElementHandler = doctype, begin, finish
    parser.CharacterDataHandler = text
    complete = False
    try:
        for chunk in chunks:
            parser.Parse(chunk, False)
            fed += len(chunk)
            if fed - parser.CurrentByteIndex > LONGEST_TAG:
                raise XmlError(f"row {parser.CurrentLineNumber}: a tag or comment has more than {LONGEST_TAG // 2**20} MB")
        complete = True
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        what = one_line(expat.errors.messages.get(error.code, str(error))) + ", the file is cut off" * complete
        raise XmlError(f"row {error.lineno}, column {error.offset}: not XML: {what}; expected {expected}") from error
    except (ValueError, LookupError) as error:  # the file declares an unknown encoding
        raise XmlError(f"not XML: {one_line(str(error))}; expected {expected}") from error

"""Typed JSON: msgspec checks JSON from files and other processes against a type, and an error names the field in one sentence.

The import of msgspec takes some 20 ms, so msgspec is imported only with the first run, record or file.
"""

from __future__ import annotations

import json
import re
import reprlib
from typing import Any, TypeVar

import msgspec
from msgspec.inspect import (
    DataclassType,
    DictType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    LiteralType,
    NoneType,
    StrType,
    StructType,
    TupleType,
    Type,
    UnionType,
    VarTupleType,
    type_info,
)

from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import one_line

T = TypeVar("T")
_WORDS = {"int": "a whole number", "float": "a number", "str": "a text", "bool": "true or false"}
_WORDS |= {"array": "a list", "object": "an object"}
_PLAIN = {IntType: int, FloatType: float, StrType: str}


def decode(text: bytes, kind: type[T], where: str, error: type[RvadsError]) -> T:
    """Return the value of type `kind` that a JSON text holds; see `typed`."""
    try:
        return msgspec.json.decode(text, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        pass
    try:
        value = json.loads(text)  # names the line of an error, and accepts NaN, so that `typed` names its field
        decoded = typed(value, kind, where, error)
        json.dumps(value, allow_nan=False, ensure_ascii=False).encode()  # refuses NaN in a field of any type
    except (ValueError, RecursionError) as refused:
        raise error(f"{where}: not JSON: {refused}") from refused
    return decoded


def encode(value: object) -> bytes:
    """Return a value as JSON; a character that UTF-8 can't hold, as in a file name in another encoding, becomes ``?``."""
    try:
        return msgspec.json.encode(value)
    except UnicodeEncodeError:
        return msgspec.json.encode(_encodable(msgspec.to_builtins(value, str_keys=True)))


def _encodable(value: Any) -> Any:
    """Return a value of built-in types with a question mark for each character that UTF-8 can't hold."""
    if isinstance(value, str):
        return value.encode(errors="replace").decode()
    if isinstance(value, dict):
        return {_encodable(key): _encodable(inner) for key, inner in value.items()}
    return list(map(_encodable, value)) if isinstance(value, list | tuple) else value


def typed(value: object, kind: type[T], where: str, error: type[RvadsError]) -> T:
    """Return builtins, as read from JSON, converted to a value of type `kind`."""
    try:
        return msgspec.convert(value, kind, str_keys=True)
    except msgspec.ValidationError as refused:
        raise error(f"{where}: {_sentence(str(refused), value, type_info(kind))}") from refused


def _sentence(message: str, value: Any, info: Type) -> str:
    """Return a message of msgspec in plain words, with the value and the choices at the path that the message names."""
    what, _, place = message.partition(" - at `")
    of_keys, _, steps = place.partition("$")  # "key` in `$.totals`"
    path = ""
    for step in re.findall(r"\.\.\.|[^.\[\]`]+", steps):
        info = _inside(info, step, value)
        if isinstance(value, list | tuple):
            value, path = value[int(step)], f"{path}[{step}]"
        else:
            key = step if step in value else _wrong_key(value, info)
            value, path = value[key], f"{path}.{key}".lstrip(".")
    missing = re.fullmatch("Object missing required field `(.*)`", what)
    if missing:
        return f"the field {f'{path}.{missing[1]}'.lstrip('.')!r} is missing"
    unknown = re.fullmatch("Object contains unknown field `(.*)`", what, re.DOTALL)
    if unknown and isinstance(info, StructType):
        choices = ", ".join(field.encode_name for field in info.fields)
        return one_line(f"the field {f'{path}.{unknown[1]}'.lstrip('.')!r} is unknown, expected one of {choices}")
    expected = what.removeprefix("Expected ").partition(", got ")[0]
    expected = re.sub("`(.*?)`", lambda kinds: " or ".join(_WORDS.get(k, k) for k in kinds[1].split(" | ")), expected)
    if isinstance(info, EnumType | LiteralType):
        expected = " or ".join(sorted(repr(str(c)) for c in (info.values if isinstance(info, LiteralType) else info.cls)))
    elif what == "Number out of range":
        expected = "a number that is not too large to compute with"
    elif "matching regex" in expected:
        expected = "a text without control characters"
    field = f"{'a key of ' if of_keys else ''}the field {path!r}" if path else "it"
    return one_line(f"{field} must be {expected}, got {reprlib.repr(list(value) if of_keys else value)}")


def _inside(info: Type, step: str, value: Any) -> Type:
    """Return the type of a field or item of a value."""
    if isinstance(info, UnionType):
        kinds = [t for t in info.types if not isinstance(t, NoneType)]
        tagged = [t for t in kinds if isinstance(t, StructType) and value.get(t.tag_field) == t.tag]
        if len(kinds) > 1 and not tagged:
            return LiteralType(tuple(t.tag for t in kinds if isinstance(t, StructType) and t.tag is not None))
        info = (tagged or kinds)[0]
    if isinstance(info, StructType | DataclassType):
        return next((f.type for f in info.fields if f.encode_name == step), info)  # the field of a tag is none of the fields
    if isinstance(info, TupleType):
        return info.item_types[int(step)]
    if isinstance(info, ListType | VarTupleType):
        return info.item_type
    return info.value_type if isinstance(info, DictType) else info


def _wrong_key(values: dict[str, Any], info: Type) -> str:
    """Return the key of the first value of a wrong type, because msgspec names no keys of dictionaries."""
    for key, value in values.items():
        try:
            msgspec.convert(value, _checkable(info))
        except msgspec.ValidationError:
            return key
    return next(iter(values))


def _checkable(info: Type) -> Any:
    """Return the Python type against which a value of a dictionary of this msgspec type is checked."""
    if isinstance(info, TupleType):
        return tuple[tuple(map(_checkable, info.item_types))]  # type: ignore[misc]
    return info.cls if isinstance(info, StructType) else _PLAIN.get(type(info), Any)

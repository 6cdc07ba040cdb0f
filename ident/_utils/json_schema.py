"""JSON schemas of what TOML tables and the fields of dataclasses may hold."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Any

from .toml import Kind, anything, flag, matrix, number, text, texts

NUMBER: dict[str, Any] = {"type": "number"}
TEXT: dict[str, Any] = {"type": "string", "minLength": 1}
NUMBERS: dict[str, Any] = {"type": "array", "items": NUMBER, "minItems": 1}
TEXTS: dict[str, Any] = {"anyOf": [TEXT, {"type": "array", "items": TEXT}]}
_PLAIN: dict[Callable[..., Any], dict[str, Any]] = {
    number: NUMBER,
    text: TEXT,
    texts: TEXTS,
    flag: {"type": "boolean"},
    matrix: {"type": "array", "items": NUMBERS, "minItems": 1},
    anything: {},
}


def of_kind(kind: Kind) -> dict[str, Any]:
    """The schema of what a kind of value takes; of one that says nothing, anything."""
    schema = _PLAIN.get(kind)
    return dict(getattr(kind, "json_schema", {}) if schema is None else schema)


def of_table(keys: Mapping[str, Mapping[str, Any]], required: Sequence[str] = (), description: str = "") -> dict[str, Any]:
    """A table with these keys, and no others."""
    told = {"description": description} if description else {}
    wanted = {"required": list(required)} if required else {}
    return {"type": "object", **told, "properties": {k: dict(v) for k, v in keys.items()}, **wanted, "additionalProperties": False}


def of_fields(kind: type, without: Sequence[str] = ()) -> dict[str, dict[str, Any]]:
    """The schema of each field of a dataclass, by its annotation."""
    try:
        hints = typing.get_type_hints(kind)
    except NameError:  # a type that is imported for type checkers only
        hints = {}
    return {f.name: _of_hint(hints.get(f.name)) for f in dataclasses.fields(kind) if f.name not in without}


def first_sentence(kind: type) -> str:
    """What a class says of itself first."""
    return " ".join((kind.__doc__ or "").split("\n\n", maxsplit=1)[0].split())


def _of_hint(hint: Any) -> dict[str, Any]:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        # None is what stands where the key is left out.
        parts = [_of_hint(a) for a in arguments if a is not type(None)]
        return {} if {} in parts else parts[0] if len(parts) == 1 else {"anyOf": parts}
    if origin in (tuple, list, Sequence):
        return {"type": "array", "items": _of_hint(arguments[0])}
    if isinstance(hint, type) and issubclass(hint, Enum):
        return {"enum": [member.value for member in hint]}
    plain: dict[Any, str] = {bool: "boolean", int: "integer", float: "number", str: "string"}
    return {"type": plain[hint]} if isinstance(hint, type) and hint in plain else {}

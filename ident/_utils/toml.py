"""TOML tables with checked keys and types, read and written. Errors name the file, the table and the key."""

from __future__ import annotations

import dataclasses
import math
import os
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

from ..errors import ConfigurationError, unknown_name
from .structured import read_toml

#: Turns a value of a TOML file into what the program uses, or raises `Unfit` with what was expected.
Kind = Callable[[Any], Any]


def described(kind: Kind, schema: dict[str, Any]) -> Kind:
    """A kind of value that tells what it takes as a JSON schema."""
    kind.json_schema = schema  # type: ignore[attr-defined]
    return kind


class Unfit(Exception):
    """A value is not of the kind that its key asks for; the text says what it should be."""


def load_toml(path: Path, what: str) -> dict[str, Any]:
    """Parse a TOML file. `what` it is goes into the message of a ConfigurationError."""
    return read_toml(path, what)


def check_table(data: Any, schema: Mapping[str, Kind], table: str, where: str) -> dict[str, Any]:
    """The values of one table after its schema. Unknown keys and wrong types raise ConfigurationError."""
    label = f"[{table}]" if table else "the top level"
    if not isinstance(data, Mapping):
        raise ConfigurationError(f"{where}: {label} must be a table, not {data!r}.")
    found = {}
    for key, value in data.items():
        if key not in schema:
            raise unknown_name(f"{'key of ' + label if table else 'table'} ({where})", key, schema)
        try:
            found[key] = schema[key](value)
        except Unfit as expected:
            raise ConfigurationError(f"{where}: {label} {key} must be {expected}, not {_shown(value)}.") from None
    return found


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def number(value: Any) -> float:
    """A finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise Unfit("a finite number")
    return float(value)


def text(value: Any) -> str:
    """Text that is not empty."""
    if not isinstance(value, str) or not value:
        raise Unfit("a text")
    return value


def flag(value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise Unfit("true or false")
    return value


def anything(value: Any) -> Any:
    """Any value; whoever uses it checks it."""
    return value


def one_of(*choices: str) -> Kind:
    """One of a few texts."""

    def kind(value: Any) -> str:
        if value not in choices:
            raise Unfit(" or ".join(repr(c) for c in choices))
        return str(value)

    return described(kind, {"enum": [*choices]})


def numbers(count: int | None = None) -> Kind:
    """A list of finite numbers, as a tuple."""
    expected = "a list of numbers" if count is None else f"a list of {count} numbers"

    def kind(value: Any) -> tuple[float, ...]:
        try:
            found = tuple(number(v) for v in value) if isinstance(value, list | tuple) else ()
        except Unfit:
            found = ()
        if not found or (count is not None and len(found) != count):
            raise Unfit(expected)
        return found

    sizes = {"minItems": 1} if count is None else {"minItems": count, "maxItems": count}
    return described(kind, {"type": "array", "items": {"type": "number"}, **sizes})


def matrix(value: Any) -> tuple[tuple[float, ...], ...]:
    """A square matrix as a list of rows of numbers."""
    try:
        rows = tuple(numbers()(row) for row in value) if isinstance(value, list | tuple) else ()
    except Unfit:
        rows = ()
    if not rows or any(len(row) != len(rows) for row in rows):
        raise Unfit("a square matrix, given as a list of rows of numbers")
    return rows


def texts(value: Any) -> tuple[str, ...]:
    """One text or a list of texts, as a tuple."""
    values = [value] if isinstance(value, str) else value
    if not isinstance(values, list | tuple) or any(not isinstance(v, str) or not v for v in values):
        raise Unfit("a text or a list of texts")
    return tuple(values)


def table_of(kind: Kind, expected: str) -> Kind:
    """A table that maps names to values of one kind."""

    def checked(value: Any) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise Unfit(expected)
        try:
            return {str(k): kind(v) for k, v in value.items()}
        except Unfit:
            raise Unfit(expected) from None

    return checked


def check_options(kind: type, options: Mapping[str, Any], where: str, also: Iterable[str] = ()) -> None:
    """Raise ConfigurationError unless `options` are fields of the dataclass `kind`, of the annotated types.

    `also`: further keys that may stand beside them, for the list of known ones."""
    known = {f.name for f in dataclasses.fields(kind)}
    try:
        hints = typing.get_type_hints(kind)
    except NameError:  # a type that is imported for type checkers only: the class itself checks its fields
        hints = {}
    for key, value in options.items():
        if key not in known:
            raise unknown_name(f"key of {where}", key, known.union(also))
        if not _fits(value, hints.get(key)):
            raise ConfigurationError(f"{where} {key} must be {_in_words(hints[key])}, not {_shown(value)}.")


def _fits(value: Any, hint: Any) -> bool:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, a) for a in arguments)
    if origin in (tuple, list, Sequence):
        return isinstance(value, list | tuple) and all(_fits(v, arguments[0]) for v in value)
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return any(value in (member, member.value) for member in hint)
    if hint in (bool, str, type(None)):
        return isinstance(value, hint)
    return True  # None: not known; whatever else it is, the class itself checks it


def _in_words(hint: Any) -> str:
    """What a study file may hold for an annotated type."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        # None is what stands where the key is left out.
        return " or ".join(dict.fromkeys(_in_words(a) for a in arguments if a is not type(None)))
    if origin in (tuple, list, Sequence):
        inner = {"a number": "numbers", "a text": "texts", "a whole number": "whole numbers"}.get(_in_words(arguments[0]))
        return f"a list of {inner}" if inner else "a list"
    if isinstance(hint, type) and issubclass(hint, Enum):
        return " or ".join(repr(member.value) for member in hint)
    return {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}.get(hint, "a table")


def to_toml(tables: Mapping[str, Mapping[str, Any]]) -> str:
    """TOML text of tables of plain values. None is left out, numbers keep full precision."""
    parts = []
    for name, table in tables.items():
        lines = [f"{_key(k)} = {_value(v)}" for k, v in table.items() if v is not None]
        if lines:
            parts.append("\n".join([f"[{_key(name)}]", *lines]))
    return "\n\n".join(parts) + "\n"


def _key(key: str) -> str:
    return key if key and all(c.isascii() and (c.isalnum() or c in "_-") for c in key) else _quoted(key)


def _quoted(value: str) -> str:
    escapes = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    return '"' + "".join(escapes.get(c, c if c.isprintable() else f"\\U{ord(c):08x}") for c in value) + '"'


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str | os.PathLike):
        return _quoted(os.fspath(value))
    if isinstance(value, Mapping):
        inner = ", ".join(f"{_key(str(k))} = {_value(v)}" for k, v in value.items() if v is not None)
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    raise ConfigurationError(f"{value!r} ({type(value).__name__}) cannot be written to a study file.")

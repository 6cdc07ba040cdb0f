"""Messages as `ros2 topic echo` and `rostopic echo` print them: documents of YAML, parted by `---`. Of YAML, what these programs write."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...errors import DataError
from .damage import DAMAGED, reason
from .messages import arrays_by_name, table_of_messages
from .packed import bounded_lines, open_whole
from .stored import LogFormat, Stored, register_log_format

_KEY = re.compile(r"(?P<key>[A-Za-z_][\w./ -]*?|'[^']*'|\"[^\"]*\"):(?:\s+(?P<rest>.*))?$")
#: A first line that opens a block, and one that holds a value before the end of a document.
_BLOCK = re.compile(rb"(?:---\s*\n)?[A-Za-z_][\w./-]*:[ \t]*\r?\n(?:[ \t]+\S|- )")
_VALUE = re.compile(rb"(?:---\s*\n)?[A-Za-z_][\w./-]*:[ \t]+\S[^\n]*\n(?:.*\n)?---[ \t]*\r?\n", re.DOTALL)
_ANY = re.compile(rb"(?:---\s*\n)?[A-Za-z_][\w./-]*:")
#: Levels to which documents are taken apart.
_DEEP = 12

Line = tuple[int, str]


def _is_one(path: Path, start: bytes) -> bool:
    if not path.is_file() or b"\x00" in start:
        return False
    front = start.lstrip(b"\xef\xbb\xbf\r\n ")
    named = path.name.lower().removesuffix(".gz").endswith((".yaml", ".yml")) and _ANY.match(front)
    return bool(named or _BLOCK.match(front) or _VALUE.match(front))


def _read(path: Path) -> Stored:
    try:
        with open_whole(path) as stream:
            lines = stream.read().decode("utf-8-sig", "replace").splitlines()
    except DAMAGED as error:
        raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None
    documents = [document for document in _documents([*bounded_lines(lines, path)], path) if isinstance(document, dict)]
    if not documents:
        raise DataError(f"log {path}: holds no message.")
    if len(documents) == 1:
        return arrays_by_name(documents[0], path)
    cut = [f"log {path}: the last message is truncated, and is left out."] if _shape(documents[-1]) != _shape(documents[0]) else []
    stored = table_of_messages(iter(documents[: -1 if cut else None]), path)
    return replace(stored, notes=(*stored.notes, *cut))


def _shape(document: dict[str, Any]) -> list[tuple[str, int]]:
    """The keys of a message, and how long their lists are."""
    return [(key, len(value) if isinstance(value, list) else -1) for key, value in document.items()]


def _documents(lines: list[str], path: Path) -> Iterator[Any]:
    own: list[Line] = []
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if text == "---":
            yield _document(own, path, number)
            own = []
        elif own and own[-1][1].count("[") > own[-1][1].count("]"):  # a list over several lines
            own[-1] = own[-1][0], f"{own[-1][1]} {text}"
        elif text and not text.startswith("#"):
            own.append((len(line) - len(line.lstrip()), text))
    yield _document(own, path, len(lines))


def _document(lines: list[Line], path: Path, number: int) -> Any:
    """A document; None for lines that are none (what the program says of messages that were lost)."""
    start = next((k for k, (indent, text) in enumerate(lines) if not indent and _KEY.match(text)), None)
    if start is None:
        return None
    value, at = _block(lines, start, 0)
    if at < len(lines):
        raise DataError(
            f"log {path}: the message that ends on line {number} holds {lines[at][1][:40]!r}, which is not YAML as ROS prints it."
        )
    return value


def _block(lines: list[Line], at: int, deep: int) -> tuple[Any, int]:
    """The list or the fields that begin on a line, and the first line behind them."""
    indent = lines[at][0]
    if deep > _DEEP:
        return None, len(lines)
    return _items(lines, at, indent, deep) if lines[at][1].startswith("-") else _fields(lines, at, indent, deep)


def _items(lines: list[Line], at: int, indent: int, deep: int) -> tuple[list[Any], int]:
    out: list[Any] = []
    while at < len(lines) and lines[at][0] == indent and re.match(r"-(\s|$)", lines[at][1]):
        rest = lines[at][1][1:].lstrip()
        if rest and not _KEY.match(rest):
            out.append(_value(rest))
            at += 1
            continue
        if rest:  # fields begin right behind the dash
            lines[at] = indent + len(lines[at][1]) - len(rest), rest
        else:
            at += 1
        value, at = _block(lines, at, deep + 1) if at < len(lines) and lines[at][0] > indent else (None, at)
        out.append(value)
    return out, at


def _fields(lines: list[Line], at: int, indent: int, deep: int) -> tuple[dict[str, Any], int]:
    out: dict[str, Any] = {}
    while at < len(lines) and lines[at][0] == indent and (found := _KEY.match(lines[at][1])):
        key, rest = found["key"].strip("'\""), found["rest"]
        at += 1
        if rest:
            out[key] = _value(rest)
        elif at < len(lines) and (lines[at][0] > indent or (lines[at][0] == indent and lines[at][1].startswith("-"))):
            out[key], at = _block(lines, at, deep + 1)
        else:
            out[key] = None
    return out, at


def _value(text: str) -> Any:
    """A number, a list of such in brackets, or a text."""
    if text.startswith("[") and text.endswith("]"):
        return [_value(x.strip()) for x in text[1:-1].split(",") if x.strip()]
    try:
        return float(text)
    except ValueError:
        return {".nan": float("nan"), ".inf": float("inf"), "-.inf": float("-inf")}.get(text.lower(), text.strip("'\""))


YAML = register_log_format(LogFormat("YAML messages", _is_one, _read))

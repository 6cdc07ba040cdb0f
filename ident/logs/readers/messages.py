"""Messages as text: JSON (a message a line, a list of messages, or arrays by name) and XML (a telegram a line, or one document)."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError
from ..words import TIME, words_of
from .arrays import columns_of, element, leaves, names_told
from .damage import DAMAGED, reason
from .packed import bounded_lines, open_whole
from .runs import of_one_run, run_name, runs_of
from .stored import LogFormat, Stored, register_log_format, split_inside

Array = np.ndarray
_FIELDS = ("position", "velocity", "effort")
#: Levels to which messages are taken apart.
_DEEP = 12
#: Bytes at the beginning in which a document of series shows one: a list of numbers by name.
_FRONT, _SERIES = 1 << 16, re.compile(rb'":\s*\[\s*\[?\s*[-\d]')


def _text(path: Path) -> str:
    try:
        with open_whole(path) as stream:
            return stream.read().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"log {path}: is not UTF-8 text ({reason(error)}).") from None
    except DAMAGED as error:
        raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None


def _read_json(path: Path) -> Stored:
    outer, inside = split_inside(path)
    text = _text(outer)
    try:
        whole = json.loads(text)
    except (ValueError, RecursionError):
        cut: list[str] = []
        stored = table_of_messages(_lines(text, path, cut), path)
        return replace(stored, notes=(*stored.notes, *cut))
    if inside:
        return columns_of(of_one_run(_runs(whole), outer, inside), f"log {path}")
    if isinstance(whole, list) and len(whole) == 1 and _is_run(whole[0]):
        return arrays_by_name(whole[0], path)
    if isinstance(whole, list) and whole and all(isinstance(m, dict) for m in whole):
        return table_of_messages(iter(whole), path)
    if isinstance(whole, dict):
        for value in whole.values():
            if isinstance(value, list) and len(value) > 1 and all(isinstance(m, dict) for m in value):
                return table_of_messages(iter(value), path)
        return arrays_by_name(whole, path)
    raise DataError(f"log {path}: is JSON, but holds neither messages nor named arrays.")


def _json_recordings(path: Path) -> tuple[str, ...]:
    with open_whole(path) as stream:
        if _SERIES.search(stream.read(_FRONT)) is None:
            return ()  # messages, of which there may be many
    try:
        return tuple(map(run_name, runs_of(_runs(json.loads(_text(path))))))
    except (ValueError, RecursionError):
        return ()  # a message a line


def _runs(whole: Any) -> dict[str, Array]:
    """Arrays by path of a document that holds recordings: a list of such, or each by its name; {} for another."""
    if isinstance(whole, list):
        whole = {"runs": whole}
    out: dict[str, Array] = {}
    for name, value in whole.items() if isinstance(whole, dict) else ():
        if isinstance(value, list) and len(value) > 1 and all(map(_is_run, value)):
            for k, run in enumerate(value):
                out |= leaves(_arrays(run), element(name, k))
        elif _is_run(value):
            out |= leaves(_arrays(value), name)
    return out if runs_of(out) else {}


def _is_run(value: Any) -> bool:
    """Whether a part of a document is a recording of its own: a table of which one column is a time."""
    return isinstance(value, dict) and any(words_of(str(k)) & TIME and isinstance(v, list) and len(v) > 1 for k, v in value.items())


def arrays_by_name(whole: dict[str, Any], path: Path) -> Stored:
    """Columns of a document that holds lists by name. Raises DataError where it holds none."""
    return columns_of(leaves(_arrays(_named_table(whole))), f"log {path}")


def _lines(text: str, path: Path, cut: list[str]) -> Iterator[Any]:
    """Messages, a line each. A last line that ends in the middle is left out, and said in `cut`."""
    lines = [(k, line) for k, line in enumerate(bounded_lines(text.splitlines(), path), 1) if line.strip()]
    for k, line in lines:
        try:
            yield json.loads(line)
        except (ValueError, RecursionError) as error:
            if k == lines[-1][0] > lines[0][0] and not text.endswith("\n"):
                cut.append(f"log {path}: line {k}, the last, is a truncated message, and is left out.")
                return
            raise DataError(f"log {path}: line {k} is not a JSON message ({reason(error)}).") from None


def _named_table(whole: dict[str, Any]) -> dict[str, Any]:
    """The same as lists by name, where it is a table with names of columns, or one value for each row's number, as pandas writes them."""
    names, rows = whole.get("columns"), whole.get("data")
    if isinstance(names, list) and isinstance(rows, list) and rows and all(isinstance(r, list) and len(r) == len(names) for r in rows):
        return {str(name): list(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}
    if whole and all(isinstance(v, dict) and v and all(k.isdecimal() for k in v) for v in whole.values()):
        return {name: list(v.values()) for name, v in whole.items()}
    return whole


def _arrays(content: Any, deep: int = 0) -> Any:
    """Lists of numbers (of lists of numbers) of a JSON document as arrays."""
    if deep > _DEEP:
        return {}
    if isinstance(content, dict):
        return {k: _arrays(v, deep + 1) for k, v in content.items()}
    if isinstance(content, list) and names_told(content):
        return [_arrays(item, deep + 1) for item in content]
    if isinstance(content, list) and content and all(isinstance(x, str) for x in content):
        stamps = [_stamp(x) for x in content]
        return np.array(content) if None in stamps else np.array(stamps, float)
    if isinstance(content, list):
        try:
            array = np.array(
                [[np.nan if x is None else x for x in v] if isinstance(v, list) else np.nan if v is None else v for v in content]
            )
        except ValueError:
            return {}
        return array if array.dtype.kind in "fiu" else {}
    return content


def table_of_messages(messages: Iterator[Any], path: Path) -> Stored:
    """Columns of messages: a row each; what some lack is NaN there."""
    rows = [flat(message) for message in messages if isinstance(message, dict)]
    names: dict[str, None] = {}
    for row in rows:
        names.update(dict.fromkeys(row))
    if not names:
        raise DataError(f"log {path}: holds no message with numbers.")
    return Stored({name: np.array([row.get(name, np.nan) for row in rows], float) for name in names})


def flat(message: Mapping[str, Any], name: str = "", deep: int = 0) -> dict[str, float]:
    """Numbers of a message by path (`actuators[0].position`); joint states by their joints' names."""
    out: dict[str, float] = {}
    if deep > _DEEP:
        return out
    joints = message.get("name")
    if isinstance(joints, list) and joints and all(isinstance(x, str) for x in joints) and isinstance(message.get("position"), list):
        for word in _FIELDS:
            values = message.get(word)
            if isinstance(values, list) and len(values) == len(joints):
                out |= {f"{name}{joint}.{word}": x for joint, v in zip(joints, values, strict=True) if (x := _number(v)) is not None}
        message = {k: v for k, v in message.items() if k not in ("name", *_FIELDS)}
    for key, value in message.items():
        items = enumerate(value) if isinstance(value, list) else ((None, value),)
        named = names_told(value) if isinstance(value, list) else ()
        for k, item in items:
            path = f"{name}{key}" if k is None else f"{name}{key}[{named[k]}]" if named else element(f"{name}{key}", k)
            if isinstance(item, dict):
                out |= flat(item, f"{path}.", deep + 1)
            elif (number := _number(item)) is not None:
                out[path] = number
    return out


def _number(value: Any) -> float | None:
    """A number of a message; Protocol Buffers write long ones, and NaN, as text."""
    if isinstance(value, bool):
        return float(value)
    if isinstance(value, (int, float)):
        return float(value) if abs(value) < 1e300 or value != value else None
    if isinstance(value, str) and re.fullmatch(r"[+-]?(\d+(\.\d*)?([eE][+-]?\d+)?|NaN|nan|Infinity)", value.strip()):
        return float(value)
    return _stamp(value) if isinstance(value, str) else None


def _stamp(text: str) -> float | None:
    """A date with a time of day (ISO 8601) as seconds since 1970; None for another text."""
    try:
        moment = datetime.fromisoformat(text.strip()) if ":" in text and "-" in text else None
        return None if moment is None else (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return None


def _read_xml(path: Path) -> Stored:
    from lxml import etree

    text = re.sub(r"<\?xml[^>]*\?>", "", _text(path))
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise DataError(f"log {path}: declares a document type or entities, which no log needs; remove them.")
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False, remove_comments=True)
    try:
        root = etree.fromstring(f"<log>{text}</log>".encode(), parser)
    except etree.XMLSyntaxError as error:
        raise DataError(f"log {path}: is not XML ({reason(error)}).") from None
    records = list(root)
    if len(records) == 1:
        records = list(records[0])
    return table_of_messages((_attributes(record) for record in records), path)


def _attributes(record: Any, name: str = "", deep: int = 0) -> dict[str, Any]:
    """Attributes (`AIPos.A1`) and texts of the elements below a record."""
    out: dict[str, Any] = {f"{name}{key}": value for key, value in record.attrib.items()}
    if deep > _DEEP:
        return out
    text = (record.text or "").strip()
    if text and name:
        out[name.removesuffix(".")] = text
    for child in record:
        out |= _attributes(child, f"{name}{child.tag}.", deep + 1)
    return out


def _begins(start: bytes, marks: bytes) -> bool:
    return start.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in [bytes([m]) for m in marks]


JSON = register_log_format(
    LogFormat(
        "JSON messages",
        lambda path, start: _begins(start, b"{") or (_begins(start, b"[") and path.name.lower().removesuffix(".gz").endswith(".json")),
        _read_json,
        _json_recordings,
    )
)
XML = register_log_format(LogFormat("XML telegrams", lambda path, start: _begins(start, b"<"), _read_xml))

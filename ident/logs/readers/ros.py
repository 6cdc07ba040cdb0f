"""JointState messages exported to tables: a name array beside position, velocity and effort arrays.

Two layouts are read: one column an element (`field.name0`, `position_1`, `effort[2]`), and one column an array written as a
list (`['a', 'b']`). The result has the columns of the contract, `<joint>.position` and so on, for the names that occur."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import DataError
from .header import Header
from .tables import read_columns
from .text import read_text_columns

Array = np.ndarray
_ELEMENT = re.compile(r"^(?:.*[./])?(name|position|velocity|effort)[._]?\[?(\d+)\]?$", re.IGNORECASE)
_WHOLE = re.compile(r"^(?:.*[./])?(name|position|velocity|effort)$", re.IGNORECASE)
_STAMPS = (("secs", "nsecs"), ("sec", "nanosec"))
_FIELDS = ("position", "velocity", "effort")


@dataclass(frozen=True)
class JointStateColumns:
    """Which columns hold the arrays: field → element → column ("" as the only element of a list column)."""

    fields: Mapping[str, Mapping[int, str]]
    lists: bool
    time: tuple[str, ...]


def joint_state_columns(header: Header) -> JointStateColumns | None:
    """The layout, if the header is that of exported JointState messages with a name array; else None."""
    for pattern, lists in ((_ELEMENT, False), (_WHOLE, True)):
        fields: dict[str, dict[int, str]] = {}
        for source in header.names:
            match = pattern.match(source)
            if match:
                fields.setdefault(match[1].lower(), {})[0 if lists else int(match[2])] = source
        if "name" in fields and "position" in fields and set(fields["position"]) <= set(fields["name"]):
            return JointStateColumns(fields, lists, _time_columns(header.names))
    return None


def _time_columns(names: Sequence[str]) -> tuple[str, ...]:
    """The message's own stamp where there is one (seconds and nanoseconds, or one number), else the time of recording."""
    for seconds, nanoseconds in _STAMPS:
        pair = [next((n for n in names if re.search(rf"stamp[._/]{part}$", n)), None) for part in (seconds, nanoseconds)]
        if pair[0] is not None and pair[1] is not None:
            return (pair[0], pair[1])
    for pattern in (r"header\.stamp$", r"^%time$", r"^t$", r"^time(stamp)?(_s)?$"):
        found = next((n for n in names if re.search(pattern, n, re.IGNORECASE)), None)
        if found is not None:
            return (found,)
    return ()


def read_joint_states(path: Path, header: Header, layout: JointStateColumns, wanted: Sequence[str] | None) -> dict[str, Array]:
    """Columns `t` and `<joint>.<field>` of a JointState export.

    `wanted`: the robot's joints; rows whose name array lacks one of them (another publisher's messages) are left out.
    Without it, the names of the first row count. Raises DataError."""
    if not layout.time:
        raise DataError(f"log {path}: JointState columns, but no time stamp (header.stamp, %time or t).")
    stamps = read_columns(path, header, layout.time)
    if len(layout.time) == 2:
        time = stamps[layout.time[0]] + 1e-9 * stamps[layout.time[1]]
    else:
        time = stamps[layout.time[0]]
        if len(time) and np.nanmax(np.abs(time)) > 1e14:  # seconds since 1970 are 1e9: this counts nanoseconds
            time = (time - time[0]) * 1e-9 + time[0] * 1e-9
    names, values = (_list_arrays if layout.lists else _element_arrays)(path, header, layout)
    if not len(time):
        raise DataError(f"log {path}: there is a header, but no row of data.")
    wanted = tuple(wanted) if wanted else tuple(n for n in names[0] if n)
    out = {f"{joint}.{f}": np.full(len(time), np.nan) for joint in wanted for f in values}
    complete = np.zeros(len(time), bool)
    for group in sorted(set(names)):
        rows = np.array([n == group for n in names])
        if not set(wanted) <= set(group):
            continue
        complete |= rows
        for joint in wanted:
            k = group.index(joint)
            for f, matrix in values.items():
                if k < matrix.shape[1]:
                    out[f"{joint}.{f}"][rows] = matrix[rows, k]
    if not complete.any():
        raise DataError(f"log {path}: no message names all joints {', '.join(wanted)}; the first names {', '.join(names[0])}.")
    kept = {k: v[complete] for k, v in out.items()}
    return {"t": time[complete], **{k: v for k, v in kept.items() if k.endswith(".position") or not np.isnan(v).all()}}


def _element_arrays(path: Path, header: Header, layout: JointStateColumns) -> tuple[list[tuple[str, ...]], dict[str, Array]]:
    order = sorted(layout.fields["name"])
    text = read_text_columns(path, header, [layout.fields["name"][i] for i in order])
    names = list(zip(*(text[layout.fields["name"][i]] for i in order), strict=True))
    values = {}
    for f in _FIELDS:
        if f in layout.fields:
            sources = layout.fields[f]
            columns = read_columns(path, header, list(sources.values()))
            values[f] = np.column_stack([columns[sources[i]] if i in sources else np.full(len(names), np.nan) for i in order])
    return [tuple(str(n).strip().strip("'\"") for n in row) for row in names], values


def _list_arrays(path: Path, header: Header, layout: JointStateColumns) -> tuple[list[tuple[str, ...]], dict[str, Array]]:
    text = read_text_columns(path, header, [v[0] for v in layout.fields.values()])
    names = [tuple(_elements(cell)) for cell in text[layout.fields["name"][0]]]
    width = max((len(n) for n in names), default=0)
    values = {}
    for f in _FIELDS:
        if f in layout.fields:
            matrix = np.full((len(names), width), np.nan)
            for row, cell in enumerate(text[layout.fields[f][0]]):
                numbers = _elements(cell)
                try:
                    matrix[row, : len(numbers)] = [float(x) for x in numbers]
                except ValueError:
                    raise DataError(
                        f"log {path}: column {layout.fields[f][0]!r}, data row {row + 1}: {cell!r} is not a list of {width} numbers."
                    ) from None
            values[f] = matrix
    return names, values


def _elements(cell: str) -> list[str]:
    """The elements of a list written as `['a', 'b']`, `(1, 2)` or `[1 2]`."""
    inner = re.sub(r"^[a-z.]*array\(['\"]?\w?['\"]?,?", "", cell.strip()).strip("[](){} \n")
    return [e.strip().strip("'\"") for e in re.split(r"[,;\s]+", inner) if e.strip()]

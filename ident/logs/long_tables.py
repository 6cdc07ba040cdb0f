"""Long tables, a row for each joint and time, as one row a time."""

from __future__ import annotations

import re

import numpy as np

from ..errors import DataError
from .source import TableSource
from .words import TIME, words_of

Array = np.ndarray
_CHANNELS = {"variable", "field", "signal", "channel"}
_KEYS = {"id", "servo", "joint", "axis", "motor", "name", "actuator", "device"} | _CHANNELS
_NONE = ("", "nan", "None")
#: Joints that one table may interleave.
_MOST = 64


def long_table(source: TableSource) -> dict[str, Array] | None:
    """Columns `<name>[<joint>]` of a table that has a row for each joint and time, and its other columns at the first joint's rows; None
    where the file is no such table.

    A column whose name is a word for joints, with a few values that take turns (or come one after the other, over the same times), makes it
    one; joints that were read one after the other keep their readings, in the row of the first. Where the names are those of channels
    (`variable`) beside one column of values, they are the columns."""
    keys = [n for n in source.header.names if words_of(n) and words_of(n) <= _KEYS]
    if len(keys) != 1 or source.header.unnamed:
        return None
    try:
        every = source.labels(keys[0])
        if not _several(every):
            return None
        rest = [n for n in source.header.names if n != keys[0]]
        try:
            table = source.read(rest, ())
        except DataError:
            table = source.read([], rest)
        if any(len(column) != len(every) for column in table.values()):  # lines that are no rows were left out of the numbers
            every = source.labels(keys[0], len(next(iter(table.values()))))
    except (DataError, ValueError):
        return None
    told = np.array([x not in _NONE for x in every], bool)  # a last row that ends before its label is none
    labels, table = [x for x in every if x not in _NONE], {name: column[told] for name, column in table.items()}
    joints = _several(labels)
    if not joints:
        return None
    times = [name for name in table if words_of(name) & TIME]
    sweep = _sweeps(labels, joints)
    if sweep is None:
        sweep = _blocks(labels, joints, [table[name] for name in times])
    if sweep is None:
        return None
    values = [name for name in table if name not in times]
    channels = len(values) == 1 and words_of(keys[0]) <= _CHANNELS
    out: dict[str, Array] = {}
    for name, column in table.items():
        if name in times:
            out[name] = column[sweep[0]]
        else:
            # A number alone is no name: that of a joint is.
            named = {joint: joint if re.search("[A-Za-z]", joint) else f"joint {joint}" for joint in joints}
            out |= {joint if channels else f"{name}[{named[joint]}]": column[rows] for joint, rows in zip(joints, sweep, strict=True)}
    return out


def _several(labels: list[str]) -> list[str]:
    """The joints that a column names, where there are several, each of them more than once; else none."""
    joints = sorted({x: None for x in labels if x not in _NONE}, key=_counted)
    return joints if 2 <= len(joints) <= _MOST and len(labels) >= 2 * len(joints) else []


def _counted(label: str) -> tuple[float, str]:
    """Numbers in their order; names as they first come."""
    return (float(label), "") if label.isdecimal() else (0.0, "")


def _blocks(labels: list[str], joints: list[str], times: list[Array]) -> list[Array] | None:
    """For each joint its rows, where these come one joint after the other over the same times; None where they do not."""
    own = np.array(labels)
    rows = [np.flatnonzero(own == joint) for joint in joints]
    if not times or len({len(r) for r in rows}) > 1 or any(not np.array_equal(t[r], t[rows[0]]) for r in rows for t in times):
        return None
    return rows


def _sweeps(labels: list[str], joints: list[str]) -> list[Array] | None:
    """For each joint the rows that belong to whole sweeps over all joints; None where joints do not take turns."""
    place = {joint: k for k, joint in enumerate(joints)}
    at = np.array([place[x] for x in labels])
    rows: list[list[int]] = []
    current = [-1] * len(joints)
    for row, k in enumerate(at):
        if current[k] >= 0:
            current = [-1] * len(joints)  # a joint again before all were there: the sweep is not whole
        current[k] = row
        if min(current) >= 0:
            rows.append(current)
            current = [-1] * len(joints)
    if len(rows) * len(joints) < 0.9 * len(labels):
        return None
    return list(np.array(rows).T)

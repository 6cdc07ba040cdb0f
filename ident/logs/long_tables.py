"""Long tables, a row for each joint and time, as one row a time."""

from __future__ import annotations

import numpy as np

from ..errors import DataError
from .channels import words_of
from .source import TableSource

Array = np.ndarray
_KEYS = {"id", "servo", "joint", "axis", "motor", "name", "actuator", "device"}
#: Joints that one table may interleave.
_MOST = 64


def long_table(source: TableSource) -> dict[str, Array] | None:
    """Columns `<name>[<joint>]` of a table that has a row for each joint and time, and its other columns at the first joint's rows; None
    where the file is no such table.

    A column whose name is a word for joints, with a few values that take turns, makes it one; joints that were read one after the other
    keep their readings, in the row of the first."""
    keys = [n for n in source.header.names if words_of(n) and words_of(n) <= _KEYS]
    if len(keys) != 1 or source.header.unnamed:
        return None
    try:
        labels = source.labels(keys[0])
    except (DataError, ValueError):
        return None
    joints = list(dict.fromkeys(labels))
    if not 2 <= len(joints) <= _MOST or len(labels) < 2 * len(joints):
        return None
    rest = [n for n in source.header.names if n != keys[0]]
    try:
        table = source.read(rest, ())
    except DataError:
        table = source.read([], rest)
    sweep = _sweeps(labels, joints)
    if sweep is None:
        return None
    out: dict[str, Array] = {}
    for name, values in table.items():
        if words_of(name) & {"t", "time", "timestamp", "ms", "stamp", "sec", "secs"}:
            out[name] = values[sweep[0]]
        else:
            out |= {f"{name}[joint {joint}]": values[rows] for joint, rows in zip(joints, sweep, strict=True)}
    return out


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

"""Joint states of one topic as one table, whoever sent them: by the joints they name, on one clock."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..._utils.text import counted
from .joint_states import FIELDS, JointStates

Array = np.ndarray
#: Names that messages show, at most.
_SHOWN = 8


def by_publisher(states: Sequence[JointStates], notes: list[str], path: Path) -> tuple[Array, dict[str, Array]]:
    """Columns on the clock of the messages that name most joints; those of other joints on the same topic are brought to that clock."""
    main = _main(states)
    rows = _of_one_sender([s for s in states if main <= frozenset(s.joints)], notes, path)
    clock, columns = table_of(rows)
    others = [s for s in states if not main <= frozenset(s.joints)]
    if others:
        names = sorted({name for s in others for name in s.joints} - {name for s in rows for name in s.joints})
        columns |= {name: v for name, v in onto(clock, others).items() if name not in columns}
        told, count = ", ".join(names[:_SHOWN]) or "only some of them", sum(map(len, others))
        several = counted(count, "message", "name", of=" on the same topic")
        notes.append(f"log {path}: {several} other joints ({told}); brought to the clock of the others.")
    return clock, columns


def _of_one_sender(states: list[JointStates], notes: list[str], path: Path) -> list[JointStates]:
    """The messages of the sender that gives most numbers, of several that name the same joints at the same time: one that fills other
    fields than another (a driver, and something that shows a model), or has a connection of its own."""
    own: dict[tuple[int, tuple[str, ...]], list[JointStates]] = defaultdict(list)
    for s in states:
        own[s.sender, tuple(sorted(s.values))].append(s)
    numbers = {key: sum(v.size for s in found for v in s.values.values()) for key, found in own.items()}
    best = max(own, key=lambda key: numbers[key])
    kept = list(own.pop(best))
    begin, end = (pick(float(pick(s.stamp)) for s in kept) for pick in (min, max))
    for (_, fields), found in own.items():
        if all(float(s.stamp.max()) < begin or float(s.stamp.min()) > end for s in found):
            kept += found
            continue
        lacks = ", ".join(sorted(set(best[1]) - set(fields)))
        several = counted(sum(map(len, found)), "message", "name", of=" on the same topic")
        notes.append(f"log {path}: {several} the same joints{f' without {lacks}' if lacks else ''}: another sender's, which are not used.")
    return kept


def _main(states: Sequence[JointStates]) -> frozenset[str]:
    """The joints that most numbers are of."""
    groups: Counter[frozenset[str]] = Counter()
    for s in states:
        groups[frozenset(s.joints)] += len(s)
    return max(groups, key=lambda joints: (groups[joints] * len(joints), len(joints)))


def table_of(states: Sequence[JointStates]) -> tuple[Array, dict[str, Array]]:
    """Times (N,) in order, and columns by joint and field; NaN where a message does not have it."""
    stamp, received = (np.concatenate([getattr(s, what) for s in states]) for what in ("stamp", "received"))
    order = np.lexsort((received, stamp))
    place = {name: k for k, name in enumerate(dict.fromkeys(name for s in states for name in s.joints))}
    table = {field: np.full((len(stamp), len(place)), np.nan) for field in dict.fromkeys(f for s in states for f in s.values)}
    start = 0
    for s in states:
        at = [place[name] for name in s.joints]
        for field, values in s.values.items():
            table[field][start : start + len(s), at] = values
        start += len(s)
    by_field = {field: table[field] for field in dict.fromkeys((*FIELDS, *table)) if field in table}
    return stamp[order], {f"{name}.{field}": values[order, k] for field, values in by_field.items() for name, k in place.items()}


def onto(clock: Array, messages: Sequence[JointStates]) -> dict[str, Array]:
    """Columns of messages with another clock, linear between them, NaN before the first and after the last."""
    t, columns = table_of(messages)
    out: dict[str, Array] = {}
    for name, values in columns.items():
        known = np.isfinite(values)
        if known.any():
            out[name] = np.interp(clock, t[known], values[known], left=np.nan, right=np.nan)
    return out


def recent(messages: Sequence[JointStates], moment: float) -> list[JointStates]:
    """Messages from a moment on, and of each kind the last one before it, between which values at later times lie."""
    last: dict[tuple[tuple[str, ...], tuple[str, ...]], JointStates] = {}
    later = list[JointStates]()
    for s in messages:
        before = np.flatnonzero(s.stamp < moment)
        if len(before):
            row = s.of(before[[int(np.argmax(s.stamp[before]))]])
            key = s.joints, tuple(s.values)
            if key not in last or last[key].stamp[0] <= row.stamp[0]:
                last[key] = row
        later.append(s.of(s.stamp >= moment))
    return [*last.values(), *(s for s in later if len(s))]

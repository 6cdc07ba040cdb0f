"""Runs put together again from the parts that `LogSet.split` made of them: what is simulated goes on where a part ends."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np

from .log import Log, run_of

Array = np.ndarray
#: Samples, in usual ones, that may lie between two parts of one run.
_NEXT = 1.5


def whole_runs(parts: Iterable[Log], before: Iterable[Log] = ()) -> list[tuple[Log, dict[str, slice]]]:
    """Runs of which `parts` are some, from their beginning on as far as it is among `before` and them, and which rows (a slice by name)
    are those of each part. Parts that do not follow each other without a gap are runs of their own."""
    wanted = list(parts)
    runs: dict[tuple[str, str, float], list[Log]] = {}
    for log in (*before, *wanted):
        runs.setdefault((run_of(log.name), log.source, log.began), []).append(log)
    out = []
    for own in runs.values():
        for group in _together(sorted(own, key=lambda log: float(log.t[0]))):
            ends = np.cumsum([0, *(len(log) for log in group)])
            rows = {
                log.name: slice(int(start), int(stop))
                for log, (start, stop) in zip(group, pairwise(ends), strict=True)
                if any(log is one for one in wanted)
            }
            if rows:
                out.append((group[0] if len(group) == 1 else _joined(group), rows))
    return out


def _together(parts: list[Log]) -> list[list[Log]]:
    """Those of one run (in order) that follow each other."""
    groups = [[parts[0]]]
    for log in parts[1:]:
        last = groups[-1][-1]
        usual = float(np.median(np.diff(last.t))) if len(last) > 1 else 0.0
        if 0.0 < float(log.t[0] - last.t[-1]) <= _NEXT * usual and _columns(log) == _columns(last):
            groups[-1].append(log)
        else:
            groups.append([log])
    return groups


def _columns(log: Log) -> tuple[Any, ...]:
    """Which quantities a log holds."""
    arrays = tuple(f.name for f in fields(log) if isinstance(getattr(log, f.name), np.ndarray))
    return arrays, tuple(sorted(log.tau)), tuple(sorted(log.extra))


def _joined(parts: list[Log]) -> Log:
    first = parts[0]
    own: dict[str, Any] = {}
    for name in (f.name for f in fields(first)):
        values = [getattr(log, name) for log in parts]
        if isinstance(values[0], np.ndarray):
            own[name] = np.concatenate(values)
        elif isinstance(values[0], Mapping) and name in ("tau", "extra"):
            own[name] = {key: np.concatenate([value[key] for value in values]) for key in values[0]}
    return replace(first, name=run_of(first.name), **own)

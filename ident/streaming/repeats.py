"""Rows of a stored run that repeat the row before them while the joints move: `ident.logs.repair.repeated_rows` by pieces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ..logs.repair import FEWEST, REPEATS, moving_rows, same_rows, step_sizes, usual_steps
from .disk import PASS, DiskArray
from .stored import is_desired

Array = np.ndarray


def repeated_places(arrays: Mapping[str, DiskArray], places: Array | None, rows: int) -> Array:
    """Which rows of the arrays repeat the row before them. `places`: of their rows in the file, where some of its `rows` are not stored."""
    none = np.zeros(0, np.int64)
    if not any(k.startswith("tau") for k in arrays) or rows < FEWEST:
        return none
    channels = [a for k, a in arrays.items() if k != "t" and not is_desired(k)]
    found = [
        np.flatnonzero(_beside(same_rows([a[start:stop] for a in channels]), places, start)) + start
        for start, stop, _ in _stretches(arrays)
    ]
    same = np.unique(np.concatenate(found))
    if not len(same) or len(same) > REPEATS * rows:
        return none
    q = arrays["q"] if "q" in arrays else arrays["q_motor"]
    counts = [step_sizes(_apart(q[start:stop], places, start)[0]) for start, stop, _ in _stretches(arrays)]
    usual = usual_steps(np.sum(counts, axis=0))
    out = []
    for start, stop, own in _stretches(arrays):
        first = max(0, start - 1)
        mine = same[(same >= own) & (same < stop)]
        if len(mine):
            positions, at = _apart(q[first : min(stop + 1, len(q))], places, first)
            out.append(mine[moving_rows(positions, usual)[at[mine - first]]])
    return np.concatenate(out) if out else none


def _stretches(arrays: Mapping[str, DiskArray]) -> Iterator[tuple[int, int, int]]:
    """Rows that are read at a time, one before those that are new, and the first of these."""
    rows = len(arrays["t"])
    for own in range(0, rows, PASS):
        yield max(0, own - 1), min(own + PASS, rows), own


def _beside(same: Array, places: Array | None, start: int) -> Array:
    """`same`, but for rows before which a row of the file is missing."""
    if places is not None:
        same[1:] &= np.diff(places[start : start + len(same)]) == 1
    return same


def _apart(positions: Array, places: Array | None, start: int) -> tuple[Array, Array]:
    """Positions with a row of none where rows of the file are missing, so that no step leads over them; and where each row went."""
    own = np.arange(len(positions))
    if places is None:
        return positions, own
    gaps = np.flatnonzero(np.diff(places[start : start + len(positions)]) > 1) + 1
    return np.insert(positions, gaps, np.nan, axis=0), own + np.searchsorted(gaps, own, side="right")

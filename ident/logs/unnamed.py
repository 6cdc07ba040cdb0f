"""A table whose columns nobody named: what its numbers look like, as a proposal to confirm, never acted upon."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Array = np.ndarray
#: Rates agree with a column's change where they correlate so well.
_AGREES = 0.95


def proposal(names: Sequence[str], columns: Sequence[Array]) -> str:
    """What the columns look like, in words that can be pasted into a study file; "" where nothing is recognised.

    A time is a column that only rises; velocities are columns that follow the change of as many columns before them."""
    finite = [k for k, c in enumerate(columns) if np.isfinite(c).all()]
    time = next((k for k in finite if np.all(np.diff(columns[k]) > 0)), None)
    if time is None or len(columns[time]) < 20:
        return ""
    t = np.asarray(columns[time], float)
    rate = {k: np.gradient(np.asarray(columns[k], float), t) for k in finite if k != time}
    for n in range(min(60, (len(columns) - 1) // 2), 0, -1):
        for first in range(len(columns) - 2 * n + 1):
            q, dq = range(first, first + n), range(first + n, first + 2 * n)
            if time not in (*q, *dq) and all(k in rate for k in (*q, *dq)) and _follow([rate[k] for k in q], [columns[k] for k in dq]):
                return _said(names, time, first, n, len(columns))
    return ""


def _follow(rates: Sequence[Array], logged: Sequence[Array]) -> bool:
    """Whether columns are the rates of others."""
    return all(np.ptp(a) > 0 and np.ptp(b) > 0 and np.corrcoef(a, b)[0, 1] >= _AGREES for a, b in zip(rates, logged, strict=True))


def _said(names: Sequence[str], time: int, first: int, n: int, count: int) -> str:
    q = ", ".join(f'q{j + 1} = "{names[first + j]}"' for j in range(n))
    dq = ", ".join(f'dq{j + 1} = "{names[first + n + j]}"' for j in range(n))
    rest = list(range(first + 2 * n, count))
    blocks = [f"{names[rest[i]]} … {names[rest[i + n - 1]]}" for i in range(0, len(rest) - n + 1, n)]
    torque = f" Torque (tau1 …, N m) or current (i1 …, A) may be {' or '.join(blocks)}: the numbers alone do not say." if blocks else ""
    return (
        f"{names[time]} increases like a time, and {names[first + n]} … {names[first + 2 * n - 1]} look like the velocities of"
        f' {names[first]} … {names[first + n - 1]}. If so, write under [columns] of a study file: t = "{names[time]}", {q}, {dq}.{torque}'
    )

"""Outliers among errors of unknown size, of which the others tell how much they differ."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
#: Of fits in which no stretch is another than the others, the share that is told of one.
BY_CHANCE = 0.01


def beyond(errors: Array, level: float) -> float:
    """What an error among these (n,) has to exceed to be no such error: one-sided outliers of the logarithms (Rosner, 1983), of which
    less than half are some; by chance, one is told with probability `level`."""
    from scipy.special import stdtrit

    logs = np.sort(np.log(np.maximum(errors, 1e-300)))
    bound = np.inf
    for out in range(1, (len(logs) + 1) // 2):
        rest = logs[:-out]
        m = len(rest)
        limit = np.mean(rest) + np.std(rest, ddof=1) * np.sqrt(1.0 + 1.0 / m) * stdtrit(m - 1, 1.0 - level / (m + 1))
        if logs[-out] > limit:
            bound = min(bound, float(limit))
    return float(np.exp(bound))

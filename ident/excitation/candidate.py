"""A trajectory that a search has come to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class TrajectoryCandidate:
    """A trajectory of a family: `offset` (n,), `coefficients` (C, n), the value of the measure."""

    offset: Array
    coefficients: Array
    value: float

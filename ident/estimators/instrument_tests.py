"""Tests around instrumental variables: is least squares biased, are the instruments valid, are they strong?

All are tests of Hausman's kind, on the difference of two estimates of the same parameters. Its covariance is that of the
difference of their scores under the noise's own colour, so it is right where the usual difference of two covariances is
not even positive (Durbin 1954; Wu 1973; Hausman 1978; revised for coloured noise)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._utils.singular_values import pinv

Array = np.ndarray
#: Directions of the difference whose variance is below this share of the largest are round-off.
_NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class DifferenceTest:
    """`statistic` is χ² with `degrees` degrees of freedom if both estimates are consistent; `p_value`; `largest`: the
    greatest difference of one parameter in standard deviations of the instrumental estimate, and its `name`."""

    statistic: float
    degrees: int
    p_value: float
    largest: float
    name: str

    def relaxed(self, factor: float) -> DifferenceTest:
        """The same test where variances are `factor` times what was thought, if that is more than once."""
        statistic = self.statistic / max(1.0, factor)
        return replace(self, statistic=statistic, p_value=_exceeded(statistic, self.degrees))

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "statistic": self.statistic, "degrees": self.degrees, "p_value": self.p_value, "largest": self.largest, "parameter": self.name,
        }  # fmt: skip


def difference_test(difference: Array, gram: Array, std: Array, names: tuple[str, ...]) -> DifferenceTest:
    """Test that a difference (b,) with covariance `gram` (b, b) is zero; `std` (b,): scale of each parameter."""
    scale = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    live = values > _NEGLIGIBLE * max(float(values[-1]), 1e-300)
    along = vectors[:, live].T @ (difference / scale)
    statistic, degrees = float(np.sum(along**2 / values[live])), int(live.sum())
    worst = int(np.argmax(np.abs(difference / scale)))
    p_value, largest = _exceeded(statistic, degrees), float(abs(difference[worst] / scale[worst]))
    return DifferenceTest(statistic, degrees, p_value, largest, names[worst])


def _exceeded(statistic: float, degrees: int) -> float:
    """Probability that χ² with these degrees of freedom is larger."""
    from scipy.special import chdtrc  # scipy.stats, which has the same, takes a second to import

    return float(chdtrc(max(1, degrees), statistic))


def shea_strength(cross: Array, gram: Array, own: Array, samples: float) -> Array:
    """F statistics (b,): how much of each column the instruments explain beyond the others (Shea 1997).

    `cross` ZᵀWΦ, `gram` ZᵀWZ, `own` ΦᵀWΦ, all (b, b) and scaled alike; `samples`: independent ones."""
    b = len(cross)
    root = np.linalg.cholesky(gram + 1e-13 * np.trace(gram) / b * np.eye(b))
    from scipy.linalg import solve_triangular

    seen = solve_triangular(root, cross, lower=True)
    variance_own = np.diag(pinv(own, hermitian=True))
    variance_iv = np.diag(pinv(seen.T @ seen, hermitian=True))
    share = np.clip(variance_own / np.maximum(variance_iv, 1e-300), 0.0, 1.0 - 1e-12)
    return share / (1.0 - share) * max(samples - b, 1.0) / b

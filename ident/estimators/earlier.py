"""An earlier fit as prior knowledge: rows on the base parameters of another problem."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError
from ..estimate.estimate import Estimate

if TYPE_CHECKING:
    from ..regressor.base_parameters.reduction import BaseReduction

Array = np.ndarray


def load_earlier(prior: Estimate | str | Path) -> Estimate:
    """An estimate, or the one saved at a path."""
    return prior if isinstance(prior, Estimate) else Estimate.load(prior)


def prior_rows(base: BaseReduction, earlier: Estimate) -> tuple[Array, Array]:
    """Rows (R (r, b), z (r,)) of unit variance that say of the base parameters what the earlier estimate knows.

    Raises ConfigurationError where the earlier fit's parameters cannot be written in this model's base parameters."""
    from scipy.linalg import solve_triangular

    names = [p.name for p in base.parameters]
    known = [p.name for p in earlier.base.parameters]
    unknown = [name for name, used in zip(known, np.any(earlier.base.regroup != 0, axis=0), strict=True) if used and name not in names]
    if unknown:
        raise ConfigurationError(
            f"the earlier fit has parameters that this model lacks ({', '.join(unknown[:4])});"
            " use a fit of the same robot whose effects are among these."
        )
    regroup = np.zeros((len(earlier.values), len(names)))
    for i, name in enumerate(known):
        if name in names:
            regroup[:, names.index(name)] = earlier.base.regroup[:, i]
    combine = regroup[:, base.independent]
    if np.abs(combine @ base.regroup - regroup).max(initial=0.0) > 1e-6 * max(1.0, float(np.abs(regroup).max(initial=0.0))):
        raise ConfigurationError("the earlier fit groups parameters in a way that this model cannot express; fit it anew.")
    std = np.where(earlier.std > 0, earlier.std, 1e-300)
    correlation = earlier.covariance / np.outer(std, std)
    lower = np.linalg.cholesky(correlation + 1e-12 * np.eye(len(std)))
    rows = solve_triangular(lower, np.column_stack([combine, earlier.values]) / std[:, None], lower=True)
    return rows[:, :-1], rows[:, -1]

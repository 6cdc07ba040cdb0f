"""Estimate: the one result of every estimator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from ..statistics.torque_error import TorqueError
from .io import save, to_dict
from .record import EstimateRecord
from .saved import load
from .summary import estimate_summary


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(EstimateRecord):
    """The one result of every estimator: base parameters with covariance, noise, errors and status.

    Its fields are those of `EstimateRecord`. It prints as a table, saves and loads as JSON, and predicts torque.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=test)
    >>> estimate.status.code.value
    'ok'
    """

    def with_heldout(self, error: TorqueError) -> Self:
        """The same estimate with its error on data it did not see."""
        return replace(self, heldout_error=error)

    def summary(self) -> str:
        """A report for people: value ± std, unit, t-ratio, expression, status."""
        return estimate_summary(self)

    def __str__(self) -> str:
        return self.summary()

    def to_dict(self) -> dict[str, Any]:
        """The `ident.fit/1` result (docs/formats.md)."""
        return to_dict(self)

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the whole estimate (robot, model, information) as JSON, atomically. Refuses to overwrite without `force`."""
        return save(self, Path(path), force=force)

    @staticmethod
    def load(path: str | Path) -> Estimate:
        """Read an estimate that `save` wrote. Raises ConfigurationError for anything else."""
        return load(Estimate, Path(path))

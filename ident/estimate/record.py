"""What an estimator found: fields and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from ..errors import unknown_name
from ..problem.information import Information
from ..problem.problem import Problem, error_on
from ..regressor.base_parameters.reduction import BaseReduction
from ..robots.parameters import Parameter
from ..signals.known_band import within_known_band
from ..statistics.noise import NoiseModel
from ..statistics.torque_error import TorqueError
from .status import Status

if TYPE_CHECKING:
    from ..model import Model
    from ..signals.signals import Signals

Array = np.ndarray


@dataclass(frozen=True)
class ReversalsLeftOut:
    """Rows of a joint near its velocity reversals that a fit leaves out: `rows` of `usable` ones (None: an older file does not say)."""

    joint: str
    rows: int | None = None
    usable: int | None = None

    def __str__(self) -> str:
        if not self.rows or not self.usable:
            return self.joint
        return f"{self.joint} {self.rows} ({100 * self.rows / self.usable:.0f} %)"


@dataclass(frozen=True, eq=False, repr=False)
class EstimateRecord(ShortRepr):
    """Base parameters with covariance.

    `base`: the reduction whose b base parameters were estimated (grouped further than the model's own where the data
    could not tell them apart); `values` (b,), `covariance` (b, b). `noise`: the residual's noise per measured row.
    `reversals_left_out`: rows near velocity reversals that are left out, because they scatter more than the others, by joint.
    `problem`: what was solved, for diagnosis in the same session (not saved).
    `weights` (n,): weight of each row (1/variance). `reference` (k,): all parameters, from which the predicted load was taken."""

    method: str
    model: Model
    base: BaseReduction
    values: Array
    covariance: Array
    status: Status
    fit_error: TorqueError
    noise: NoiseModel
    weights: Array
    condition: float
    samples: int
    information: Information | None = None
    reference: Array | None = None
    dropped: tuple[str, ...] = ()
    reversals_left_out: tuple[ReversalsLeftOut, ...] = ()
    warnings: tuple[str, ...] = ()
    heldout_error: TorqueError | None = None
    inputs: tuple[dict[str, Any], ...] = ()
    signals_config: dict[str, Any] = field(default_factory=dict)
    trace: dict[str, Any] = field(default_factory=dict)
    problem: Problem | None = field(default=None, repr=False)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameter that gives each base parameter its name."""
        return tuple(self.base.parameters[i] for i in self.base.independent)

    @property
    def names(self) -> tuple[str, ...]:
        return self.base.names

    @cached_property
    def std(self) -> Array:
        """Standard deviations (b,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def correlation(self) -> Array:
        """Correlation matrix (b, b)."""
        std = np.where(self.std > 0, self.std, 1.0)
        return self.covariance / np.outer(std, std)

    @cached_property
    def all_values(self) -> Array:
        """All k parameters of the model that give the same torques (grouped ones zero): for prediction, not physical."""
        return self.base.expand(self.values)

    def value(self, name: str) -> float:
        """Value of a base parameter by its name. Raises ConfigurationError for an unknown one."""
        return float(self.values[self.index(name)])

    def index(self, name: str) -> int:
        """Place of a base parameter. Raises ConfigurationError for an unknown one."""
        if name not in self.names:
            raise unknown_name("base parameter", name, self.names)
        return self.names.index(name)

    def confidence_interval(self, level: float = 0.95) -> Array:
        """Two-sided intervals (b, 2), normal."""
        from scipy.stats import norm

        half = float(norm.ppf(0.5 + level / 2)) * self.std
        return np.stack([self.values - half, self.values + half], axis=1)

    def predict(self, signals: Signals) -> Array:
        """Torque (M, n) on the measured side for prepared signals, filtered like their torque."""
        return self.problem_on(signals).predict(self._structural_values)

    def residual(self, signals: Signals) -> Array:
        """Measured minus predicted torque (M, n), NaN in rows that are not used."""
        return self.problem_on(signals).residual(self._structural_values)

    def torque_error(self, signals: Signals) -> TorqueError:
        """Torque error on prepared signals; on raw differences of positions, within the band where the motion is known."""
        judged = within_known_band(signals)
        return error_on(judged, self.residual(judged), raw=judged is not signals)

    def problem_on(self, signals: Signals) -> Problem:
        """The estimate's model on prepared signals, as it was fitted: without rows near reversals that were left out."""
        return Problem(self.model, signals.without_reversals(r.joint for r in self.reversals_left_out), reference=self.all_values)

    @cached_property
    def _structural_values(self) -> Array:
        return self.model.base.base_values(self.all_values)

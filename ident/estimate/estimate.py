"""Estimate: the one result of every estimator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..drawing.document import Figure, Section
from ..drawing.figures import draw_on
from ..drawing.shown import Shown
from ..errors import ConfigurationError
from ..signals.likewise import likewise
from ..signals.signals import Signals
from ..statistics.torque_error import TorqueError
from .feedforward import FixedModel
from .io import save, to_dict
from .pictures import estimate_frame, estimate_sections, torque_figure, values_figure
from .record import EstimateRecord
from .saved import load
from .summary import estimate_summary

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd
    from matplotlib.axes import Axes


Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Shown, EstimateRecord):
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

    def figure(self) -> Figure:
        """Each parameter with its 95 % interval; see `plot`."""
        return values_figure(self)

    def to_frame(self) -> pd.DataFrame:
        """One row for each base parameter: value, std, 95 % interval, unit, effect, joint, whether significant, expression."""
        return estimate_frame(self)

    def sections(self) -> tuple[Section, ...]:
        """Status, torque errors and parameters."""
        return estimate_sections(self)

    def plot_torque(self, signals: Any | None = None, ax: Axes | Sequence[Axes] | None = None) -> Any:
        """Draw for each joint measured against predicted torque, and beside them the residual.

        Parameters
        ----------
        signals : Signals or logs, optional
            Signals, or logs to be `prepared`; by default what was fitted, which a saved estimate does not hold.
        ax : Axes or sequence of Axes, optional
            See `plot`.

        Returns
        -------
        Axes or array of Axes
        """
        if signals is None and self.problem is None:
            raise ConfigurationError("a saved estimate does not hold the signals it was fitted to; give some: plot_torque(signals).")
        assert signals is not None or self.problem is not None
        shown = self.prepared(signals) if signals is not None or self.problem is None else self.problem.signals
        return draw_on(torque_figure(self, shown), ax)

    def feedforward(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torque of a motion by the fitted model, friction and rotor inertia included; made for a control loop.

        Parameters
        ----------
        q, dq, ddq : (n,) or (N, n) array
            Position, velocity and acceleration on the joint side, rad, rad/s, rad/s² (m, …): one state, or many.

        Returns
        -------
        (n,) or (N, n) array
            Torque on the measured side, N m (N): what the log would show without noise.

        Notes
        -----
        The first call prepares the model; one compiled call follows if every effect is a rigid body or a declared factor of its joint's
        motion (rotor inertia, viscous and Coulomb friction, offset, linear spring).

        Examples
        --------
        >>> import ident
        >>> import numpy as np
        >>> train, test = ident.demo_logs()
        >>> estimate = ident.fit(train, "puma560", held=0)
        >>> estimate.feedforward(np.zeros(6), np.zeros(6), np.zeros(6)).shape
        (6,)
        """
        return self._fixed.torque(q, dq, ddq)

    def prepared(self, logs: Any) -> Signals:
        """Logs, prepared as those of the fit were: the same derivatives, cut-offs and rows.

        Parameters
        ----------
        logs : str, Path, DataFrame, Log, LogSet, sequence or Signals
            Anything that `ident.read_logs` reads, or logs that it has read; signals are returned as they are.

        Returns
        -------
        Signals

        Examples
        --------
        >>> import ident
        >>> train, test = ident.demo_logs()
        >>> estimate = ident.fit(train, "puma560", held=0)
        >>> estimate.prepared(test).report.cutoff_hz == estimate.problem.signals.report.cutoff_hz
        True
        """
        report = self.signals_config or (None if self.problem is None else self.problem.signals.report.to_dict())
        if isinstance(logs, Signals):
            return logs
        if not report:
            raise ConfigurationError(
                "this estimate does not hold how its logs were prepared; prepare these with ident.ZeroPhase()(logs, robot)."
            )
        return likewise(logs, self.model.robot, report)

    def forward_dynamics(self, q: Array, dq: Array, tau: Array) -> Array:
        """Joint acceleration at a torque on the measured side by the fitted model; states and shapes as for `feedforward`.

        Raises DataError where the estimated inertia matrix is singular."""
        return self._fixed.acceleration(q, dq, tau)

    @cached_property
    def _fixed(self) -> FixedModel:
        return FixedModel(self.model, self.all_values)

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

"""Before and after: two estimates on the same data, joint by joint."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from ..drawing.document import Figure, Role, Section
from ..drawing.shown import Shown
from ..errors import ConfigurationError
from ..estimate.pictures import dots_figure, error_frame, error_section
from ..estimate.summary import error_table
from ..problem.problem import error_on
from ..signals.known_band import within_known_band
from ..statistics.torque_error import TorqueError, number

if TYPE_CHECKING:
    import pandas as pd

    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

Array = np.ndarray
#: Blocks of time of each run over which the standard error of a gain is taken.
_BLOCKS = 20


@dataclass(frozen=True, eq=False)
class Shift:
    """How one base parameter moved: values and stds before and after, and the move in units of the std before."""

    name: str
    unit: str
    before: float
    std_before: float
    after: float
    std_after: float

    @property
    def sigmas(self) -> float:
        """Move over the std before (how much bias the old model carried, as it saw itself)."""
        return (self.after - self.before) / self.std_before if self.std_before > 0 else float("nan")


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Shown, ShortRepr):
    """Errors of two estimates on data that neither fitted, on the rows that both use.

    `floor` (n,): rms of the residual that the later estimate leaves on its own fit, per joint (the earlier one where the later one was
    fitted to no row of a joint; NaN, and no part of `gain`, where neither was); `shifts`: common parameters,
    the largest move first; `gain_std`: standard error of `gain` over blocks of time; `block_squares` (2, B, n): squared error before and
    after, summed over each block, per joint.

    See `ident.compare`.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> robot = ident.load_robot("puma560")
    >>> estimate = ident.fit(train, robot, held=0)
    >>> comparison = ident.compare(estimate, estimate, ident.ZeroPhase()(test, robot))
    >>> bool(abs(comparison.gain) < 1e-12)
    True
    """

    before: Estimate
    after: Estimate
    error_before: TorqueError
    error_after: TorqueError
    floor: Array
    shifts: tuple[Shift, ...]
    gain_std: float = float("nan")
    block_squares: Array = field(default_factory=lambda: np.zeros((2, 0, 0)))

    @property
    def gain(self) -> float:
        """Share of the squared error over all joints, each weighted by its noise, that the later estimate removes."""
        weight = 1.0 / np.maximum(self.floor, 1e-300) ** 2
        seen = np.isfinite(self.error_before.rms) & (self.error_before.rows > 0) & np.isfinite(weight)
        total = [float(np.sum((weight * e.rms**2 * e.rows)[seen])) for e in (self.error_before, self.error_after)]
        return 1.0 - total[1] / total[0] if total[0] > 0 else 0.0

    @property
    def errors(self) -> dict[str, TorqueError]:
        """Torque errors before and after."""
        return {"before": self.error_before, "after": self.error_after}

    def figure(self) -> Figure:
        """Relative torque error of each joint before and after; see `plot`."""
        caption = "Relative torque error on data that neither estimate was fitted to, on the rows that both use."
        return dots_figure(self.after.model.robot, self.errors, (Role.BEFORE, Role.AFTER), "Torque error before and after", caption)

    def to_frame(self) -> pd.DataFrame:
        """One row per joint and one for all: rms (N m, N) and relative torque error (a share) before and after."""
        return error_frame(self.after.model.robot, self.errors)

    def sections(self) -> tuple[Section, ...]:
        """Torque errors before and after."""
        return (error_section(self.after.model.robot, self.errors, "Torque error before and after"),)

    def to_dict(self) -> dict[str, Any]:
        """JSON form (without the common fields)."""
        return {
            "before": {"fit": self.before.fit_error.to_dict(), "heldout": self.error_before.to_dict()},
            "after": {"fit": self.after.fit_error.to_dict(), "heldout": self.error_after.to_dict()},
            "noise_floor": [number(x) for x in self.floor],
            "gain": number(self.gain),
            "gain_std": number(self.gain_std),
            "shifts": [
                {"name": s.name, "unit": s.unit, "before": s.before, "std_before": s.std_before, "after": s.after, "std_after": s.std_after,
                 "sigmas": number(s.sigmas)}
                for s in self.shifts
            ],
        }  # fmt: skip

    def __str__(self) -> str:
        lines = [error_table(self.after, {"before": self.error_before, "after": self.error_after})]
        doubt = f" ± {100 * self.gain_std:.1f}" if np.isfinite(self.gain_std) else ""
        change = "falls" if self.gain >= 0 else "grows"
        lines.append(f"squared error, weighted by noise, {change} by {100 * abs(self.gain):.1f}{doubt} %")
        moved = [s for s in self.shifts if abs(s.sigmas) > 2][:8]
        if moved:
            lines.append("parameters that changed by more than two of their earlier standard deviations:")
            lines += [f"  {s.name}: {s.before:.5g} -> {s.after:.5g} {s.unit} ({s.sigmas:+.1f} std)" for s in moved]
        return "\n".join(lines)


def compare(before: Estimate, after: Estimate, signals: Any, *, before_signals: Signals | None = None) -> Comparison:
    """Compare two estimates on data that neither was fitted to.

    Parameters
    ----------
    before, after : Estimate
        Two estimates of the same robot.
    signals : Signals or logs
        Data held out from both; logs (also a path) are prepared as those of `after` were.
        The errors are over the rows that both use. Raw differences of positions are judged within the band
        where the motion is known, so that the better model has the smaller error.
    before_signals : Signals, optional
        The same logs as the earlier estimate's robot sees them, where its transmission is another one.

    Returns
    -------
    Comparison
        Torque error of both for each joint, the gain with its standard error, and how far the common parameters moved.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> robot = ident.load_robot("puma560")
    >>> before = ident.fit(train, robot, model=ident.friction.Viscous(), held=0)
    >>> after = ident.fit(train, robot, held=0)
    >>> comparison = ident.compare(before, after, test)
    >>> bool(comparison.error_after.relative_all < comparison.error_before.relative_all)
    True
    """
    old = {name: i for i, name in enumerate(before.names)}
    shifts = [
        Shift(
            p.name, p.unit, float(before.values[old[p.name]]), float(before.std[old[p.name]]), float(after.values[i]), float(after.std[i])
        )
        for i, p in enumerate(after.parameters)
        if p.name in old
    ]
    shifts.sort(key=lambda s: -abs(s.sigmas) if np.isfinite(s.sigmas) else 0.0)
    signals = after.prepared(signals)
    own = signals if before_signals is None else before_signals
    if own.tau.shape != signals.tau.shape:
        raise ConfigurationError("the two estimates' signals have different rows; prepare both from the same logs in the same way.")
    judged = within_known_band(signals)
    raw = judged is not signals
    own, signals = (within_known_band(own, judged.report.cutoff_hz) if raw else own), judged
    residuals = [before.residual(own), after.residual(signals)]
    # Joints that stick lose rows, and each estimate says for itself which do: only common rows compare like with like.
    common = np.isfinite(residuals[0]) & np.isfinite(residuals[1])
    first, second = (np.where(common, r, np.nan) for r in residuals)
    floor = np.where(after.fit_error.rows > 0, after.fit_error.rms, before.fit_error.rms)
    errors = error_on(own, first, raw=raw), error_on(signals, second, raw=raw)
    squares = _block_squares(first, second, signals.row_runs)
    return Comparison(before, after, *errors, floor, tuple(shifts), _gain_std(squares, floor), squares)


def _block_squares(first: Array, second: Array, runs: Iterable[slice]) -> Array:
    """Squared residuals (M, n) of two models, (2, B, n): summed over each of the blocks into which every run is cut."""
    edges = [np.linspace(r.start, r.stop, _BLOCKS + 1).astype(int) for r in runs]
    pieces = [slice(a, b) for e in edges for a, b in itertools.pairwise(e) if b > a]
    found = [[np.nansum(r[p] ** 2, axis=0) for p in pieces] for r in (first, second)]
    return np.reshape(np.array(found), (2, len(pieces), first.shape[1]))


def _gain_std(squares: Array, floor: Array) -> float:
    """Standard error of the share of squared error that is removed: jackknife over blocks of time."""
    weight = 1.0 / np.maximum(floor, 1e-300) ** 2
    sums = np.nansum(weight * squares, axis=2)
    pieces = sums[0]
    total = sums.sum(axis=1)
    left = total[:, None] - sums
    if len(pieces) < 3 or not (left[0] > 0).all():
        return float("nan")
    share = left[1] / left[0]
    return float(np.sqrt((len(pieces) - 1) * np.mean((share - share.mean()) ** 2)))

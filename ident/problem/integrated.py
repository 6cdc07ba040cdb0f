"""Integrated forms of the problem: the same parameters, without acceleration, for the same estimators.

Both sides of the torque equation are weighted by a smooth window w(t) that vanishes at its ends and integrated over time;
what is a time derivative (momentum, energy) passes its derivative on to the window: ∫ w dP/dt = −∫ w' P. No acceleration is
needed, and the window acts as the low-pass filter of the rows."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..effects.kinds import Need
from ..errors import ConfigurationError, DataError, unknown_name
from ..signals.rows import Rows
from ..statistics.noise import row_shape
from ..statistics.torque_error import TorqueError
from .formulations import Parts, model_parts
from .problem import Problem

if TYPE_CHECKING:
    from ..model import Model
    from ..signals.signals import Signals

Array = np.ndarray
#: Window (1 − x²)^p: its sums are integrals to 1e-10 from 40 samples on, and its gain is one half at 1.606 / length.
_POWER, _HALF_GAIN = 8, 1.6060329943796887
#: A window holds at least so many samples; fewer would make sums of integrals.
_LEAST = 20
#: Rows a window: neighbours overlap so far that no information is lost.
_ROWS_PER_WINDOW = 5
_BLOCK_NUMBERS = 4_000_000


def smooth_window(length: int, rate: float) -> tuple[Array, Array]:
    """Weights (L,) of a mean over L samples at `rate` Hz that vanishes at both ends, and minus their time derivative (1/s)."""
    half = (length + 1) / 2
    x = (np.arange(1, length + 1) - half) / half
    w = (1 - x**2) ** _POWER
    slope = 2 * _POWER * x * (1 - x**2) ** (_POWER - 1) * rate / half
    return w / w.sum(), slope / w.sum()


@dataclass(frozen=True, eq=False)
class IntegratedProblem(Problem):
    """A problem whose rows are windowed integrals, each the mean over one window.

    `window_s`: length of the window in s; None matches the cut-off that the signals were prepared with. Positions, velocities
    and the torque at full rate are used; the signals' own row filter is not."""

    window_s: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.window_s is not None and not self.window_s * self.signals.rate >= _LEAST:
            raise ConfigurationError(
                f"window_s = {self.window_s:g} s holds {self.window_s * self.signals.rate:.0f} samples at {self.signals.rate:g} Hz;"
                f" at least {_LEAST} are needed ({_LEAST / self.signals.rate:g} s)."
            )
        if not any(r.stop - r.start >= self._length for r in self.signals.runs):
            raise DataError(f"no run of the log lasts as long as the window ({self._length / self.signals.rate:.3g} s); shorten window_s.")

    @cached_property
    def _length(self) -> int:
        """Samples a window."""
        rate, report = self.signals.rate, self.signals.report
        cutoff = report.row_cutoff_hz or report.cutoff_hz
        wanted = self.window_s or (_HALF_GAIN / cutoff if cutoff else 2 * _LEAST / rate)
        return max(_LEAST, round(wanted * rate)) | 1

    @cached_property
    def _hop(self) -> int:
        return max(1, self._length // _ROWS_PER_WINDOW)

    @cached_property
    def _window(self) -> tuple[Array, Array]:
        return smooth_window(self._length, self.signals.rate)

    @cached_property
    def row_runs(self) -> tuple[slice, ...]:
        """The rows of each run."""
        counts = [max(0, (r.stop - r.start - self._length) // self._hop + 1) for r in self.signals.runs]
        edges = np.cumsum([0, *counts]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(edges))

    def _means(self, signal: Array, weights: Array) -> Array:
        """Weighted sums (m, …) over the windows of a piece of a run (S, …)."""
        count = (len(signal) - self._length) // self._hop + 1
        out = np.empty((count, *signal.shape[1:]))
        flat, target = signal.reshape(len(signal), -1), out.reshape(count, -1)
        step = max(1, 4 * _ROWS_PER_WINDOW)
        for first in range(0, count, step):
            rows = min(step, count - first)
            band = np.zeros((rows, (rows - 1) * self._hop + self._length))
            for r in range(rows):
                band[r, r * self._hop : r * self._hop + self._length] = weights
            start = first * self._hop
            target[first : first + rows] = band @ flat[start : start + band.shape[1]]
        return out

    def at_rows(self, signal: Array) -> Array:
        """Windowed means (M, …) of a signal at full rate (N, …)."""
        w = self._window[0]
        parts = [self._means(signal[run], w) for run in self.signals.runs if run.stop - run.start >= self._length]
        return np.concatenate(parts)

    @cached_property
    def _sound(self) -> Array:
        """Whether each sample (N, n) may be used: its torque is there, and the nearest row of the signals is valid."""
        s = self.signals
        if s.row_filter is None:
            return s.valid & np.isfinite(s.torque)
        out = np.isfinite(s.torque)
        for run, rows in zip(s.runs, s.row_runs, strict=True):
            if rows.stop > rows.start:
                nearest = np.searchsorted((s.centres[rows][:-1] + s.centres[rows][1:]) / 2, np.arange(run.start, run.stop))
                out[run] &= s.valid[rows][nearest]
        return out

    @cached_property
    def row_time(self) -> Array:
        """Time (M,) of the middle of each window, s."""
        return self.at_rows(self.signals.t)

    @property
    def row_shape(self) -> Array:
        """Autocorrelation that overlapping windows give to white torque noise."""
        return row_shape(self._window[0], self._hop)

    @abstractmethod
    def _weighted(self, parts: Parts) -> Array:
        """Columns (m, rows, k) of the windows of a piece."""

    def rows(self) -> Iterator[Rows]:
        """All rows, block by block, columns over base parameters."""
        signals, keep = self.signals, self.base.independent
        size = max(self._length, _BLOCK_NUMBERS // (2 * signals.q.shape[1] * len(self.model.parameters)))
        per = max(1, (size - self._length) // self._hop + 1)
        for i, (run, rows) in enumerate(zip(signals.runs, self.row_runs, strict=True)):
            total = rows.stop - rows.start
            whole = bool(self.model.needs & {Need.HISTORY, Need.NEIGHBOURS})
            for first in range(0, total, total if whole else per):
                last = total if whole else min(first + per, total)
                start = run.start + first * self._hop
                stop = run.stop if whole else run.start + (last - 1) * self._hop + self._length
                columns = self._weighted(model_parts(self.model, self.motion(slice(start, stop))))[:, :, keep]
                place = slice(rows.start + first, rows.start + last)
                yield Rows(columns, self.tau[place], self.valid[place], place, i)
                if self.progress is not None:
                    self.progress(min(1.0, place.stop / max(1, len(self.valid))))

    def torque_error(self, values: Array, residual: Array | None = None) -> TorqueError:
        """Error of the torque itself for base values (b,), by the torque equation on the same signals."""
        return Problem(self.model, self.signals, self.reference).torque_error(values)


@dataclass(frozen=True, eq=False)
class MomentumProblem(IntegratedProblem):
    """The momentum form: rows are mean torques over windows, one a joint.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> robot = ident.load_robot("puma560")
    >>> signals = ident.ZeroPhase()(train, robot)
    >>> ident.MomentumProblem(robot.rigid_body(), signals).valid.shape[1]
    6
    """

    @cached_property
    def tau(self) -> Array:
        """Mean torque (M, n) of each window, measured side."""
        return self.at_rows(np.where(self._sound, self.signals.torque, 0.0))

    @cached_property
    def valid(self) -> Array:
        """Windows (M, n) whose samples may all be used."""
        return self.at_rows((~self._sound).astype(float)) == 0.0

    def _weighted(self, parts: Parts) -> Array:
        w, slope = self._window
        return self._means(parts.force, w) + self._means(parts.momentum, slope)


@dataclass(frozen=True, eq=False)
class EnergyProblem(IntegratedProblem):
    """The energy form (Gautier & Khalil 1988): rows are mean powers over windows, one for the whole robot.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> robot = ident.load_robot("puma560")
    >>> signals = ident.ZeroPhase()(train, robot)
    >>> ident.EnergyProblem(robot.rigid_body(), signals).valid.shape[1]
    1
    """

    @cached_property
    def tau(self) -> Array:
        """Mean power (M, 1) of each window that all drives supply, W."""
        s, robot = self.signals, self.model.robot
        rate = s.dq if robot.transmission.measured == "joint" else robot.transmission.motor_rate(s.dq)
        power = np.sum(rate * np.where(self._sound, s.torque, 0.0), axis=1)
        return self.at_rows(power[:, None])

    @cached_property
    def valid(self) -> Array:
        """Windows (M, 1) in which the torque of every joint is known throughout."""
        return self.at_rows((~self._sound).any(axis=1).astype(float)[:, None]) == 0.0

    def _weighted(self, parts: Parts) -> Array:
        w, slope = self._window
        return (self._means(parts.power, w) + self._means(parts.energy, slope))[:, None, :]


TORQUE, ENERGY = "torque", "energy"
FORMULATIONS: dict[str, type[Problem]] = {TORQUE: Problem, "momentum": MomentumProblem, ENERGY: EnergyProblem}


def formulate(model: Model, signals: Signals, formulation: str = TORQUE, **options: Any) -> Problem:
    """A problem in one of the forms: "torque" (needs acceleration), "momentum" or "energy" (`window_s`)."""
    if formulation not in FORMULATIONS:
        raise unknown_name("formulation", formulation, FORMULATIONS)
    kind = FORMULATIONS[formulation]
    if kind is Problem and options:
        raise ConfigurationError(f"the torque form has no option {min(options)!r}; window_s belongs to the other forms.")
    return kind(model, signals, **options)

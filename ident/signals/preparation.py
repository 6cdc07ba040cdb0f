"""Strategies that turn logs into signals: how derivatives are made, how rows are filtered, what is left out."""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np

from .._utils.text import counted
from ..errors import ConfigurationError, DataError, UnsupportedError, unknown_name
from ..logs.log import Log, LogSet
from ..robots.robot import Robot, require_robot
from .assemble import assemble, of_logs
from .cutoff import HIGHEST, CutoffChoice, choose_cutoff
from .filters import RowFilter, butterworth_transient, central_differences, require_accuracy, savitzky_golay_window, zero_phase_lowpass
from .masks import NearReversals, Standstill
from .resample import bridge
from .signals import Signals
from .sound import Derived
from .uniform import Recording, Resampling, UniformRun, uniform_runs

Array = np.ndarray
_LOG = logging.getLogger(__name__)
#: Row cut-off as a share of the derivatives' cut-off: there the fourth-order filter run both ways still passes 99.9 %.
ROW_SHARE = 0.4


class Velocity(StrEnum):
    """Where velocities come from: differences of positions, or the log's own velocities (accelerations are their differences)."""

    POSITION = "position"
    RECORDED = "recorded"


@dataclass(frozen=True, kw_only=True)
class Preparation(ABC):
    """What all strategies share. Call it with logs (and the robot, where the logs do not carry it) to get `Signals`.

    `cutoff_hz`: of the derivatives; None: chosen from the data and reported. `decimate`: True filters both sides of the
    equation and keeps as many rows as the row cut-off leaves information; a number keeps every such sample; False keeps all
    samples as rows. `row_cutoff_hz`: of the rows; None: 0.4 of `cutoff_hz`. `resample_hz`: None keeps the logs' own rate.
    `standstill`: when a joint's rows are left out because it stands still; None never. `rows_near_reversals`: "if_consistent", a fit
    leaves them out for joints where they scatter more than the other rows, or "keep". `saturated`: "mask" or "keep" rows
    whose torque stays at its extreme. `max_gap_s`: longer steps in time cut a run; None: as the cut-off allows.
    `edge_s`: left out at both ends of a run; None: the filter's transient."""

    method: ClassVar[str]

    cutoff_hz: float | None = None
    decimate: bool | int = True
    row_cutoff_hz: float | None = None
    resample_hz: float | None = None
    standstill: Standstill | None = field(default_factory=Standstill)
    rows_near_reversals: NearReversals = NearReversals.IF_CONSISTENT
    saturated: str = "mask"
    max_gap_s: float | None = None
    edge_s: float | None = None

    def __post_init__(self) -> None:
        for name in ("cutoff_hz", "row_cutoff_hz", "resample_hz", "max_gap_s"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, (int, float)) and value > 0 and math.isfinite(value)):
                raise ConfigurationError(f"[signals] {name} must be a positive number, not {value!r}.")
        if self.edge_s is not None and not self.edge_s >= 0:
            raise ConfigurationError(f"[signals] edge_s must not be negative, but is {self.edge_s!r}.")
        if not isinstance(self.decimate, bool) and (int(self.decimate) != self.decimate or self.decimate < 1):
            raise ConfigurationError(f"[signals] decimate must be true, false or a whole number of samples, not {self.decimate!r}.")
        if self.saturated not in ("mask", "keep"):
            raise unknown_name("treatment of saturated torque", str(self.saturated), ("mask", "keep"))
        object.__setattr__(self, "rows_near_reversals", NearReversals(self.rows_near_reversals))

    def __call__(self, logs: LogSet | Log | Sequence[Log], robot: Robot | None = None) -> Signals:
        """Prepare logs. Raises DataError where they cannot be used, ConfigurationError for settings that do not fit them."""
        chosen = logs if isinstance(logs, LogSet) else LogSet((logs,) if isinstance(logs, Log) else tuple(logs))
        require_robot(robot)
        robot = robot or chosen.robot
        if robot is None:
            raise ConfigurationError("which robot are the logs of? Read them with read_logs(paths, robot), or call prep(logs, robot).")
        recordings = [Recording.of(log, robot) for log in chosen.logs]
        for rec in recordings:
            self._require(rec)
        uniform = uniform_runs(recordings, self.resample_hz, self.max_gap_s, self.cutoff_hz)
        slowest = min(1 / r.clock.step for r in recordings)
        choice = self._choose(uniform, robot, HIGHEST * slowest)
        cutoff = choice.cutoff_hz if self.cutoff_hz is None else float(self.cutoff_hz)
        if self.cutoff_hz is None and self.max_gap_s is None:
            uniform = uniform_runs(recordings, self.resample_hz, None, cutoff)
        if cutoff >= 0.5 * uniform.rate:
            raise ConfigurationError(f"[signals] cutoff_hz = {cutoff:g} must be below half the sample rate ({0.5 * uniform.rate:g} Hz).")
        row_filter = self._row_filter(cutoff, uniform.rate)
        derived = [self._derive(run, uniform.rate, cutoff, row_filter) for run in uniform.runs]
        signals = assemble(self, robot, recordings, uniform, derived, row_filter, choice, cutoff, chosen.inputs)
        report = signals.report
        _LOG.info("prepared %d rows a joint; %s", report.rows, report.text().splitlines()[0])
        return replace(signals, source=chosen)

    def config(self) -> dict[str, Any]:
        """The strategy's settings, as `make_preparation` takes them."""
        out: dict[str, Any] = {"method": self.method}
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, Standstill):
                value = {k.name: getattr(value, k.name) for k in fields(value)}
            out[f.name] = value.value if isinstance(value, StrEnum) else value
        return out

    @property
    def judges_reversals(self) -> bool:
        """Whether rows near reversals are marked, for the estimators to leave out those that are not consistent with the others."""
        return self.standstill is not None and self.rows_near_reversals == NearReversals.IF_CONSISTENT

    @property
    def filters_positions(self) -> bool:
        """Whether `cutoff_hz` acts on positions."""
        return True

    def _require(self, recording: Recording) -> None:  # noqa: B027 - most strategies need positions alone
        """Raise DataError if a recording lacks what the strategy needs."""

    def _choose(self, uniform: Resampling, robot: Robot, highest: float) -> CutoffChoice:
        pieces = [r.q for r in uniform.runs if len(r) >= 32]
        if not pieces:
            longest = max(len(r) for r in uniform.runs)
            raise DataError(
                f"{of_logs([r.name for r in uniform.runs])}: the longest stretch without a gap has {counted(longest, 'sample')}: too few to"
                " differentiate. `ident check` tells where the gaps are."
            )
        return choose_cutoff(pieces, uniform.rate, robot.joint_names, [j.prismatic for j in robot.joints], highest=highest)

    def _row_filter(self, cutoff: float, rate: float) -> RowFilter | None:
        row_cutoff = self.row_cutoff_hz
        if self.decimate is False:
            return None if row_cutoff is None else RowFilter.lowpass(row_cutoff, rate, 1)
        if self.decimate is True:
            row_cutoff = row_cutoff or ROW_SHARE * cutoff
            # Rows at 2.5 times their cut-off: the filter has fallen to a few per cent where they would fold.
            factor = max(1, int(ROW_SHARE * rate / row_cutoff + 1e-9))
        else:
            factor = int(self.decimate)
            row_cutoff = row_cutoff or min(ROW_SHARE * cutoff, ROW_SHARE * rate / factor)
        return RowFilter.lowpass(row_cutoff, rate, factor)

    def _margin(self, transient: float, rate: float) -> int:
        return math.ceil((transient if self.edge_s is None else self.edge_s) * rate)

    def reach(self, cutoff: float, rate: float) -> int:
        """Samples on either side beyond which a sample has no part in the derivatives (its weight is below rounding).

        Pieces of a log that overlap by so much give what the whole log gives. Raises UnsupportedError where there is no such number."""
        raise UnsupportedError(f"signals prepared by {self.method!r} cannot be streamed; read the log into memory (--no-stream).")

    @abstractmethod
    def _derive(self, run: UniformRun, rate: float, cutoff: float, row_filter: RowFilter | None) -> Derived:
        """Positions and derivatives of a run, and the torque that goes with them where rows are samples."""


@dataclass(frozen=True, kw_only=True)
class ZeroPhase(Preparation):
    """Butterworth low-pass of `order` on positions, run both ways, then central differences of order `accuracy`.

    Without decimation the torque gets the same low-pass as the positions, so that both sides lose the same frequencies.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> signals = ident.ZeroPhase(cutoff_hz=8.0)(train, ident.load_robot("puma560"))
    >>> signals.q.shape[1]
    6
    """

    method: ClassVar[str] = "zero_phase"

    order: int = 4
    accuracy: int = 6
    velocity: Velocity = Velocity.POSITION

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.velocity not in list(Velocity):
            raise unknown_name("source of velocity", str(self.velocity), [v.value for v in Velocity])
        object.__setattr__(self, "velocity", Velocity(self.velocity))
        require_accuracy(self.accuracy)
        if self.order not in range(1, 11):
            raise ConfigurationError(f"[signals] order = {self.order!r} must be a whole number from 1 to 10.")

    def _require(self, recording: Recording) -> None:
        if self.velocity == Velocity.RECORDED and (recording.dq is None or np.isnan(recording.dq).all(axis=0).any()):
            raise DataError(f'log {recording.name}: velocity = "recorded" needs dq1, dq2, … for every joint. Use velocity = "position".')

    def reach(self, cutoff: float, rate: float) -> int:
        # Beyond rounding by far; and never less than what continues the signal at the ends of a run.
        decay = math.ceil(butterworth_transient(cutoff, self.order, 1e-18) * rate)
        return max(decay, math.ceil(3 * rate / cutoff) + 1) + self.accuracy

    def _derive(self, run: UniformRun, rate: float, cutoff: float, row_filter: RowFilter | None) -> Derived:
        def smooth(x: Array) -> Array:
            return zero_phase_lowpass(x, cutoff, rate, self.order)

        p = self.accuracy // 2
        if self.velocity == Velocity.RECORDED and run.dq is not None:
            dq = smooth(bridge(run.t, run.dq))
            ddq, _ = central_differences(dq, rate, self.accuracy)
            q, dq = smooth(run.q)[p : len(run) - p], dq[p : len(run) - p]
        else:
            q = smooth(run.q)
            dq, ddq = central_differences(q, rate, self.accuracy)
            q = q[p : len(run) - p]
        torque = run.torque if row_filter else smooth(bridge(run.t, run.torque))
        margin = self._margin(butterworth_transient(cutoff, self.order), rate)
        return Derived(run, q, dq, ddq, torque[p : len(run) - p], offset=p).trimmed(margin)


@dataclass(frozen=True, kw_only=True)
class SavitzkyGolay(Preparation):
    """Local polynomials of `degree` through a window of samples; `window_s` (s) overrides the cut-off.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> ident.SavitzkyGolay(degree=4, window_s=0.1)(train, ident.load_robot("puma560")).rate > 0
    True
    """

    method: ClassVar[str] = "savitzky_golay"

    degree: int = 4
    window_s: float | None = None

    def _window(self, cutoff: float, rate: float) -> int:
        return savitzky_golay_window(cutoff, rate, self.degree) if self.window_s is None else 2 * int(self.window_s * rate / 2) + 1

    def reach(self, cutoff: float, rate: float) -> int:
        return self._window(cutoff, rate)

    def _derive(self, run: UniformRun, rate: float, cutoff: float, row_filter: RowFilter | None) -> Derived:
        from scipy.signal import savgol_filter

        window = self._window(cutoff, rate)
        if window <= self.degree:
            raise ConfigurationError(f"[signals] a window of {window} samples cannot hold a polynomial of degree {self.degree}.")
        if len(run) <= window:
            none = np.empty((0, run.q.shape[1]))
            return Derived(run, none, none, none, none, offset=0)
        q, dq, ddq = (savgol_filter(run.q, window, self.degree, deriv=d, delta=1 / rate, axis=0) for d in range(3))
        torque = run.torque if row_filter else savgol_filter(bridge(run.t, run.torque), window, self.degree, axis=0)
        # Without edge_s only what the window fully covers.
        margin = window // 2 if self.edge_s is None else max(window // 2, self._margin(0.0, rate))
        return Derived(run, q, dq, ddq, torque, offset=0).trimmed(margin)


@dataclass(frozen=True, kw_only=True)
class CentralDifference(Preparation):
    """Central differences of the positions as they are: `cutoff_hz` sets the rows' cut-off alone, and noise is differentiated too.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> ident.CentralDifference(cutoff_hz=8.0)(train, ident.load_robot("puma560")).rate > 0
    True
    """

    method: ClassVar[str] = "central_difference"

    decimate: bool | int = False
    accuracy: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        require_accuracy(self.accuracy)

    @property
    def filters_positions(self) -> bool:
        return False

    def reach(self, cutoff: float, rate: float) -> int:
        return self.accuracy

    def _derive(self, run: UniformRun, rate: float, cutoff: float, row_filter: RowFilter | None) -> Derived:
        p = self.accuracy // 2
        dq, ddq = central_differences(run.q, rate, self.accuracy)
        inner = slice(p, len(run) - p)
        return Derived(run, run.q[inner], dq, ddq, run.torque[inner], offset=p).trimmed(self._margin(0.0, rate))


@dataclass(frozen=True, kw_only=True)
class Recorded(Preparation):
    """Positions, velocities and accelerations as recorded, not filtered: for simulated logs and drives that measure them."""

    method: ClassVar[str] = "recorded"

    decimate: bool | int = False

    @property
    def filters_positions(self) -> bool:
        return False

    def _require(self, recording: Recording) -> None:
        for label, array in (("dq", recording.dq), ("ddq", recording.ddq)):
            if array is None or np.isnan(array).any():
                raise DataError(
                    f"log {recording.name}: recorded derivatives need {label}1, {label}2, … for every joint and sample. Use zero_phase."
                )

    def reach(self, cutoff: float, rate: float) -> int:
        return 0

    def _derive(self, run: UniformRun, rate: float, cutoff: float, row_filter: RowFilter | None) -> Derived:
        assert run.dq is not None
        assert run.ddq is not None
        return Derived(run, run.q, run.dq, run.ddq, run.torque, offset=0).trimmed(self._margin(0.0, rate))


_STRATEGIES: tuple[type[Preparation], ...] = (ZeroPhase, SavitzkyGolay, CentralDifference, Recorded)


def preparation_names() -> tuple[str, ...]:
    """Names that `make_preparation` knows."""
    return tuple(s.method for s in _STRATEGIES)


def make_preparation(method: str = "zero_phase", **config: Any) -> Preparation:
    """A strategy by name, with settings as in a study file's [signals] table; `standstill` may be a table. Raises ConfigurationError."""
    found = next((s for s in _STRATEGIES if s.method == method), None)
    if found is None:
        raise unknown_name("way to prepare signals", method, preparation_names())
    known = {f.name for f in fields(found)}
    for key in config:
        if key not in known:
            raise unknown_name("setting in [signals]", key, known)
    rule = config.get("standstill")
    if isinstance(rule, dict):
        rules = {f.name for f in fields(Standstill)}
        for key in rule:
            if key not in rules:
                raise unknown_name("setting in [signals] standstill", key, rules)
        config["standstill"] = Standstill(**rule)
    elif rule is False:
        config["standstill"] = None
    return found(**config)

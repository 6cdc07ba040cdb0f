"""Which rows of derived runs are sound: torque that is missing or cut off, standstill and reversals, seen through the rows' filter."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ..robots.robot import Robot
from ..robots.transmission import Side
from .cutoff import CutoffChoice
from .filters import RowFilter
from .masks import Standstill, TorqueClipping
from .resample import bridge
from .uniform import UniformRun

Array = np.ndarray
#: A row is not used if more than this share of its filter's weight lies on samples whose torque is missing or cut off.
UNSOUND = 0.02
#: A row is reached by a reversal if more than this share of its weight lies on samples below this multiple of the standstill speed.
REVERSAL_SHARE = 0.02
REVERSAL_REACH = 2.0


@dataclass(frozen=True, eq=False)
class Derived:
    """A run with derivatives: `q`, `dq`, `ddq`, `torque` (L, n) from sample `offset` of `run` on."""

    run: UniformRun
    q: Array
    dq: Array
    ddq: Array
    torque: Array
    offset: int

    def __len__(self) -> int:
        return len(self.q)

    def trimmed(self, margin: int) -> Derived:
        """Without so many samples at either end."""
        if margin <= 0:
            return self
        inner = slice(margin, max(margin, len(self) - margin))
        return replace(
            self, q=self.q[inner], dq=self.dq[inner], ddq=self.ddq[inner], torque=self.torque[inner], offset=self.offset + margin
        )

    @property
    def samples(self) -> slice:
        """The samples of `run` that are left."""
        return slice(self.offset, self.offset + len(self))


class Settings(Protocol):
    """A preparation's settings, as far as rows are concerned (`ident.signals.preparation.Preparation` says what each is)."""

    @property
    def cutoff_hz(self) -> float | None: ...

    @property
    def saturated(self) -> str: ...

    @property
    def standstill(self) -> Standstill | None: ...

    @property
    def judges_reversals(self) -> bool: ...

    @property
    def filters_positions(self) -> bool: ...

    def config(self) -> dict[str, Any]: ...


@dataclass(frozen=True, eq=False)
class Whole:
    """Runs one after the other: `t` (N,), motion and `torque` (N, n), where it is `missing` (N, n) bool, and where each run is."""

    runs: tuple[slice, ...]
    t: Array
    q: Array
    dq: Array
    ddq: Array
    torque: Array
    missing: Array

    @classmethod
    def of(cls, kept: Sequence[Derived]) -> Whole:
        """Of runs that are long enough."""
        edges = np.cumsum([0, *(len(d) for d in kept)]).tolist()
        runs = tuple(slice(a, b) for a, b in itertools.pairwise(edges))
        t = _joined([d.run.t[d.samples] for d in kept])
        q, dq, ddq = (_joined([getattr(d, k) for d in kept]) for k in ("q", "dq", "ddq"))
        torque = _joined([d.run.torque[d.samples] for d in kept])
        return cls(runs, t, q, dq, ddq, torque, _joined([d.run.missing[d.samples] for d in kept]))


@dataclass(frozen=True, eq=False)
class Pace:
    """Speed (N, n) without its sign on the measured side, its `top` (n,), joints that are `still` (n,), the `threshold` (n,) of standstill,
    and where a joint is `moving` or `resting` (N, n)."""

    speed: Array
    top: Array
    still: Array
    threshold: Array
    moving: Array
    resting: Array

    @classmethod
    def of(cls, robot: Robot, whole: Whole, rate: float, choice: CutoffChoice, cutoff: float, rule: Standstill | None) -> Pace:
        """By the noise of the speeds, and by the rule of standstill (None: nothing counts as resting)."""
        motor = robot.transmission.measured == Side.MOTOR
        pace = np.abs(robot.transmission.motor_rate(whole.dq) if motor else whole.dq)
        top = pace.max(axis=0)
        noise = speed_noise(robot, choice, cutoff)
        # Differences of a constant leave only rounding.
        rounding = 100 * np.spacing(np.abs(whole.q).max(axis=0)) * rate
        if motor:
            rounding = np.abs(robot.transmission.K_inverse) @ rounding
        still = top <= np.maximum(6 * noise, rounding)
        threshold = np.zeros(robot.n) if rule is None else np.where(still, np.inf, rule.thresholds(top, noise))
        moving = pace > np.where(still, np.inf, np.maximum(threshold, 0.01 * top))
        resting = pace <= threshold if rule is not None else np.zeros(pace.shape, bool)
        return cls(pace, top, still, threshold, moving, resting)


@dataclass(frozen=True, eq=False)
class SoundRows:
    """Rows: `tau` (M, n), which are `valid` and which are `near_reversal` (M, n; None if not asked for), what each reason `lost`,
    and the share of standstill that is `allowed` (n,)."""

    tau: Array
    valid: Array
    lost: dict[str, Array]
    allowed: Array
    near_reversal: Array | None

    @classmethod
    def of(
        cls, kept: Sequence[Derived], whole: Whole, pace: Pace, cut: TorqueClipping, prep: Settings, row_filter: RowFilter | None
    ) -> SoundRows:
        """Samples that are not sound, through the filter of the rows."""
        rule, parts = prep.standstill, list(zip(kept, whole.runs, strict=True))

        def share(flag: Array) -> Array:
            """Of each row's weight on flagged samples, (M, n)."""
            at = [flag[run] for run in whole.runs]
            return np.concatenate([x.astype(float) if row_filter is None else filtered_share(row_filter, x) for x in at])

        tau = np.concatenate([d.torque if row_filter is None else row_filter.apply(bridge(whole.t[run], d.torque)) for d, run in parts])
        flags = {
            "torque missing": whole.missing,
            "torque at its limit": cut.flag if prep.saturated == "mask" else np.zeros_like(whole.missing),
            "standstill": pace.resting,
        }
        shares = {k: share(flag) for k, flag in flags.items()}
        allowed = rule.allowed(shares["standstill"]) if rule is not None else np.ones(tau.shape[1])
        lost = {k: x > (allowed if k == "standstill" else UNSOUND) for k, x in shares.items()}
        near = share(pace.speed <= REVERSAL_REACH * pace.threshold) > REVERSAL_SHARE if prep.judges_reversals else None
        tau[lost["torque missing"]] = np.nan
        return cls(tau, ~np.logical_or.reduce(list(lost.values())), lost, allowed, near)


def _joined(parts: list[Array]) -> Array:
    """Runs one after the other; a single one is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def filtered_share(row_filter: RowFilter, flag: Array) -> Array:
    """Share of the row filter's weight on flagged samples (L, n) → (M, n)."""
    if not flag.any():
        return np.zeros((row_filter.count(len(flag)), flag.shape[1]))
    return row_filter.magnitude.apply(flag)


def speed_noise(robot: Robot, choice: CutoffChoice, cutoff: float) -> Array:
    """Standard deviation (n,) of the speed's noise on the measured side, behind the low-pass."""
    joint = np.array([s.velocity_noise(cutoff) for s in choice.joints])
    if robot.transmission.measured == Side.JOINT:
        return joint
    return np.sqrt(robot.transmission.K_inverse**2 @ joint**2)

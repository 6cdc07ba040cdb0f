"""What figures of residuals are drawn from: rows of several signals one after the other, thinned so that nothing of note is lost."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..effects.base import Axis, Effect, Need
from ..problem.problem import Problem
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

Array = np.ndarray
#: Points along a time axis, points of a cloud, bins of a mean.
_TIMES = 700
_CLOUD = 1200
_BINS = 30
#: Share of the whole length that is left free between runs.
_BETWEEN = 0.01


@dataclass(frozen=True, eq=False)
class Timeline:
    """Rows of several signals on one axis of time, run after run. `t` (M,) s; `edges`: the rows of each run; `starts`: where on
    the axis each of the signals begins and ends."""

    t: Array
    edges: tuple[slice, ...]
    starts: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, parts: Iterable[Signals]) -> Timeline:
        """One after the other."""
        parts = list(parts)
        runs = [(signals.row_time[rows], k) for k, signals in enumerate(parts) for rows in signals.row_runs if rows.stop > rows.start]
        free = _BETWEEN * sum(float(t[-1] - t[0]) for t, _ in runs)
        times, edges, at, row = [], [], 0.0, 0
        spans: dict[int, tuple[float, float]] = {}
        for t, k in runs:
            times.append(t - t[0] + at)
            edges.append(slice(row, row + len(t)))
            spans[k] = (spans[k][0] if k in spans else at, float(times[-1][-1]))
            at, row = spans[k][1] + free, row + len(t)
        return cls(np.concatenate(times), tuple(edges), tuple(spans[k] for k in sorted(spans)))

    def envelope(self, values: Array) -> tuple[Array, Array, Array]:
        """Time, least and greatest value (K,) of values (M,) in short stretches; NaN where there is none and between runs."""
        stretch = max(float(self.t[-1] - self.t[0]) / _TIMES, 1e-9)
        t, low, high = [], [], []
        for rows in self.edges:
            own, x = self.t[rows], values[rows]
            cut = np.unique(np.searchsorted(own, np.arange(own[0], own[-1] + stretch, stretch)))
            cut = cut[cut < len(own)]
            t.append(np.append(own[cut], np.nan))
            low.append(np.append(np.minimum.reduceat(np.where(np.isfinite(x), x, np.inf), cut), np.nan))
            high.append(np.append(np.maximum.reduceat(np.where(np.isfinite(x), x, -np.inf), cut), np.nan))
        return tuple(np.where(np.isfinite(v), v, np.nan) for v in map(np.concatenate, (t, low, high)))  # type: ignore[return-value]


def cloud(x: Array, y: Array) -> tuple[Array, Array]:
    """Not more points than a figure bears, evenly spread over the rows."""
    at = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    at = at[np.linspace(0, len(at) - 1, min(len(at), _CLOUD)).astype(int)] if len(at) else at
    return x[at], y[at]


def binned(x: Array, y: Array) -> tuple[Array, Array]:
    """Mean of y over bins of x: half way between even bins and bins of equally many points."""
    use = np.isfinite(x) & np.isfinite(y)
    x, y = x[use], y[use]
    if len(x) < 2 * _BINS or np.ptp(x) <= 0:
        return x[:0], y[:0]
    places = np.linspace(0.0, 1.0, _BINS + 1)
    edges = 0.5 * (np.quantile(x, places) + x.min() + places * np.ptp(x))
    bin_ = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _BINS - 1)
    count = np.bincount(bin_, minlength=_BINS)
    keep = count >= 5
    mean_x, mean_y = (np.bincount(bin_, v, _BINS)[keep] / count[keep] for v in (x, y))
    return mean_x, mean_y


def contribution(estimate: Estimate, effect: Effect, signals: Signals) -> Array:
    """Torque (M, n) of one of an estimate's effects at the rows of signals, on the measured side, filtered like the rows."""
    model, robot = estimate.model, estimate.model.robot
    part = next(s for e, s in zip(model.effects, model.slices, strict=True) if e is effect)
    problem = Problem(model, signals, reference=estimate.all_values)
    out = np.zeros_like(signals.tau)
    for block in signals.blocks(None):
        motion = problem.motion(block.samples, frozenset({Need.LOAD, Need.REFERENCE}))
        own = effect.torque(motion, robot, estimate.all_values[part])
        out[block.rows] = block.reduce(robot.transmission.torque(own, effect.side, robot.transmission.measured))
    return out


def revealing(estimate: Estimate, effect: Effect, joint: int, signals: Signals) -> tuple[str, Array]:
    """The quantity (M,) at the rows against which an effect on `joint` shows, and its name with unit."""
    robot, side = estimate.model.robot, effect.side
    where = robot.joint_names[joint]
    q_unit = robot.position_unit(joint, side)
    on = f"{'motor of ' if side == Side.MOTOR and not robot.is_direct(joint) else ''}{where}"
    order = next((float(getattr(effect, p.name)) for p in effect.shape() if p.name == "order"), None)
    if order is not None:
        angle = Side(getattr(effect, "angle", side))
        q = signals.q if angle == Side.JOINT else robot.transmission.motor_position(signals.q)
        return f"phase at order {order:.4g} of {where} (rad)", np.mod(order * q[:, joint], 2 * np.pi)[signals.centres]
    match effect.axis:
        case Axis.VELOCITY | Axis.ACCELERATION | Axis.POSITION | Axis.MOTOR_ANGLE:
            side = Side.MOTOR if effect.axis == Axis.MOTOR_ANGLE else side
            name, unit, values = {
                Axis.VELOCITY: ("speed", f"{q_unit}/s", signals.dq),
                Axis.ACCELERATION: ("acceleration", f"{q_unit}/s^2", signals.ddq),
            }.get(effect.axis, ("position", q_unit, signals.q))
            carried = robot.transmission.motor_position if name == "position" else robot.transmission.motor_rate
            return f"{name} of {on} ({unit})", (values if side == Side.JOINT else carried(values))[:, joint][signals.centres]
        case Axis.TIME:
            clock = np.concatenate([signals.t[run] - origin for run, origin in zip(signals.runs, signals.origins, strict=True)])
            return "time since the run began (s)", clock[signals.centres]
        case Axis.TORQUE:
            return f"measured torque of {where} ({robot.force_unit(joint, robot.transmission.measured)})", signals.tau[:, joint]
        case _:
            load = _load(estimate, signals)
            return f"predicted load of {where} ({robot.force_unit(joint, Side.JOINT)})", load[:, joint]


def _load(estimate: Estimate, signals: Signals) -> Array:
    problem = Problem(estimate.model, signals, reference=estimate.all_values)
    out = np.zeros_like(signals.tau)
    for block in signals.blocks(None):
        motion = problem.motion(block.samples, frozenset({Need.LOAD}))
        out[block.rows] = block.reduce(motion.needed_load("the report", Side.JOINT))
    return out

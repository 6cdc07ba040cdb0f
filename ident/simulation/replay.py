"""Replay: the model driven by the measured torque from the measured state, window by window, against the measured motion.

A torque error of some percent may or may not move the arm wrongly; replay shows it in radians. Errors of an open-loop
simulation grow with time, so windows are short; an observer can hold the simulation near the measured motion, and then the
torque that it needs is the measure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.text import counted
from ..effects.force import Simulated
from ..effects.kinds import Nature, Need
from ..errors import ConfigurationError, DataError
from ..model import Model
from ..problem.problem import Problem
from .compiled_replay import compiled_windows
from .dynamics import Input, PlantDynamics, State
from .integrator import advance, begin
from .plant import Plant

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from ..signals.signals import Signals

Array = np.ndarray
_STEP = 2e-3


@dataclass(frozen=True, eq=False)
class Replay:
    """B windows of K instants, n joints, joint side.

    `t` (K,) s since the window's start; `starts` (B,) s and `runs` (B,): where the windows lie; `measured`, `simulated`
    (K, B, n): positions; `measured_rate`, `simulated_rate`: velocities; NaN after a window has diverged. `diverged` (B,) bool.
    `correction` (K, B, n): torque that the observer added, measured side; zero without one."""

    robot: Robot = field(repr=False)
    t: Array
    starts: Array
    runs: tuple[str, ...]
    measured: Array
    simulated: Array
    measured_rate: Array
    simulated_rate: Array
    diverged: Array
    correction: Array

    @property
    def position_error(self) -> Array:
        """Rms position error (n,), rad or m, over the windows that stayed bounded."""
        return _rms(self.simulated - self.measured)

    @property
    def velocity_error(self) -> Array:
        """Rms velocity error (n,)."""
        return _rms(self.simulated_rate - self.measured_rate)

    @property
    def window_error(self) -> Array:
        """Rms position error (B, n) of each window; infinite where it diverged."""
        with np.errstate(invalid="ignore"):
            error = np.sqrt(np.mean((self.simulated - self.measured) ** 2, axis=0))
        return np.where(self.diverged[:, None], np.inf, error)

    @property
    def median_error(self) -> Array:
        """Median over windows (n,) of the rms position error; infinite where most windows diverged."""
        return np.median(self.window_error, axis=0)

    @property
    def relative_error(self) -> Array:
        """Rms position error over the rms of the motion within the windows (n,), each about its start; 1 is as bad as standing still."""
        moved = _rms(self.measured - self.measured[:1])
        return np.divide(self.position_error, moved, out=np.full(len(moved), np.nan), where=moved > 0)

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "window_s": float(self.t[-1]),
            "windows": len(self.starts),
            "diverged": int(self.diverged.sum()),
            "joints": list(self.robot.joint_names),
            "units": ["m" if joint.prismatic else "rad" for joint in self.robot.joints],
            "position_rms": self.position_error.tolist(),
            "velocity_rms": self.velocity_error.tolist(),
            "position_median": [float(x) if np.isfinite(x) else None for x in self.median_error],
            "relative": self.relative_error.tolist(),
            "correction_rms": _rms(self.correction).tolist(),
        }

    def __str__(self) -> str:
        lines = [f"replay: {counted(len(self.starts), 'window')} of {self.t[-1]:.2f} s, {int(self.diverged.sum())} diverged"]
        lines.append(f"{'joint':<24}{'position rms':>16}{'velocity rms':>18}{'of the motion':>16}")
        for j, joint in enumerate(self.robot.joints):
            scale, unit = (1e3, "mm") if joint.prismatic else (180 / np.pi, "deg")
            lines.append(
                f"{joint.name:<24}{self.position_error[j] * scale:>12.4g} {unit:<3}{self.velocity_error[j] * scale:>12.4g} {unit}/s"
                f"{100 * self.relative_error[j]:>14.2f} %"
            )
        return "\n".join(lines)


def _rms(x: Array) -> Array:
    """Root mean square (n,) over the first axes, NaN left out."""
    flat = x.reshape(-1, x.shape[-1])
    present = np.isfinite(flat)
    count = np.maximum(present.sum(axis=0), 1)
    out = np.sqrt(np.sum(np.where(present, flat, 0.0) ** 2, axis=0) / count)
    return np.where(present.any(axis=0), out, np.nan)


def replay(
    model: Model,
    values: Array,
    signals: Signals,
    *,
    window: float = 1.0,
    windows: int = 40,
    observer_hz: float = 0.0,
    most: int | None = None,
) -> Replay:
    """Forward simulation of a model with values (k,) against prepared signals, over up to `windows` windows of `window` seconds.

    Windows start at the measured state, spread evenly over all runs, and are driven by the measured torque, straight between
    its samples. `observer_hz` > 0: the simulation is pulled towards the measured motion with this natural frequency.
    Effects that cannot be simulated forward (delays, encoders, those with memory but no forward model) act through their
    torque along the measured motion. Raises DataError if no window of the signals has torque on every joint, or if accelerations must
    be evaluated more than `most` times: a model whose contacts let go and catch without end takes as long as one likes."""
    values = np.asarray(values, float)
    if values.shape != (len(model.parameters),):
        raise ConfigurationError(f"replay: the model has {len(model.parameters)} parameters, but the values have shape {values.shape}.")
    forward, own, along = _divided(model, values)
    torque = _drive_torque(model, values, signals, along)
    stride = max(1, int(np.floor(_STEP * signals.rate + 1e-9)))
    length = max(2, round(window * signals.rate / stride))
    first, clock, runs = _windows(signals, torque, length * stride, windows)
    if not len(first):
        raise DataError(
            f"replay: no stretch of {window:g} s has torque on every joint{_without(signals, torque)};"
            " give a shorter window, or logs in which the torque of all joints is recorded."
        )
    rows = first[None, :] + stride * np.arange(length + 1)[:, None]

    measured, rate = signals.q[rows], signals.dq[rows]
    period = stride / signals.rate
    simulated, simulated_rate, correction = _simulated(Plant(forward, own), clock, measured, rate, torque[rows], period, observer_hz, most)
    diverged = ~np.isfinite(simulated).all(axis=(0, 2))
    return Replay(
        model.robot,
        np.arange(length + 1) * period,
        signals.t[first],
        runs,
        measured,
        simulated,
        rate,
        simulated_rate,
        diverged,
        correction,
    )


def _divided(model: Model, values: Array) -> tuple[Model, Array, list[int]]:
    """The part of a model that runs forward, its values, and the effects (by place) that only act along the measured motion."""
    along: list[int] = []
    stays: list[int] = []
    for i, effect in enumerate(model.effects):
        memory = effect.needs & {Need.HISTORY, Need.NEIGHBOURS} and not isinstance(effect, Simulated)
        (along if memory or effect.nature == Nature.SENSOR or Need.REFERENCE in effect.needs else stays).append(i)
    if not along:
        return model, values, []
    part = Model(model.robot, tuple(model.effects[i] for i in stays))
    return part, np.concatenate([values[model.slices[i]] for i in stays]), along


def _drive_torque(model: Model, values: Array, signals: Signals, along: list[int]) -> Array:
    """Measured torque (N, n), less the torque of effects that act along the measured motion."""
    if not along:
        return signals.torque

    problem, robot = Problem(model, signals, reference=values), model.robot
    out = signals.torque.copy()
    for run in signals.runs:
        motion = problem.motion(run)
        for i in along:
            effect = model.effects[i]
            own = effect.torque(motion, robot, values[model.slices[i]])
            out[run] -= robot.transmission.torque(own, effect.side, robot.transmission.measured)
    return out


def _windows(signals: Signals, torque: Array, span: int, most: int) -> tuple[Array, Array, tuple[str, ...]]:
    """First samples (B,) of windows of span + 1 samples with torque throughout, spread evenly; their times since their runs
    began, and the runs' names."""
    found: list[tuple[int, float, str]] = []
    finite = np.isfinite(torque).all(axis=1)
    for run, name in zip(signals.runs, signals.run_names, strict=True):
        gaps = np.concatenate([[0], np.cumsum(~finite[run])])
        at = np.arange(0, run.stop - run.start - span, max(1, span // 8))
        whole = at[gaps[at + span + 1] - gaps[at] == 0]
        last = -span
        for place in whole:
            if place - last >= span:
                found.append((run.start + int(place), float(signals.t[run.start + place] - signals.t[run.start]), name))
                last = int(place)
    if len(found) > most:
        found = [found[i] for i in np.unique(np.linspace(0, len(found) - 1, most).round().astype(int))]
    return np.array([f[0] for f in found], dtype=int), np.array([f[1] for f in found]), tuple(f[2] for f in found)


def _without(signals: Signals, torque: Array) -> str:
    """Joints of which no sample has torque, for a message."""
    lacking = [name for name, has in zip(signals.robot.joint_names, np.isfinite(torque).any(axis=0), strict=True) if not has]
    return f" ({', '.join(lacking)}: none at all)" if lacking else ""


def _simulated(
    plant: Plant, t: Array, q: Array, dq: Array, torque: Array, period: float, observer_hz: float, most: int | None
) -> tuple[Array, Array, Array]:
    """Positions, velocities and the observer's torque (K, B, n) of all windows; NaN from where a window has diverged.

    By compiled code as far as it knows the plant, unless an observer is asked for, or evaluations are to be counted."""
    reach = 10.0 * (1.0 + np.abs(dq).max())
    substeps = max(1, int(np.ceil(period / _STEP - 1e-9)))
    if observer_hz > 0 or most is not None:
        return _integrate(plant.dynamics(), t, q, dq, torque, period, substeps, reach, observer_hz, most)
    simulated, rate, left = compiled_windows(plant, t, (q[0], dq[0]), torque, period, substeps)
    lost = ~(np.abs(rate).max(axis=2, initial=0.0) < reach)
    lost[0] = False
    lost = np.logical_or.accumulate(lost, axis=0)
    simulated[lost], rate[lost] = np.nan, np.nan
    if len(left):
        own = q[:, left], dq[:, left], torque[:, left]
        simulated[:, left], rate[:, left], _ = _integrate(plant.dynamics(), t[left], *own, period, substeps, reach, 0.0, None)
    return simulated, rate, np.zeros(q.shape)


def _integrate(
    dynamics: PlantDynamics,
    t: Array,
    q: Array,
    dq: Array,
    torque: Array,
    period: float,
    substeps: int,
    reach: float,
    observer_hz: float,
    most: int | None,
) -> tuple[Array, Array, Array]:
    """The same by the general integrator, all windows together; one in which a speed gets beyond `reach` drops out."""
    n, (count, lanes) = dynamics.n, q.shape[:2]
    simulated, rate, correction = np.full(q.shape, np.nan), np.full(q.shape, np.nan), np.zeros(q.shape)
    live = np.arange(lanes)
    state = dynamics.start(t, q[0], dq[0])
    modes: Array | None = None
    guess: Array | None = None
    h = period / substeps
    with np.errstate(all="ignore"):
        for k in range(count):
            with_pull = torque[k : k + 2, live]
            if observer_hz > 0:
                correction[k, live] = _pull(dynamics, state, q[k, live], dq[k, live], 2.0 * np.pi * observer_hz)
                with_pull = with_pull + correction[k, live]
            simulated[k, live], rate[k, live] = state.y[:, :n], state.v[:, :n]
            if k == count - 1:
                break
            for i in range(substeps):
                here, there = (with_pull[0] + share / substeps * (with_pull[1] - with_pull[0]) for share in (i, i + 1))
                if most is not None and dynamics.evaluations > most:
                    raise DataError(
                        f"replay: more than {most} evaluations for {k * period:.2g} s of motion: friction lets go and catches without end;"
                        " a model that does so is seldom physical."
                    )
                phase = begin(dynamics, state, Input(here, here), modes, guess)
                state, modes = advance(dynamics, phase, Input(here, here), Input(there, there), h)
                guess = phase.response.a
                bounded = np.isfinite(state.v).all(axis=1) & (np.abs(state.v[:, :n]).max(axis=1) < reach)
                if not bounded.all():
                    live, with_pull, modes, guess = live[bounded], with_pull[:, bounded], modes[bounded], guess[bounded]
                    state = State(state.t[bounded], state.y[bounded], state.v[bounded], state.x[bounded])
                if not len(live):
                    return simulated, rate, correction
    return simulated, rate, correction


def _pull(dynamics: PlantDynamics, state: State, q: Array, dq: Array, w: float) -> Array:
    """Torque (B, n), measured side, that pulls the simulated links towards the measured motion, critically damped."""
    n, robot = dynamics.n, dynamics.robot
    wanted = w**2 * (q - state.y[:, :n]) + 2.0 * w * (dq - state.v[:, :n])
    H = dynamics.rigid.terms(state.y[:, :n], state.v[:, :n])[0] + dynamics.inertia[:n, :n]
    torque = (H @ wanted[..., None])[..., 0]
    return torque if robot.transmission.measured == "joint" else torque @ robot.transmission.K

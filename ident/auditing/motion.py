"""Audit of a run's motion: rest, noise, measured velocity against position, torque against motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .._utils.singular_values import svd
from ..errors import IdentError
from ..logs.log import Log
from ..logs.unwrap import unwrapped
from ..regressor.rigid import regressor
from ..robots.robot import Robot
from ..robots.transmission import Side
from ..signals.cutoff import HIGHEST, CutoffChoice, choose_cutoff
from ..signals.filters import butterworth_transient, central_differences, zero_phase_lowpass
from ..signals.resample import Clock, bridge
from ..signals.uniform import Recording, UniformRun, uniform_runs
from .columns import joint_names, positions, torque_of
from .delay import lags_of, minimum, say_delay
from .findings import AuditFinding, Severity
from .torque import wild_samples

Array = np.ndarray
Add = Callable[..., None]
_MOST_SAMPLES = 200_000
_MOST_ROWS = 5000
#: A factor so near to that of degrees is theirs: gears have ratios about 57, too.
_NEAR = 0.03


@dataclass(frozen=True, eq=False)
class _Motion:
    """The longest stretch of a run, smoothed. All (N, n) joint side; `torque` on the measured side, smoothed, gaps bridged."""

    run: UniformRun
    rate: float
    cutoff: float
    choice: CutoffChoice
    q: Array
    dq: Array
    ddq: Array
    torque: Array
    inner: slice


def check_motion(log: Log, robot: Robot | None) -> list[AuditFinding]:
    """Standstill, joints that never move, noise of positions, measured velocities, delay of torque, torque without effect."""
    out: list[AuditFinding] = []

    def add(code: str, severity: Severity, text: str, where: str = "", value: float = float("nan")) -> None:
        out.append(AuditFinding(code, severity, text, where, log.name, value))

    motion = _motion(log, robot)
    if motion is None:
        add("too_short", Severity.WARNING, "No stretch of the run is long and even enough to look at its motion.")
        return out
    names = joint_names(log, robot)
    still = _still(motion)
    _rest(add, names, motion, still)
    add("cutoff", Severity.INFO, f"Suggested cut-off {motion.cutoff:.3g} Hz: {motion.choice.reason}.", "", motion.cutoff)
    velocity = log.velocity(robot.transmission) if robot else log.dq
    if velocity is not None and motion.run.dq is not None:
        for j, name in enumerate(names):
            _velocity(add, name, j, motion)
    if robot is not None and log.tau:
        _dynamics(add, robot, motion, still)
    return out


def _motion(log: Log, robot: Robot | None) -> _Motion | None:
    q = positions(log, robot)
    turning = [j for j in range(log.n) if robot is None or not robot.joints[j].prismatic]
    q = q.copy()
    q[:, turning] = unwrapped(q[:, turning])
    measured, _ = torque_of(log, robot)
    torque = np.full(q.shape, np.nan) if measured is None else measured.copy()
    # A wild sample has a finding of its own, and must not make its whole joint look unrelated.
    for j in range(torque.shape[1]):
        torque[wild_samples(torque[:, j]), j] = np.nan
    velocity = log.velocity(robot.transmission) if robot else log.dq
    recording = Recording(log.name, log.t, q, torque, velocity, None, Clock.of(log.t), ())
    try:
        uniform = uniform_runs([recording], None, None, 5.0)
    except IdentError:
        return None
    run = max(uniform.runs, key=len)
    if len(run) < 64:
        return None
    if len(run) > _MOST_SAMPLES:
        start = (len(run) - _MOST_SAMPLES) // 2
        run = _part(run, slice(start, start + _MOST_SAMPLES))
    rate = uniform.rate
    prismatic = [robot.joints[j].prismatic if robot else False for j in range(log.n)]
    choice = choose_cutoff([run.q], rate, joint_names(log, robot), prismatic, highest=HIGHEST * rate)
    smooth = zero_phase_lowpass(run.q, choice.cutoff_hz, rate)
    dq, ddq = central_differences(smooth, rate)
    # No more than a fifth of a short run is given up at either end.
    margin = 3 + min(math.ceil(butterworth_transient(choice.cutoff_hz) * rate), len(run) // 5)
    inner = slice(margin, len(run) - margin)
    filtered = zero_phase_lowpass(bridge(run.t, run.torque), choice.cutoff_hz, rate)
    cut = slice(margin - 3, len(dq) - (margin - 3))
    return _Motion(run, rate, choice.cutoff_hz, choice, smooth[inner], dq[cut], ddq[cut], filtered, inner)


def _part(run: UniformRun, rows: slice) -> UniformRun:
    dq = None if run.dq is None else run.dq[rows]
    return UniformRun(run.name, run.t[rows], run.q[rows], run.torque[rows], run.missing[rows], dq, None, run.interpolated)


def _still(m: _Motion) -> Array:
    """Joints (n,) whose speed stays within the noise of their position."""
    noise = np.array([s.velocity_noise(m.cutoff) for s in m.choice.joints])
    rounding = 100 * np.spacing(np.abs(m.q).max(axis=0)) * m.rate
    return np.asarray(np.abs(m.dq).max(axis=0) <= np.maximum(6 * noise, rounding))


def _rest(add: Add, names: tuple[str, ...], m: _Motion, still: Array) -> None:
    top = np.abs(m.dq).max(axis=0)
    noise = np.array([s.velocity_noise(m.cutoff) for s in m.choice.joints])
    if still.all():
        add("no_motion", Severity.ERROR, "No joint moves: there is no motion to estimate dynamics from. Record an exciting motion.")
        return
    for j, name in enumerate(names):
        if still[j]:
            add(
                "never_moved",
                Severity.WARNING,
                "Never moved: its friction and rotor inertia stay unknown, and its links are known only as far as other"
                " joints reveal them. Its rows are left out.",
                name,
                top[j],
            )
            continue
        rest = float(np.mean(np.abs(m.dq[:, j]) <= max(0.01 * top[j], 3 * noise[j])))
        add(
            "standstill",
            Severity.WARNING if rest > 0.5 else Severity.INFO,
            f"Stands still in {rest:.0%} of the run (below 1 % of its top speed of {top[j]:.3g}). Dry friction is"
            f" undetermined there; these rows are left out." + (" Few rows remain: shorten the pauses." if rest > 0.5 else ""),
            name,
            rest,
        )
        share = m.choice.joints[j].acceleration_noise(m.cutoff) / max(float(np.mean(m.ddq[:, j] ** 2)), 1e-300)
        if share > 0.02:
            add(
                "noise",
                Severity.WARNING,
                f"{min(share, 1):.0%} of its acceleration's power is noise of its position at the suggested cut-off:"
                f" inertia will be underestimated by about as much. Move it faster, or lower the cut-off.",
                name,
                share,
            )


def _velocity(add: Add, name: str, j: int, m: _Motion) -> None:
    """Measured velocity against the derivative of position: sign, scale, lag."""
    assert m.run.dq is not None
    recorded = m.run.dq[:, j]
    if np.isnan(recorded).mean() > 0.5 or np.ptp(m.dq[:, j]) == 0:
        return
    reference = m.dq[:, j] - m.dq[:, j].mean()
    measured = zero_phase_lowpass(bridge(m.run.t, recorded[:, None]), m.cutoff, m.rate)[:, 0]
    inside = measured[m.inner]
    if np.std(inside) < 1e-3 * np.std(reference):
        add(
            "velocity",
            Severity.WARNING,
            "The measured velocity stays near zero while the joint moves: the column is not connected. It is not used.",
            name,
        )
        return
    lag, fit = _best_lag(measured[:, None], m, reference[:, None])
    at = np.interp(m.run.t[m.inner] + lag, m.run.t, measured)
    scale = float(reference @ (at - at.mean()) / (reference @ reference))
    same = float((reference @ (at - at.mean())) ** 2 / ((reference @ reference) * ((at - at.mean()) @ (at - at.mean()))))
    left = max(0.0, 1 - same)  # a velocity without noise: rounding alone would make it negative
    if left > 0.5:
        add(
            "velocity",
            Severity.WARNING,
            "The measured velocity does not follow the position: another joint's column, or another clock.",
            name,
            left,
        )
    elif scale < 0:
        add(
            "velocity_sign",
            Severity.WARNING,
            "The measured velocity has the opposite sign to the change in position: friction and damping would change sign.",
            name,
            scale,
        )
    elif abs(scale - 1) > max(0.02, 3 * math.sqrt(left / len(reference) * m.rate / m.cutoff)):
        add(
            "velocity_scale",
            Severity.WARNING,
            f"The measured velocity is {scale:.4g} times the rate of change of the position. {_told_by(scale, j)}",
            name,
            scale,
        )
    if fit and abs(lag) > 1.0 / m.rate and left < 0.5:
        which = "lags" if lag > 0 else "leads"
        add(
            "velocity_lag",
            Severity.INFO,
            f"The measured velocity {which} the position by {abs(lag) * 1e3:.3g} ms, as after a filter in the drive."
            f" Velocities are computed from positions.",
            name,
            lag,
        )


def _told_by(scale: float, j: int) -> str:
    """What the ratio of a velocity to the position's change suggests."""
    if abs(scale * math.pi / 180 - 1) < _NEAR:
        return f"It seems to be in degrees: name it dq{j + 1}_deg_s."
    if abs(scale * 180 / math.pi - 1) < _NEAR:
        return f"The position seems to be in degrees, which would corrupt every parameter: name it q{j + 1}_deg."
    return "Check units and gear ratio."


def _best_lag(signals: Array, m: _Motion, basis: Array) -> tuple[float, bool]:
    """Lag (s) at which `basis` (L, k) on the inner samples best explains `signals` (N, r), and whether it lies inside the range tried."""
    lags = lags_of(m.rate, m.inner.start)
    step = max(1, len(basis) // _MOST_ROWS)
    t = m.run.t[m.inner][::step]
    Q = np.linalg.qr(np.column_stack([basis[::step], np.ones(len(t))]))[0]
    left = np.zeros(len(lags))
    for x in signals.T:
        shifted = np.stack([np.interp(t + lag, m.run.t, x) for lag in lags], axis=1)
        left += np.sum((shifted - Q @ (Q.T @ shifted)) ** 2, axis=0) / max(float(np.sum(shifted**2)), 1e-300)
    return minimum(lags, left)


def _dynamics(add: Add, robot: Robot, m: _Motion, still: Array) -> None:
    """Torque against what the robot's structure can explain: the delay that fits best, and torque that hardly drives the motion."""
    if robot.floating_base:
        return
    step = max(1, len(m.q) // _MOST_ROWS)
    q, dq, ddq = m.q[::step], m.dq[::step], m.ddq[::step]
    columns = regressor(robot.tree, robot.tree_position(q), robot.tree_rate(dq), robot.tree_rate(ddq))
    side = robot.transmission.torque_map(Side.JOINT, robot.transmission.measured)
    columns = np.einsum("ij,njk->nik", side @ robot.loop.W.T, columns)
    on_motor = robot.transmission.measured == Side.MOTOR
    v, a = (robot.transmission.motor_rate(x) if on_motor else x for x in (dq, ddq))
    t = m.run.t[m.inner][::step]
    lags = lags_of(m.rate, m.inner.start)
    pooled, found = np.zeros(len(lags)), []
    for j, joint in enumerate(robot.joints):
        missing = m.run.missing[m.inner][::step][:, j]
        # Friction is no step at reversals; rows about them would be explained by a false delay.
        if still[j]:
            continue
        use = (np.abs(v[:, j]) > 0.15 * np.percentile(np.abs(v[:, j]), 99)) & ~missing
        basis = np.column_stack([columns[:, j], v[:, j], np.sign(v[:, j]), a[:, j], np.ones(len(t))])[use]
        shifted = np.stack([np.interp(t[use] + lag, m.run.t, m.torque[:, j]) for lag in lags], axis=1)
        told = _against_structure(basis, shifted)
        if told is None:
            continue
        left, balance = told
        pooled += left * use.sum()
        lag, inside = minimum(lags, left)
        found.append((lag, inside, float(left[len(lags) // 2])))
        if left[len(lags) // 2] > 0.5:
            add(
                "torque_unrelated",
                Severity.WARNING,
                f"The robot's structure explains only {1 - left[len(lags) // 2]:.0%} of its torque. Either hardly any torque drives this"
                " motion, or columns, signs, units or the side of the torque ([drive] measured) are mixed up.",
                joint.name,
                float(left[len(lags) // 2]),
            )
        elif balance > 2:
            add(
                "free_motion",
                Severity.WARNING,
                "Its torque is small against the inertial and gravity torques that cancel in this motion"
                f" ({balance:.2g} times larger): an almost free swing. Noisy accelerations then bias all least-squares"
                f" parameters towards zero. Keep the cut-off low, or drive the joint.",
                joint.name,
                balance,
            )
    say_delay(add, lags, pooled, found, m.rate)


def _against_structure(basis: Array, shifted: Array) -> tuple[Array, float] | None:
    """What columns (N, k) leave of torque at each of L lags (N, L), over that at the middle one; and how much larger than it the parts are
    that cancel in it. None where nothing can be told."""
    scale = np.linalg.norm(basis, axis=0)
    keep = scale > 1e-9 * scale.max(initial=0.0)
    if not keep.any() or len(basis) < 20 * keep.sum():
        return None
    middle = shifted[:, shifted.shape[1] // 2]
    energy = float(np.sum(middle**2))
    if energy <= 0 or not np.isfinite(energy):
        return None
    U, S, Vt = svd(basis[:, keep] / scale[keep], full_matrices=False)
    good = S > 1e-4 * S[0]
    U = U[:, good]
    left = np.sum((shifted - U @ (U.T @ shifted)) ** 2, axis=0) / energy
    # Only directions that are told well: between nearly equal columns anything cancels.
    solid = S[good] > 1e-2 * S[0]
    parts = (Vt[good][solid].T / S[good][solid]) @ (U[:, solid].T @ middle)
    return left, math.sqrt(float(np.sum((basis[:, keep] / scale[keep] * parts) ** 2)) / energy)

"""Runs at one uniform rate, cut at gaps: between logs as recorded and signals as prepared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._utils.text import counted
from ..errors import ConfigurationError, DataError
from ..logs.log import Log
from ..logs.repair import usable_numbers
from ..logs.torque import measured
from ..logs.unwrap import motor_turn_notes, unwrapped, wrapping
from ..robots.robot import Robot
from .resample import Clock, common_rate, extremes, flag_at, grid, interpolate, interpolate_torque, is_even, slow_clock, stretches, thin

Array = np.ndarray
#: A joint that goes so many times as far as from one sample to the next moves; a flickering encoder does not.
_MOVES = 4.0


@dataclass(frozen=True, eq=False)
class Recording:
    """A log in the robot's terms: joint positions (N, n), torque on the measured side (N, n), measured derivatives or None; `origin`:
    time at which the recording began."""

    name: str
    t: Array
    q: Array
    torque: Array
    dq: Array | None
    ddq: Array | None
    clock: Clock
    notes: tuple[str, ...]
    origin: float = 0.0

    @classmethod
    def of(cls, log: Log, robot: Robot) -> Recording:
        """Positions from the motors where need be and without jumps of a turn, torque on the measured side. Raises DataError."""
        if log.n != robot.n:
            raise DataError(
                f"log {log.name} has {counted(log.n, 'joint')}, but robot {robot.name!r} has {robot.n}: {', '.join(robot.joint_names)}."
            )
        notes = list(log.notes)
        if log.q is None and log.q_motor is not None:
            notes += motor_turn_notes(log.name, robot, wrapping(log.q_motor))
        recorded = log.position(robot.transmission)
        turning = [not j.prismatic for j in robot.joints]
        angles = recorded if all(turning) else recorded[:, turning]
        joined = unwrapped(angles)
        jumps: list[str] = []
        q = recorded
        if joined is not angles:
            q = recorded.copy()
            q[:, turning] = joined
            jumps = [name for j, name in enumerate(robot.joint_names) if not np.array_equal(q[:, j], recorded[:, j], equal_nan=True)]
        if jumps:
            notes.append(f"log {log.name}: positions of {', '.join(jumps)} jump by a full turn; they are unwrapped.")
        torque = measured(log, robot.transmission)
        notes += torque.notes
        missing = ~usable_numbers(torque.torque)
        least = np.where(missing, np.inf, torque.torque).min(axis=0)
        most = np.where(missing, -np.inf, torque.torque).max(axis=0)
        dead = dead_torque(least, most, np.ptp(q, axis=0), np.abs(np.diff(q, axis=0)).max(axis=0, initial=0.0))
        notes += torque_notes(log.name, robot, missing.sum(axis=0), len(log), dead, least)
        missing |= dead
        return cls(
            log.name,
            log.t,
            q,
            np.where(missing, np.nan, torque.torque) if missing.any() else torque.torque,
            log.velocity(robot.transmission),
            log.ddq,
            Clock.of(log.t),
            tuple(dict.fromkeys(notes)),
            log.began,
        )


def dead_torque(least: Array, most: Array, span: Array, step: Array) -> Array:
    """Joints (n,) that move, but whose torque never changes, where another's does: no friction or inertia does that, so nothing was
    measured. Where no torque changes, the drives were off, and nil may be what acted.

    `least`, `most`: extremes of the torque; `span`: range of the position; `step`: its largest change from one sample to the next
    (an encoder that flickers goes little further)."""
    return np.asarray((least == most) & (span > _MOVES * step) & np.any(least < most))


def torque_notes(name: str, robot: Robot, missing: Array, samples: int, dead: Array, value: Array) -> list[str]:
    """What to say of a log whose joints lack torque in `missing` (n,) of its samples, or hold but one `value` (n,) where they are
    `dead` (n,). Raises DataError where there is no torque at all."""
    absent = [joint for joint, count in zip(robot.joint_names, missing, strict=True) if count == samples]
    still = [f"{joint} (at {value[j]:.4g})" for j, joint in enumerate(robot.joint_names) if dead[j]]
    partly = [f"{joint} ({int(missing[j])})" for j, joint in enumerate(robot.joint_names) if 0 < missing[j] < samples and not dead[j]]
    if len(absent) == robot.n:
        raise DataError(f"log {name}: the torque columns hold no number.")
    notes = [f"log {name}: no torque of {', '.join(absent)}: their rows are not used."] if absent else []
    if still:
        notes.append(
            f"log {name}: torque never changes while the joint moves: {', '.join(still)}. The channel is not connected, or not of this"
            " joint; it is taken as not logged, and these rows are not used."
        )
    if partly:
        notes.append(f"log {name}: torque is missing in some samples of {', '.join(partly)}; rows that depend on them are not used.")
    return notes


@dataclass(frozen=True, eq=False)
class UniformRun:
    """A stretch without gap at one rate: `t` (N,), `q`, `torque`, `dq`, `ddq` (N, n) or None; `missing` (N, n): no torque there;
    `origin`: time at which the recording began."""

    name: str
    t: Array
    q: Array
    torque: Array
    missing: Array
    dq: Array | None
    ddq: Array | None
    interpolated: bool
    origin: float = 0.0

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, eq=False)
class Resampling:
    """Uniform runs, their rate (Hz), and in words what became of the time stamps."""

    runs: tuple[UniformRun, ...]
    rate: float
    text: str
    gaps: int
    thinned: int


def uniform_runs(recordings: Sequence[Recording], rate: float | None, longest_gap: float | None, cutoff: float | None) -> Resampling:
    """Put recordings on one uniform rate. `rate`: None takes the logs' own. `longest_gap` (s): longer steps cut a run; None: what a
    motion below `cutoff` (Hz) can be bridged over, a tenth of its period, and at least three and a half steps."""
    rate = rate_for([(r.name, r.clock) for r in recordings], rate)
    runs: list[UniformRun] = []
    gaps = thinned = 0
    for rec in recordings:
        limit = longest_gap or max(3.5 * rec.clock.step, 0.1 / cutoff if cutoff else 0.0)
        parts = [p for p in stretches(rec.t, limit) if p.stop - p.start >= 4]
        gaps += len(parts) - 1
        for k, part in enumerate(parts):
            run, lost = _uniform(rec, part, rate)
            thinned += lost
            runs.append(run if len(parts) == 1 else replace(run, name=f"{rec.name} [{k + 1}]"))
    text = resampling_text(len(runs), sum(r.interpolated for r in runs), rate, [(len(r.t), r.clock) for r in recordings], gaps, thinned)
    return Resampling(tuple(runs), rate, text, gaps, thinned)


def rate_for(clocks: Sequence[tuple[str, Clock]], rate: float | None) -> float:
    """The rate (Hz) that recordings are put on: the one asked for, or their own. `clocks`: each with the recording's name. Raises DataError
    where their stamps cannot be seconds."""
    own = common_rate([clock for _, clock in clocks])
    if why := slow_clock(1.0 / own):
        raise DataError(f"log {', '.join(dict.fromkeys(name for name, _ in clocks))}: {why}")
    if rate is not None and not 0 < rate <= 20 * own:
        raise ConfigurationError(f"resample_hz = {rate:g} makes no sense for logs of {own:.4g} Hz.")
    return rate or own


def resampling_text(runs: int, uneven: int, rate: float, recordings: Sequence[tuple[int, Clock]], gaps: int, thinned: int) -> str:
    """What became of the time stamps, in words: of `runs` stretches at `rate` (Hz), `uneven` are interpolated. `recordings`: samples and
    clock of each. Raises DataError where there is no stretch."""
    if not runs:
        longest = max(samples for samples, _ in recordings)
        if longest < 32:
            raise DataError(f"the longest log has {counted(longest, 'sample')}: too few to differentiate. Record longer runs.")
        raise DataError("no stretch of the logs is long enough: the time stamps have gaps everywhere. See `ident check`.")
    jitter = max(clock.jitter / clock.step for _, clock in recordings)
    missing = sum(clock.missing for _, clock in recordings)
    why = [f"{counted(missing, 'sample')} missing"] * (missing > 0) + [f"steps vary by {jitter:.1%} rms"] * (not missing or jitter > 0.001)
    text = (
        f"{uneven} of {counted(runs, 'stretch', plural='stretches')} resampled to {rate:.6g} Hz ({', '.join(why)})"
        if uneven
        else f"even, {rate:.6g} Hz"
    )
    text += f"; {counted(gaps, 'gap', 'cut')} the runs" if gaps else ""
    return text + (f"; {counted(thinned, 'sample')} too close to the one before left out" if thinned else "")


def _uniform(rec: Recording, part: slice, rate: float) -> tuple[UniformRun, int]:
    t = rec.t[part]
    rows: slice | Array = part
    if is_even(t, rate, rec.clock):
        at = t[0] + np.arange(len(t)) / rate
        missing = np.isnan(rec.torque[rows])
        arrays = [None if a is None else a[rows] for a in (rec.dq, rec.ddq)]
        return UniformRun(rec.name, at, rec.q[rows], rec.torque[rows], missing, arrays[0], arrays[1], False, rec.origin), 0
    keep = thin(t, rec.clock.step)
    rows = part.start + keep
    lost = len(t) - len(keep)
    t = t[keep]
    at = grid(t, rate)
    missing = flag_at(t, np.isnan(rec.torque[rows]), at)
    torque = np.where(missing, np.nan, interpolate_torque(t, rec.torque[rows], at, *extremes(rec.torque)))
    arrays = [None if a is None else interpolate(t, a[rows], at) for a in (rec.dq, rec.ddq)]
    return UniformRun(rec.name, at, interpolate(t, rec.q[rows], at), torque, missing, arrays[0], arrays[1], True, rec.origin), lost

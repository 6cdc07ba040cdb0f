"""What the whole log decides about its rows, from one pass over its motion: standstill, saturation, joints that never move.

The rules are those of `ident.signals.sound` and `ident.signals.masks`; here the facts are gathered piece by piece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce

import numpy as np

from ..robots.robot import Robot
from ..robots.transmission import Side
from ..signals.cutoff import CutoffChoice
from ..signals.masks import SPEEDS_ENOUGH, Standstill, TorqueClipping, longest_usual_hold
from ..signals.sound import speed_noise
from .disk import PASS, over_rows
from .motion import DerivedRun
from .workers import Workers

Array = np.ndarray


@dataclass(frozen=True)
class Part:
    """Samples `a` … `b` - 1 of a derived run."""

    run: DerivedRun
    a: int
    b: int


@dataclass(frozen=True, eq=False)
class Extremes:
    """Over samples, (n,) each: `top`: largest speed on the measured side; `far`: largest distance of the position from zero; `least`,
    `most`: extremes of the torque that is there; `finite`: samples with torque."""

    top: Array
    far: Array
    least: Array
    most: Array
    finite: Array

    def __add__(self, other: Extremes) -> Extremes:
        return Extremes(
            np.maximum(self.top, other.top),
            np.maximum(self.far, other.far),
            np.minimum(self.least, other.least),
            np.maximum(self.most, other.most),
            self.finite + other.finite,
        )


def extremes_of(part: Part) -> Extremes:
    """Extremes over a part of a run."""
    found, drive = part.run.at(part.a, part.b), part.run.run.robot.transmission
    speed = found.dq if drive.measured == Side.JOINT else drive.motor_rate(found.dq)
    least, most, finite = found.torque, found.torque, np.full(speed.shape[1], len(speed))
    if found.missing.any():
        least, most = (np.where(found.missing, other, found.torque) for other in (np.inf, -np.inf))
        finite = finite - found.missing.sum(axis=0)
    top, far = (over_rows(np.maximum, np.abs(x)) for x in (speed, found.q))
    return Extremes(top, far, over_rows(np.minimum, least), over_rows(np.maximum, most), finite)


@dataclass(frozen=True, eq=False)
class Decisions:
    """`still` (n,) bool: never moved; `top`, `threshold` (n,): speeds on the measured side; `cut` (n, 2): torque at which it is cut off
    (NaN: nowhere), with the span `span` (n,) by which equality is judged; `saturation`: for reports."""

    still: Array
    top: Array
    threshold: Array
    cut: Array
    span: Array
    saturation: TorqueClipping = field(repr=False)

    def at_limit(self, torque: Array) -> Array:
        """Samples (L, n) at which torque is cut off."""
        flag = np.zeros(torque.shape, bool)
        for j, limits in enumerate(self.cut):
            for limit in limits[np.isfinite(limits)]:
                flag[:, j] |= np.abs(torque[:, j] - limit) <= 1e-9 * self.span[j]
        return flag


def decide(
    robot: Robot,
    runs: Sequence[DerivedRun],
    parts: Sequence[Part],
    rule: Standstill | None,
    choice: CutoffChoice,
    cutoff: float,
    workers: Workers,
) -> Decisions:
    """One pass over the motion of all runs (`parts`: they, cut), and one over their torque."""
    rate = runs[0].derivation.rate
    each = tuple(workers.map(extremes_of, parts))
    found = reduce(Extremes.__add__, each)
    noise = speed_noise(robot, choice, cutoff)
    # Differences of a constant leave only rounding.
    rounding = 100 * np.spacing(found.far) * rate
    if robot.transmission.measured == Side.MOTOR:
        rounding = np.abs(robot.transmission.K_inverse) @ rounding
    still = found.top <= np.maximum(6 * noise, rounding)
    threshold = np.zeros(robot.n) if rule is None else np.where(still, np.inf, rule.thresholds(found.top, noise))
    moving = np.where(still, np.inf, np.maximum(threshold, 0.01 * found.top))
    span = np.where(found.finite > 0, found.most - found.least, 0.0)
    cut, counts = _limits(runs, [Reaching(*pair) for pair in zip(parts, each, strict=True)], found, moving, workers)
    return Decisions(still, found.top, threshold, cut, span, TorqueClipping(counts[None], cut))


@dataclass(frozen=True, eq=False)
class _Plateau:
    """Torque at its extremes in a part, for each joint and side: `at`, `near` (n, 2) samples, and the lengths of the runs of samples
    at the extreme: `longest` within, `head` and `tail` at the ends; `full`: all of the part."""

    at: Array
    near: Array
    longest: Array
    head: Array
    tail: Array
    full: Array

    def __add__(self, other: _Plateau) -> _Plateau:
        """The next part of the same sequence."""
        across = self.tail + other.head
        return _Plateau(
            self.at + other.at,
            self.near + other.near,
            np.maximum(np.maximum(self.longest, other.longest), across),
            np.where(self.full, self.head + other.head, self.head),
            np.where(other.full, other.tail + self.tail, other.tail),
            self.full & other.full,
        )


@dataclass(frozen=True)
class Reaching:
    """A part, and how far its torque reaches."""

    part: Part
    extremes: Extremes

    def torque(self) -> Array:
        """Torque (L, n) of its samples."""
        run = self.part.run
        return run.run.read(run.start + self.part.a, run.start + self.part.b).torque

    def reaches(self, levels: Array, within: Array) -> Array:
        """Which of the levels (n, 2), below and above, it comes as near to as `within` (n,)."""
        ends = np.stack([self.extremes.least, self.extremes.most], axis=1)
        return np.asarray(np.abs(ends - levels) <= within[:, None])


@dataclass(frozen=True, eq=False)
class _PlateauOf:
    """Counts torque at given extremes: `levels` (n, 2), `span` and `nearby` (n,)."""

    levels: Array
    span: Array
    nearby: Array

    def __call__(self, piece: Reaching) -> _Plateau:
        at, near, longest, head, tail, full = (np.zeros(self.levels.shape, int) for _ in range(6))
        reached = np.argwhere(piece.reaches(self.levels, np.maximum(self.nearby, 1e-9 * self.span)))
        torque = piece.torque() if len(reached) else np.zeros((0, len(self.levels)))
        for j, s in reached:
            off = np.abs(torque[:, j] - self.levels[j, s])
            flag = off <= 1e-9 * self.span[j]
            at[j, s] = flag.sum()
            near[j, s] = np.count_nonzero((off <= self.nearby[j]) & ~flag)
            if at[j, s]:
                edges = np.flatnonzero(np.diff(np.r_[False, flag, False]))
                starts, stops = edges[::2], edges[1::2]
                longest[j, s] = (stops - starts).max()
                head[j, s] = stops[0] if starts[0] == 0 else 0
                tail[j, s] = len(flag) - starts[-1] if stops[-1] == len(flag) else 0
                full[j, s] = at[j, s] == len(flag)
        return _Plateau(at, near, longest, head, tail, full.astype(bool))


def _limits(runs: Sequence[DerivedRun], parts: Sequence[Reaching], found: Extremes, moving: Array, workers: Workers) -> tuple[Array, Array]:
    """Limits (n, 2) at which torque is cut off, NaN where none is, and how many samples of each joint lie there (n,)."""
    n = len(moving)
    limits, counts = np.full((n, 2), np.nan), np.zeros(n, int)
    lead = _leading_torque(runs)
    span = np.where(found.finite > 0, found.most - found.least, 0.0)
    step, held = np.zeros(n), np.ones(n)
    for j, x in enumerate(lead):
        if found.finite[j] < 50 or span[j] == 0:
            continue
        changes = np.abs(np.diff(x))
        distinct = changes[changes > 1e-9 * span[j]]
        if len(distinct):
            step[j] = float(np.percentile(distinct, 1))
            held[j] = longest_usual_hold(x)
    judged = step > 0
    if not judged.any():
        return limits, counts
    levels = np.where(judged[:, None], np.stack([found.least, found.most], axis=1), np.nan)
    largest = np.maximum(np.abs(found.least), np.abs(found.most))
    # A motor that is off, or torque of one sign: no limit of a drive.
    levels[np.abs(levels) < 0.3 * largest[:, None]] = np.nan
    facts = reduce(_Plateau.__add__, workers.map(_PlateauOf(levels, span, np.maximum(3.5 * step, 0.01 * span)), parts))
    for j in range(n):
        for s in range(2):
            if not facts.at[j, s] or facts.longest[j, s] < max(5, 4 * held[j]) or facts.at[j, s] < 3 * facts.near[j, s]:
                continue
            there = [piece for piece in parts if piece.reaches(levels, 1e-9 * span)[j, s]]
            if _moving_share(there, j, float(levels[j, s]), float(span[j]), float(moving[j])) >= 0.5:
                limits[j, s] = levels[j, s]
                counts[j] += facts.at[j, s]
    return limits, counts


def _moving_share(parts: Sequence[Reaching], j: int, level: float, span: float, moving: float) -> float:
    """Share of the samples at a torque level in which the joint moves."""
    at = moved = 0
    for piece in parts:
        part, run = piece.part, piece.part.run
        drive = run.run.robot.transmission
        flag = np.abs(piece.torque()[:, j] - level) <= 1e-9 * span
        if flag.any():
            dq = run.at(part.a, part.b).dq
            speed = dq if drive.measured == Side.JOINT else drive.motor_rate(dq)
            at += int(flag.sum())
            moved += int((np.abs(speed[flag, j]) > moving).sum())
    return moved / max(1, at)


def _leading_torque(runs: Sequence[DerivedRun]) -> list[Array]:
    """The first torques that are there, as many of each joint as tell its steps."""
    n = runs[0].run.robot.n
    held: list[list[Array]] = [[] for _ in range(n)]
    for run in runs:
        for a in range(0, len(run), PASS):
            torque = run.run.read(run.start + a, run.start + min(a + PASS, len(run))).torque
            for j in range(n):
                if sum(map(len, held[j])) < SPEEDS_ENOUGH:
                    held[j].append(torque[np.isfinite(torque[:, j]), j])
            if all(sum(map(len, h)) >= SPEEDS_ENOUGH for h in held):
                break
        else:
            continue
        break
    return [np.concatenate(h)[:SPEEDS_ENOUGH] if h else np.zeros(0) for h in held]

"""What no search over effects sees, but anyone who looks: positions that jump, joints that are lost,
held-out data that are of another kind."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..effects.base import Need
from .analysis import without_reversals
from .change import inverse_squares
from .findings import Unexplained
from .foretelling import Foretelling
from .irregular import BURSTS, over_usual

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

Array = np.ndarray
#: Errors on held-out data that are so many times those on fitted data are no scatter, from so many rows on (on 378 clean logs of the test
#: bed no joint came above 1.5).
APART = 2.2
#: From here on what is in them may be looked for in both parts together: a search finds something or nothing.
HINTED = 1.3
#: Errors on held-out data of so many times the noise floor, beyond what parameters are off by, are more than a model that is called whole
#: may leave (where one was rightly, 1.36 at most on the logs of the test bed whose plain error was largest, 1.5 to 2.0).
_NOT_NOISE = 1.7
_FEW = 100
#: Signature of what sits in the part held out.
ELSEWHERE = "the part of the logs held out"
#: A joint of fewer usable rows than this share is lost, if it moved for so much of the time, by more than so many deviations of its
#: position's noise.
_LOST = 0.02
_MOVING = 0.2
_SPAN = 1e3
#: Stretches of a run in which an error is looked at apart.
_STRETCHES = 10


def jumps(signals: Signals) -> tuple[Unexplained, ...]:
    """Joints whose recorded position jumps (an encoder that slips, a wrong sample): what is around a jump is lost to any fit."""
    from ..auditing.columns import position_jumps, positions
    from ..logs.unwrap import unwrapped

    found: dict[str, Unexplained] = {}
    for log in () if signals.source is None else signals.source:
        q = positions(log, signals.robot)
        for j, joint in enumerate(signals.robot.joint_names):
            x = q[:, j] if signals.robot.joints[j].prismatic else unwrapped(q[:, j : j + 1])[:, 0]
            here = [at for at in log.t[position_jumps(log.t, x)] if _rests_on(signals, float(at))]
            if here and joint not in found:
                said = (
                    f"{joint}: its position jumps at {here[0]:.12g} s (log {log.name}), as no motion does: a wrong sample, or, if it stays"
                    " away after that, an encoder or a coupling that slipped. Cut it out; what is fitted around it is worth nothing"
                )
                found[joint] = Unexplained(joint, "a jump of its position", said, 0.0)
    return tuple(found.values())


def _rests_on(signals: Signals, at: float) -> bool:
    """Whether rows lie on both sides of a moment; at the ends of a log the filters leave it out."""
    times = (signals.row_time[rows] for rows in signals.row_runs)
    return any(len(t) and t[0] < at < t[-1] for t in times)


def lost(signals: Signals) -> tuple[Unexplained, ...]:
    """Joints that move, but so restlessly (knocks, shaking, jumps) that next to none of their rows can be used."""
    robot, found = signals.robot, []
    rows = signals.valid.sum(axis=0)
    for j, (joint, report) in enumerate(zip(robot.joint_names, signals.report.joints, strict=True)):
        if rows[j] > _LOST * len(signals.valid) or not np.isfinite(signals.tau[:, j]).any():
            continue
        speed = np.abs(signals.dq[:, j])
        moving = float(np.mean(speed > 0.05 * np.quantile(speed, 0.95))) if len(speed) else 0.0
        if moving > _MOVING and float(np.ptp(signals.q[:, j])) > _SPAN * max(report.noise, 1e-12):
            said = (
                f"{joint}: it moves, but {rows[j]} of {len(signals.valid)} rows can be used: so restlessly that the sense of its speed"
                " cannot be told (it shakes, jumps or knocks). Nothing is said about this joint"
            )
            found.append(Unexplained(joint, "rows that had to be left out", said, 0.0))
    return tuple(found)


def apart(after: Estimate, fitted: Signals, held: Signals) -> tuple[Unexplained, ...]:
    """Joints on which the fit fails on held-out data as it does not on its own: something is there that was not before. Near reversals
    a joint may stick in one part and not in the other; that is not meant, nor what parameters are off by that the fitted motion tells
    little of."""
    return _larger(after, fitted, held, lambda inside, rows: Foretelling(after, rows).allowing(inverse_squares(inside))[0], APART)


def hinted(after: Estimate, fitted: Signals, held: Signals) -> tuple[Unexplained, ...]:
    """Joints on which the error on held-out data is larger, whatever for: parameters that the fitted motion tells little of, or something
    that shows in that part more than in the other."""
    return _larger(after, fitted, held, lambda _, rows: after.residual(rows), HINTED)


def above_floor(after: Estimate, fitted: Signals, held: Signals, floor: Array) -> tuple[Unexplained, ...]:
    """Joints on which the error on held-out data is larger than on those fitted, several times the noise `floor` (n,), and held by some of
    the rows: too much for a model that is called whole, though not so much that it says so by itself. Of rows that are all as large,
    louder noise is as good a reason. Laws that remember the motion (presliding, play) leave as much where they are the true ones, and on
    other joints, too: beside them nothing is said."""
    if Need.HISTORY in after.model.needs:
        return ()
    robot, there = after.model.robot, Foretelling(after, without_reversals(held))
    found = []
    for u in hinted(after, fitted, held):
        j = robot.joint_names.index(u.joint)
        weight = np.where(np.arange(robot.n) == j, inverse_squares(floor), 0.0)
        left = there.residual[np.isfinite(there.residual[:, j]), j]
        times = np.sqrt(there.misfit(weight) / len(left))
        if times > _NOT_NOISE and float(np.mean(over_usual(left))) > BURSTS**2:
            said = (
                f"{u.joint}: the error on held-out data is {times:.3g} times the noise floor, most of it in some of the rows, and larger"
                " than on fitted data: something is there that this model does not hold and that the fitted part hardly shows; nothing here"
                " can say what"
            )
            found.append(replace(u, evidence=said))
    return tuple(found)


def _larger(
    after: Estimate, fitted: Signals, held: Signals, left: Callable[[Array, Signals], Array], least: float
) -> tuple[Unexplained, ...]:
    """Joints on which what is `left` (of errors (n,) on fitted data, and held-out rows: a residual (M, n)) is so many times as large."""
    fitted, held = without_reversals(fitted), without_reversals(held)
    inside = _error(after, after.residual(fitted), fitted)
    outside = _error(after, left(inside, held), held)
    enough = (fitted.valid.sum(axis=0) >= _FEW) & (held.valid.sum(axis=0) >= _FEW)
    found = []
    for j in enough.nonzero()[0].tolist():
        joint, ratio = after.model.robot.joint_names[j], outside[j] / max(inside[j], 1e-300)
        if ratio > least:
            said = (
                f"{joint}: the error on held-out data is {ratio:.3g} times that on fitted data: something is in that part of the logs that"
                " the fitted part does not hold (a change, a slip, motion outside the range); nothing here can say what"
            )
            found.append(Unexplained(joint, ELSEWHERE, said, float(held.valid[:, j].sum() * (ratio**2 - 1.0))))
    return tuple(found)


def _error(estimate: Estimate, residual: Array, signals: Signals) -> Array:
    """Root mean square (n,) of a residual (M, n). Where an effect remembers the motion before, nobody knows what it was before a run began:
    then that of the stretch in the middle of all, ordered by it."""
    whole = [slice(0, len(residual))]
    if Need.HISTORY in estimate.model.needs:
        whole = [
            slice(p[0], p[-1] + 1) for run in signals.row_runs for p in np.array_split(np.arange(run.start, run.stop), _STRETCHES) if len(p)
        ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a stretch without a row of some joint
        return np.asarray(np.nanmedian([np.sqrt(np.nanmean(residual[part] ** 2, axis=0)) for part in whole], axis=0))

"""What no change accounts for: parameters that moved together, and a residual larger than the fit's own logs left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .frame import KnownFrame
from .result import Drift
from .stages.evidence import FALSE_ALARM
from .stages.leftover import leftovers

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from .stages.acceptance import Found
    from .stages.stage import Stage

Array = np.ndarray
#: Free parameters must predict blocks that they were not fitted to better, by this many standard errors.
_SURE = 3.0
#: Structure that is a smaller share of what is left is of no account, however sure it is: no model is exact.
LEAST_SHARE = 0.01
#: A residual is as usual up to this multiple (rms) of what the fit left on its own logs: motions differ, and so does what models lack.
_USUAL = 1.5
#: More effects than these on one joint that the model never had are the imitators of something that the catalogue lacks.
_MOST_NEW = 2
#: A residual's size tells most where it is largest: below this excess kurtosis it is no matter of a few moments.
_BURSTS = 3.0


def unknown(estimate: Estimate, signals: Signals) -> tuple[Drift, ...]:
    """Joints with torque in the new logs of which the fit has no row: neither their parameters nor their noise are known."""
    names = estimate.model.robot.joint_names
    text = "the fit was made without a usable row of it (no motion, or no torque), so that a change there cannot be told; fit it anew"
    blind = (estimate.fit_error.rows == 0) & signals.valid.any(axis=0)
    return tuple(Drift(names[j], "not known from the fit", f"{names[j]}: {text}") for j in blind.nonzero()[0].tolist())


def drifts(frame: KnownFrame) -> tuple[Drift, ...]:
    """Whether the parameters as a whole lie where the fit had them, in the doubt of both."""
    from scipy.stats import f

    moved, gain = frame.freed()
    residual = float(np.sum(frame.residual**2))
    chance = frame.own * float(f.isf(FALSE_ALARM, frame.own, frame.freedom(np.ones(len(frame.columns), bool))))
    sure = float(gain.sum()) > _SURE * float(np.sqrt(len(gain)) * gain.std(ddof=1))
    if moved <= chance or moved <= LEAST_SHARE * residual or not sure:
        return ()
    free = _free_residual(frame)
    fall = np.sum(frame.residual**2, axis=1) - np.sum(free**2, axis=1)
    names = frame.problem.model.robot.joint_names
    shown = [int(j) for j in np.argsort(-fall) if fall[j] > 0.1 * fall.sum()]
    text = f"parameters moved by more than both logs' doubt (chi-square {moved:.0f} for {frame.own})"
    return tuple(
        Drift(
            names[j],
            "parameters as a whole",
            f"{names[j]}: {text}; refitted, {fall[j] / np.sum(frame.residual[j] ** 2):.0%} of its squared error goes",
        )
        for j in shown
    )


def _free_residual(frame: KnownFrame) -> Array:
    X = frame.columns.reshape(-1, frame.columns.shape[2])
    solution = np.linalg.lstsq(X, frame.torque.reshape(-1), rcond=1e-10)[0]
    return np.asarray(frame.torque - frame.columns @ solution)


def loudness(frame: KnownFrame) -> Array:
    """Rms (n,) of the residual over what the fit left on its own logs; 1 where a joint has no rows."""
    rows = frame.problem.signals.valid.sum(axis=0)
    return np.sqrt(np.where(rows > 0, np.sum(frame.residual**2, axis=1) / np.maximum(rows, 1), 1.0))


def loud(frame: KnownFrame) -> Array:
    """Joints (n,) bool whose residual is larger than usual, beyond chance and beyond what another motion makes of an inexact model."""
    from scipy.stats import chi2

    n = len(frame.columns)
    freedom = np.array([frame.freedom(np.arange(n) == j) for j in range(n)])
    chance = np.sqrt(chi2.isf(FALSE_ALARM / n, freedom) / freedom)
    return np.asarray(loudness(frame) > np.maximum(_USUAL, chance))


def noises(stage: Stage, found: tuple[Found, ...]) -> tuple[Drift, ...]:
    """Joints whose residual stays larger than usual with all changes in the model, and what it follows."""
    frame = stage.frame
    assert isinstance(frame, KnownFrame)
    names, ratio = stage.problem.model.robot.joint_names, loudness(frame)
    over = np.flatnonzero(loud(frame))
    if not len(over):
        return ()
    left = {x.joint: x for x in leftovers(stage, found)}
    out = []
    for j in over[np.argsort(-ratio[over])]:
        size = f"{names[j]}: the residual is {ratio[j]:.2g} times as large as on the fit's own logs (rms)"
        follows = left[int(j)].signature if int(j) in left else _in_time(frame, int(j))
        out.append(Drift(names[j], follows, f"{size}, and follows {follows}" if int(j) in left else f"{size}, {follows}"))
    return tuple(out)


def _in_time(frame: KnownFrame, j: int) -> str:
    x = frame.residual[j][frame.problem.signals.valid[:, j]]
    spread = float(np.mean(x**2))
    kurtosis = float(np.mean(x**4)) / spread**2 - 3.0 if spread > 0 else 0.0
    return "in bursts" if kurtosis > _BURSTS else "like noise"


def crowds(effects: Sequence[Effect]) -> tuple[Drift, ...]:
    """Joints on which too many effects that the model never had would have appeared at once."""
    names: dict[str, list[str]] = {}
    for effect in effects:
        for joint in effect.joints or ():
            names.setdefault(joint, []).append(effect.name)
    return tuple(
        Drift(
            joint,
            "several effects at once",
            f"{joint}: {len(own)} effects that the model never had ({', '.join(own)}) account for it only together; more likely it is one"
            " that the catalogue lacks",
        )
        for joint, own in names.items()
        if len(own) > _MOST_NEW
    )


def trust(frame: KnownFrame, rows: Array, evidence: float) -> float:
    """How far a change may be believed whose joints `rows` (n,) bool stay louder than usual: by what it leaves there beside what it
    explains."""
    over = rows & loud(frame)
    if not over.any():
        return 1.0
    count = frame.problem.signals.valid.sum(axis=0)
    beyond = float(np.sum(np.sum(frame.residual[over] ** 2, axis=1) - count[over]))
    share = beyond / max(beyond + evidence, 1e-300)
    return 1.0 / (1.0 + (share / 0.1) ** 2)

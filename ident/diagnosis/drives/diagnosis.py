"""`diagnose_drives`: candidate effects simulated in the loop, decided by fits beside each other and by readings held out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...drives.fit import result_of
from ...drives.folds import held_out
from ...drives.plant import DrivePlant
from ...drives.search import Fitted, fitted, refitted
from ...drives.space import drive_logs
from ...drives.starts import moved_inertia, starts
from ..verdict import Verdict
from .candidates import values_in
from .result import DriveDiagnosis, DriveFinding, DriveRival
from .screening import FORETOLD, LEAST, SIGNIFICANT, Screened, screened, structure

if TYPE_CHECKING:
    from ...drives.law import DriveLaw
    from ...logs.log import LogSet
    from ...model import Model

Array = np.ndarray
#: Findings at most, candidates that are fitted for each, and steps of such a fit.
_FINDINGS, _FITTED, _STEPS = 3, 8, 30
#: Squared standard deviations below which one model is as good as another.
_ALIKE = 9.0
#: So many of the best are held against readings that they were not fitted to.
_CONFIRMED = 2


def diagnose_drives(
    logs: LogSet, model: Model, law: DriveLaw, *, held: LogSet | None = None, progress: Callable[[float], None] | None = None
) -> DriveDiagnosis:
    """What a declared model and drive law lack, by the positions that the logged commands lead to in simulation.

    Parameters
    ----------
    logs : LogSet
        Logs with positions and commands.
    model : Model
        Rigid body and declared effects.
    law : DriveLaw
        The declared law: what it gives as a number (kp, delay) is doubted, what is to be identified is not.
    held : LogSet, optional
        Logs to report the error before and after on.

    Returns
    -------
    DriveDiagnosis
    """
    plant = DrivePlant(model, law, drive_logs(logs, model.robot, law))
    at, sizes = starts(plant)
    fit = fitted(plant, at, sizes, progress=progress)
    inertia = moved_inertia(plant)
    first, now = (plant, fit, sizes), (plant, fit, sizes)
    findings: list[DriveFinding] = []
    while len(findings) < _FINDINGS:
        tried = [_tried(*now, one, inertia) for one in screened(now[0], now[1], inertia)[:_FITTED]]
        better = _believed(now, [one for one in tried if one is not None])
        if not better:
            break
        finding, now = _decided(now, better)
        findings.append(finding)
    before = result_of(*first, logs.inputs)
    after = result_of(*now, logs.inputs)
    left = structure(now[1])
    if held is not None:
        before, after = before.with_heldout(held), after.with_heldout(held)
    return DriveDiagnosis(_verdict(findings, left), tuple(findings), left, before, after)


_Stage = tuple[DrivePlant, Fitted, Array]


def _tried(plant: DrivePlant, fit: Fitted, sizes: Array, one: Screened, inertia: Array) -> tuple[Screened, _Stage] | None:
    """The model with a candidate, fitted with the weights of the one without; None where nothing is gained."""
    wider = one.candidate.added_to(plant, one.joints)
    at, wide, own = values_in(wider, plant, fit.values, one.candidate, inertia)
    for i in np.flatnonzero(own):
        if wider.unknowns[i].place == one.candidate.place != "joint_stiffness":
            at[i] = max(at[i] + one.step[one.joints.index(max(wider.unknowns[i].joint, 0))], wider.unknowns[i].lower)
    found = refitted(wider, at, wide, fit.weights, steps=_STEPS)
    spread = _spread(found)
    gained = fit.cost - found.cost > SIGNIFICANT**2 * spread and np.isfinite(found.cost)
    return (one, (wider, found, wide)) if gained else None


def _believed(now: _Stage, tried: list[tuple[Screened, _Stage]]) -> list[tuple[Screened, _Stage]]:
    """Those that do better on readings held out, the best of the rest first, with what they take off those: nothing else is believed."""
    counts, out = np.square(now[1].weights), []
    before = np.nansum(held_out(*now).squares * counts) if tried else 0.0
    for one, stage in sorted(tried, key=lambda pair: pair[1][1].cost):
        gain = float(1.0 - np.nansum(held_out(*stage).squares * counts) / max(before, 1e-300))
        if np.isfinite(gain) and gain > LEAST:
            out.append((replace(one, gain=gain), stage))
        if len(out) == _CONFIRMED:
            break
    return out


def _spread(fit: Fitted) -> float:
    """Variance of the weighted residual, as large as its memory makes it count."""
    weighted = fit.residual * fit.weights
    count = max(int(np.count_nonzero(fit.weights)) - len(fit.values), 1)
    r = weighted.reshape(-1, weighted.shape[1])
    own: Array = np.sum(r * r, axis=0)
    ahead: Array = np.sum(r[1:] * r[:-1], axis=0) / np.maximum(own, 1e-300)
    share = float(np.clip(ahead, 0.0, 0.99).max())
    return float(np.sum(own)) / count * (1.0 + share) / (1.0 - share)


def _decided(now: _Stage, tried: list[tuple[Screened, _Stage]]) -> tuple[DriveFinding, _Stage]:
    """The best of them, with those that explain as much."""
    tried = sorted(tried, key=lambda pair: pair[1][1].cost)
    (one, stage), others = tried[0], tried[1:]
    spread = _spread(stage[1])
    behind = np.array([(other[1].cost - stage[1].cost) / spread for _, other in others])
    odds = np.exp(-0.5 * np.minimum(behind, 1e3))
    rivals = tuple(
        DriveRival(other.candidate.name, _names(stage[0], other), float(odd / (1.0 + odds.sum())))
        for (other, _), odd, far in zip(others, odds, behind, strict=True)
        if far < _ALIKE
    )
    fit = result_of(*stage)
    new = [i for i, u in enumerate(stage[0].unknowns) if (u.place, u.joint) not in {(k.place, k.joint) for k in now[0].unknowns}]
    values = tuple(
        (stage[0].unknowns[i].name, float(fit.values[i]), float(np.sqrt(fit.covariance[i, i])), stage[0].unknowns[i].unit) for i in new
    )
    declared = None
    if one.candidate.place in now[0].law.constants and one.candidate.either_way:
        declared = one.candidate.declared(now[0].law, one.joints[0])
    joints = tuple(stage[0].robot.joint_names) if one.candidate.place == "delay_s" else _names(stage[0], one)
    finding = DriveFinding(one.candidate.name, joints, values, declared, one.gain, float(1.0 / (1.0 + odds.sum())), rivals)
    plant, found, sizes = stage
    rms = np.sqrt(np.sum(np.square(found.residual * (found.weights > 0)), axis=0) / np.maximum((found.weights > 0).sum(axis=0), 1))
    return finding, (plant, replace(found, weights=(found.weights > 0) / np.maximum(rms, 1e-12)), sizes)


def _names(plant: DrivePlant, one: Screened) -> tuple[str, ...]:
    return tuple(plant.robot.joint_names[j] for j in one.joints)


def _verdict(findings: list[DriveFinding], left: float) -> Verdict:
    if left > FORETOLD:
        return Verdict.UNEXPLAINED
    if not findings:
        return Verdict.CLEAN
    return Verdict.AMBIGUOUS if any(finding.rivals for finding in findings) else Verdict.EXPLAINED

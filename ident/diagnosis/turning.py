"""Rows near reversals in the refit: they were not looked at when the findings were chosen, and may contradict them.

What a delay, an elastic gear or play does at a reversal depends on how the contact holds there; columns that follow the motion as it
would be without a contact say something else, and a fit of all rows then finds a fraction of what the other rows tell. A fit that has
them bends to them, and hides how little they agree with the rest; so they are judged by one that has none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .analysis import without_turning
from .evidence import touched

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from .stage import Stage

Array = np.ndarray

#: Mean square of what a fit of the other rows leaves on rows near a joint's reversals, over that on its others, beyond which they are left
#: out: at their full weight they cost more than they tell, however few they are.
_STICKS = 4.0
#: A parameter differs if it does so by this many of its standard deviations without those rows, and by this share of itself.
_SURELY = 4.0
_SHARE = 0.1
#: Rows of a joint are left out where at least this share of them is kept.
_KEPT = 0.6
#: And where no standard deviation of what was found grows more than this many times.
_VAGUER = 2.0


def sticking(stage: Stage, rows: Signals, fitted: Callable[[tuple[str, ...]], Estimate]) -> tuple[str, ...]:
    """Joints whose rows near reversals hold much more than noise beside a stage's model, and no friction at low speed was found in them.
    `rows`: that are fitted; `fitted`: the estimate without those near reversals of some joints."""
    names = np.array(rows.robot.joint_names)
    kept = _kept(rows, without_turning(rows, names.tolist())) & np.array([name not in stage.turning for name in names])
    if not kept.any():
        return ()
    all_of_them = tuple(names[kept].tolist())
    less = without_turning(rows, all_of_them)
    estimate = replace(fitted(all_of_them), sticking=())
    squares = np.nan_to_num(estimate.residual(rows)) ** 2
    near = rows.valid & ~less.valid
    there, elsewhere = (np.where(at, squares, 0.0).sum(axis=0) / np.maximum(at.sum(axis=0), 1) for at in (near, less.valid))
    return tuple(names[there > _STICKS * elsewhere].tolist())


def left_out(joints: Sequence[str], rows: Signals) -> str:
    """What is to be said of joints whose rows near reversals are left out of the fits of `rows`."""
    return (
        f"rows near reversals of {_with_shares(joints, rows)} have no part in the fits and the errors, before and after: they scatter at"
        " least twice as much as the others, as of a joint that sticks."
    )


def left_out_with_findings(joints: Sequence[str], rows: Signals) -> str:
    """What is to be said of joints whose rows near reversals only the fit with the findings leaves out."""
    return (
        f"rows near reversals of {_with_shares(joints, rows)} have no part in the fit with the findings, nor in the errors: they tell"
        " something else of these than all other rows do, as where a contact decides what happens."
    )


def _with_shares(joints: Sequence[str], rows: Signals) -> str:
    """Joints with the shares of their rows that are near reversals."""
    before, after = (x.valid.sum(axis=0) for x in (rows, without_turning(rows, joints)))
    at = [rows.robot.joint_index(name) for name in joints]
    return ", ".join(f"{name} ({100.0 * (1.0 - after[j] / before[j]):.2g} %)" for name, j in zip(joints, at, strict=True))


def agreeing(
    stage: Stage, effects: Sequence[Effect], rows: Signals, turning: tuple[str, ...], fitted: Callable[[tuple[str, ...]], Estimate]
) -> Estimate:
    """The estimate of a stage's model, `effects` being what the declared one lacks of it. `rows`: that are fitted; `turning`: joints whose
    rows near reversals are left out, as they are where they contradict the rest and tell nothing that it does not. `fitted`: the
    estimate without those rows of some joints."""
    whole = fitted(turning)
    against = contradicted(whole, stage, effects, rows)
    if set(against) <= set(whole.sticking):
        return whole
    less = fitted(tuple(dict.fromkeys((*turning, *against))))
    names = {p.name for effect in effects for p in effect.parameters(stage.problem.model.robot)} & set(whole.names) & set(less.names)
    known = all(less.std[less.index(name)] < _VAGUER * whole.std[whole.index(name)] for name in names)
    return less if known else whole


def contradicted(estimate: Estimate, stage: Stage, effects: Sequence[Effect], rows: Signals) -> tuple[str, ...]:
    """Joints on whose rows an effect sits of which an estimate from all rows finds something else than the stage does, and that have rows
    enough without those near reversals."""
    problem, frame = stage.problem, stage.frame
    base, robot = list(problem.base.names), problem.model.robot
    found = dict(zip(problem.model.names, estimate.all_values, strict=True))
    at = np.zeros(robot.n, bool)
    for effect in effects:
        names = [p.name for p in effect.parameters(robot) if p.name in base]
        T = frame.transform[[base.index(name) for name in names]]
        values, std = T @ frame.coefficients, np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", T, frame.inverse_gram, T), 0.0))
        off = np.abs(np.array([found[name] for name in names]) - values)
        if np.any((off > _SURELY * std) & (off > _SHARE * np.abs(values))):
            at |= touched(stage.search.whitened(effect))
    at &= _kept(rows, without_turning(rows, robot.joint_names))
    return tuple(np.array(robot.joint_names)[at].tolist())


def _kept(rows: Signals, less: Signals) -> Array:
    """Joints (n,) bool that keep enough of their rows in `less`."""
    return np.asarray(less.valid.sum(axis=0) >= _KEPT * rows.valid.sum(axis=0))

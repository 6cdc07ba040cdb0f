"""Fits whose columns depend on the model's own prediction (its load, its gravity): repeated with that of the last fit until they stand.

Repetition takes the columns for given. Where a large correction acts on parameters that hardly anything else shows (a tilted base under an
arm whose joints stand upright), it creeps or swings without end; then Gauss-Newton steps, which also heed how the columns move with the
values, end it in a few. (`diagnosis.total` does the same on whitened frames, with columns that it keeps.)"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from .._utils.fixed_point import MOST, Repetition
from ..effects.kinds import Need
from ..model import Model
from ..problem.problem import Problem
from ..signals.rows import Rows

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

Array = np.ndarray
Solve = Callable[[Problem], "Estimate"]
#: Values that move by less than this share of their standard deviation from one repetition to the next stand, for all that matters.
_STANDS = 0.2
#: Gauss-Newton steps, halvings of one that gains nothing, and the share of a standard deviation at which they end.
_STEPS = 20
_HALVINGS = 8
_SETTLED = 1e-2
#: A method that weighs the noise's colour ends where plain squares are this much larger than at their least.
_NO_WORSE = 1.05
#: Samples whose columns are made at a time.
_SAMPLES = 16384
#: How columns bend is looked at so often, and again where a step is not this much shorter than the last.
_MOST_LOOKS = 4
_SHRINKS = 0.5
#: Every sample's torque is predicted once for each parameter, and held in memory: no more numbers than this.
_MOST_NUMBERS = 10_000_000


def standing(problem: Problem, first: Estimate, solve: Solve, by_rows: Solve | None) -> Estimate:
    """The fit that is consistent with its own prediction. `first`: of the `problem` as it is; `solve`: fits one of known reference;
    `by_rows`: the same, if it goes by rows alone and so may be given others (None where it makes instruments or columns of its own)."""
    repetition: Repetition | None = None
    tried: list[tuple[Problem, Estimate]] = []
    estimate = first
    for _ in range(MOST):
        values = estimate.all_values
        if problem.reference is not None:
            repetition = repetition or Repetition(_weights(estimate))
            values = repetition.next(problem.reference, values)
        problem = problem.with_reference(values)
        estimate = replace(solve(problem), reference=values)
        tried.append((problem, estimate))
        change = np.abs(estimate.values - estimate.base.base_values(values))
        if np.all(change <= 1e-6 * estimate.std + 1e-9 * np.abs(estimate.values)):
            return estimate
    weight = _inverse(estimate.fit_error.rms)
    problem, estimate = min(tried, key=lambda one: _own_error(one[0], weight))
    off = _off(problem, estimate)
    if not (off > _STANDS).any():
        return estimate
    found = None if by_rows is None else _by_newton(problem, estimate, by_rows)
    if found is not None:
        return found
    worst = int(np.argmax(off))
    said = (
        f"after {len(tried)} repetitions the fit is not consistent with its own prediction: {estimate.names[worst]} still moves by"
        f" {off[worst]:.2g} of its standard deviations, so its interval is too narrow by as much."
    )
    return replace(estimate, warnings=(*estimate.warnings, said))


@dataclass(frozen=True, eq=False)
class Linearised(Problem):
    """A problem whose prediction depends on the values in every way, linearised about some (b,): `slopes` (M, n, b) over all base
    parameters, `left` (M, n) the torque that they are to account for."""

    slopes: Array = field(default_factory=lambda: np.zeros((0, 0, 0)), repr=False)
    left: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)

    @classmethod
    def of(cls, problem: Problem, values: Array, bending: Array) -> Linearised:
        """About values (b,); `bending` (M, n, b): see `_bending`, there or not far away."""
        here = _at(problem, values)
        slopes = bending.copy()
        predicted = np.empty(here.tau.shape)
        for rows in here.rows():
            predicted[rows.place] = rows.columns @ values
            slopes[rows.place] += rows.columns
        return cls(here.model, here.signals, here.reference, here.progress, slopes, here.tau - predicted + slopes @ values)

    @property
    def tau(self) -> Array:
        """Left side of the rows, (M, n)."""
        return self.left

    def rows(self) -> Iterator[Rows]:
        for run, at in enumerate(self.row_runs):
            yield Rows(self.slopes[at], self.left[at], self.valid[at], at, run)


def _by_newton(problem: Problem, estimate: Estimate, solve: Solve) -> Estimate | None:
    """The fit by Gauss-Newton steps from one that does not stand; None where they do not settle, or would take too long.

    How columns bend takes as long as all the rest for each parameter; so it is taken anew only where steps do not shrink with it."""
    base = problem.base
    assert problem.reference is not None
    if type(problem) is not Problem or problem.signals.q.size * base.count > _MOST_NUMBERS:
        return None
    values = base.base_values(problem.reference)
    bending, looked, before = None, 0, np.inf
    for _ in range(_STEPS):
        if bending is None:
            if looked == _MOST_LOOKS:
                return None
            bending, looked, before = _bending(problem, values, _differences(problem, estimate, values)), looked + 1, np.inf
        estimate = solve(Linearised.of(problem, values, bending))
        reference = estimate.all_values
        off = float(np.max(_off(_at(problem, values), estimate)))
        if off <= _SETTLED:
            error = problem.with_reference(reference).torque_error(base.base_values(reference))
            return replace(estimate, reference=reference, fit_error=error)
        if off > _SHRINKS * before:
            bending = None
        before = off
        # By the weights of this step: an estimator may weigh by what the last fit left.
        weight, move = _inverse(estimate.fit_error.rms), base.base_values(reference) - values
        error_here = _own_error(_at(problem, values), weight)
        ways = (values + 0.5**halving * move for halving in range(_HALVINGS))
        better = next((tried for tried in ways if _own_error(_at(problem, tried), weight) < _NO_WORSE * error_here), None)
        if better is None:
            return None
        values = better
    return None


def _differences(problem: Problem, estimate: Estimate, values: Array) -> Array:
    """Steps (b,) of difference quotients at values (b,): standard deviations, where they are known."""
    known = dict(zip(estimate.names, estimate.std.tolist(), strict=True))
    return np.array([known.get(n, 0.0) or 1e-6 * (1.0 + abs(v)) for n, v in zip(problem.base.names, values.tolist(), strict=True)])


def _bending(problem: Problem, values: Array, steps: Array) -> Array:
    """What each base parameter changes of the prediction (M, n, b) through the columns that depend on it, at values (b,); by difference
    quotients of `steps` (b,)."""
    here = _dependent(_at(problem, values), values)
    out = np.empty((*here.shape, len(values)))
    for i, step in enumerate(steps):
        moved = values.copy()
        moved[i] += step
        out[:, :, i] = (_dependent(_at(problem, moved), values) - here) / step
    return out


def _at(problem: Problem, values: Array) -> Problem:
    return problem.with_reference(problem.base.expand(values))


def _dependent(problem: Problem, values: Array) -> Array:
    """Torque (M, n) of the effects that are made of the model's own prediction, their columns at the problem's reference, for base values
    (b,)."""
    model, full = problem.model, problem.base.expand(values)
    chosen = [(e, part) for e, part in zip(model.effects, model.slices, strict=True) if e.needs & {Need.LOAD, Need.REFERENCE}]
    own, sizes = Model(model.robot, tuple(e for e, _ in chosen)), np.concatenate([full[part] for _, part in chosen])
    out = np.empty(problem.tau.shape)
    for block in problem.signals.blocks(None if Need.HISTORY in model.needs else _SAMPLES):
        out[block.rows] = block.reduce(own.columns(problem.motion(block.samples)) @ sizes)
    return out


def _own_error(problem: Problem, weight: Array) -> float:
    """Squared error, each joint's times its weight, of the values that the columns were made with."""
    assert problem.reference is not None
    return float(np.nansum((weight * problem.residual(problem.base.base_values(problem.reference))) ** 2))


def _off(problem: Problem, estimate: Estimate) -> Array:
    """By how many standard deviations (b,) a fit's values are off those that its columns were made with."""
    assert problem.reference is not None
    return np.asarray(np.abs(estimate.values - estimate.base.base_values(problem.reference)) / np.maximum(estimate.std, 1e-300))


def _inverse(x: Array) -> Array:
    return np.where(x > 0.0, 1.0 / np.where(x > 0.0, x, 1.0), 0.0)


def _weights(estimate: Estimate) -> Array:
    """1 over the standard deviation of each of the model's parameters (k,); 0 for what is not estimated."""
    std = dict(zip(estimate.names, estimate.std.tolist(), strict=True))
    return np.array([1.0 / std[name] if std.get(name, 0.0) > 0.0 else 0.0 for name in estimate.model.names])

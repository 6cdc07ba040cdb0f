"""What a log has misread: a joint's zero that is off, a joint's torque in another unit, a clock that runs wrong; told by the fit's own
residual.

A mistake of one number θ moves the residual along its derivative by θ. What base parameters cannot follow of that column must not be in the
residual: a score test finds the mistake, Gauss-Newton steps take it out, and it is named only where the fit is then of another kind. So no
cause is named that does not account for what is wrong, and of several that might, those that account for most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..effects.kinds import Need
from ..effects.reference import Reference
from ..effects.registry import make_effect
from ..model import Model
from ..problem.information import Information
from ..problem.linear_solution import full_values, order_of
from ..problem.problem import Problem
from ..problem.reweighting import reweighted
from .log_mistakes import Misreading, misreadings

if TYPE_CHECKING:
    from ..effects.motion import Coordinates, Motion
    from ..estimate.estimate import Estimate
    from ..signals.signals import Block, Signals

Array = np.ndarray
#: Samples that are looked at, of long logs in so many blocks; scatter is told by so many pieces of time, of so many rows at least.
_SAMPLES, _BLOCKS, _PIECES, _FEW = 6_000, 8, 24, 2
#: Standard deviations, by the scatter between pieces of time; share of the residual's squares; share of the column that base
#: parameters cannot follow: a mistake is looked at from these on.
_SURELY, _PART, _SEEN = 5.0, 0.05, 1e-3
#: Taken out, it must lower the product of all joints' relative errors so many times, and raise that of none by more: what is no cause
#: makes one joint fit at the cost of another.
_FALL, _RISE = 1.3, 1.25
#: What drives usually do stands beside the declared model: what that explains is no mistake of the log.
_USUAL = ("rotor_inertia", "viscous", "coulomb", "offset")
#: Others that do nearly as well (share of the logarithm of that fall) are named too; no more than so many are tried.
_NEARLY, _TRIED = 0.8, 4
#: Gauss-Newton steps, the change at which they end, how many may gain nothing, passes of weighting, and the step of differences.
_STEPS, _SETTLED, _VAIN, _PASSES, _STEP = 8, 3e-3, 3, 5, 1e-5


@dataclass(frozen=True)
class _Found:
    """A mistake of a size, the logarithm of the `fall` of all joints' errors without it, and these (n,) with and without it."""

    misreading: Misreading
    value: float
    fall: float
    before: Array
    after: Array

    @property
    def told(self) -> str:
        return self.misreading.told(self.value)


def misreading(estimate: Estimate) -> str:
    """A sentence on what makes the fit as bad as it is: the zero or the torque's unit of a joint, or the clock; "" where none does.

    What base parameters follow whole (the zero of the last joint) is not seen here (`against_nominal`)."""
    rows = _Sampled.of(estimate)
    if rows is None:
        return ""
    robot = rows.problem.model.robot
    found = [one for suspect in rows.suspected(misreadings(robot, rows.problem.signals.rate)) if (one := rows.without(suspect)) is not None]
    if not found:
        return ""
    best = max(found, key=lambda one: one.fall)
    others = [one.told for one in found if one is not best and one.fall > _NEARLY * best.fall]
    worst = int(np.nanargmax(best.before / best.after))
    more = f"; or {'; or '.join(others)} (these data cannot distinguish them)" if others else ""
    return (
        f"{best.told}{more}. With that corrected, the torque error of {robot.joint_names[worst]} falls from"
        f" {100 * best.before[worst]:.2g} to"
        f" {100 * best.after[worst]:.2g} % of its torque; the parameters of this fit are biased by it. {best.misreading.remedy}"
    )


@dataclass(frozen=True, eq=False)
class _Sampled:
    """Some rows of a plain problem, with the values (k,) of all parameters that its estimate found."""

    problem: Problem
    values: Array
    weights: Array
    blocks: tuple[Block, ...]

    @classmethod
    def of(cls, estimate: Estimate) -> _Sampled | None:
        problem = estimate.problem
        if problem is None or type(problem) is not Problem or Need.HISTORY in problem.model.needs:
            return None
        declared, signals = problem.model, problem.signals
        known = {effect.name for effect in declared.effects}
        model = Model(declared.robot, (*declared.effects, *(make_effect(name) for name in _USUAL if name not in known)))
        values = np.concatenate([estimate.all_values, np.zeros(len(model.parameters) - len(declared.parameters))])
        problem = Problem(model, signals, reference=None if problem.reference is None else values)
        blocks = list(signals.blocks(None if len(signals.q) <= _SAMPLES else _block_size(signals)))
        enough = _FEW * _PIECES
        for count in (_BLOCKS, 4 * _BLOCKS, len(blocks)):
            chosen = tuple(blocks[i] for i in np.unique(np.linspace(0, len(blocks) - 1, count).astype(int)))
            if sum(b.rows.stop - b.rows.start for b in chosen) >= enough:
                return cls(problem, values, estimate.weights, chosen)
        return None

    def suspected(self, suspects: list[Misreading]) -> list[Misreading]:
        """Those that a score test finds in the residual, the likeliest first."""
        parts = [self._rows(block, self.values, suspects) for block in self.blocks]
        scale, n = np.sqrt(self.weights), len(self.weights)
        columns, slopes = (np.concatenate([(p[i] * scale[:, None]).reshape(-1, p[i].shape[2]) for p in parts]) for i in (0, 1))
        tau = np.concatenate([(p[2] * scale).reshape(-1) for p in parts])
        length = np.linalg.norm(columns, axis=0)
        Q = np.linalg.qr(columns / np.where(length > 0, length, 1.0))[0]
        alone, left = slopes - Q @ (Q.T @ slopes), tau - Q @ (Q.T @ tau)
        piece = np.repeat(_PIECES * np.arange(len(tau) // n) // (len(tau) // n), n)
        found = []
        for k, suspect in enumerate(suspects):
            own = alone[:, k]
            squares = float(own @ own)
            if squares <= (_SEEN * float(np.linalg.norm(slopes[:, k]))) ** 2:
                continue
            value = float(own @ left) / squares
            rest = left - value * own
            scatter = float(np.linalg.norm(np.bincount(piece, own * rest))) / squares
            share = 1.0 - float(rest @ rest) / max(float(left @ left), 1e-300)
            if abs(value) > _SURELY * scatter and share > _PART:
                found.append((share, suspect))
        return [suspect for _, suspect in sorted(found, key=lambda one: -one[0])[:_TRIED]]

    def without(self, suspect: Misreading) -> _Found | None:
        """How the fit is without a mistake, whose size is fitted too; None where it is of the same kind."""
        order, names = order_of(self.problem.base), (*self.problem.base.names, "mistake")
        mistake = len(names) - 1
        value, values = 0.0, self.values
        before: Array | None = None
        best: _Found | None = None
        for number in range(_STEPS):
            whole = Information.empty(len(self.weights), names)
            for block in self.blocks:
                columns, slopes, tau = self._rows(block, values, [suspect], value)
                whole = whole.with_rows(np.concatenate([columns, slopes], axis=2), tau, self.problem.valid[block.rows])
            own = whole.selected(np.arange(mistake))
            fit = full_values(self.problem, reweighted(own, order, iterations=_PASSES)[0])
            torque = own.torque_squares()
            errors = np.sqrt(np.maximum(np.where(torque > 0, own.residual_squares(fit) / np.where(torque > 0, torque, 1.0), 1.0), 1e-24))
            before = errors if before is None else before
            fall = float(np.sum(np.log(before / errors)))
            if best is None or fall > best.fall:
                best = _Found(suspect, value, fall, before, errors)
            solution, _ = reweighted(whole, [*order, mistake], iterations=_PASSES)
            step = float(np.clip(solution.values[solution.columns == mistake].sum(), -suspect.reach, suspect.reach))
            if abs(step) < _SETTLED or (number == _VAIN and best.fall < np.log(_FALL)):
                break
            values = self.problem.base.expand(fit)
            value += step
        assert best is not None
        found = best.fall > np.log(_FALL) and bool(np.all(best.after < _RISE * best.before)) and suspect.noteworthy(best.value)
        return best if found else None

    def _rows(self, block: Block, values: Array, suspects: list[Misreading], value: float = 0.0) -> tuple[Array, Array, Array]:
        """Columns (m, n, b) of a block without a mistake of size `value` (of the first suspect), for parameters' values (k,) the slopes
        (m, n, s) of the residual along further mistakes, and the torque (m, n); rows that are not used are zero."""
        problem, (first, *_) = self.problem, suspects
        recorded, valid = problem.motion(block.samples), problem.valid[block.rows]
        tau = np.where(valid, problem.tau[block.rows], 0.0)
        slopes = np.stack([self._slope(block, recorded, tau, suspect, values, value) for suspect in suspects], axis=2)
        motion = self._moved(recorded, first.motion(recorded.joint, value), values)
        columns = block.reduce(problem.model.columns(motion)[:, :, problem.base.independent])
        used = valid[:, :, None]
        return np.where(used, columns, 0.0), np.where(used, slopes, 0.0), first.torque(tau, value)

    def _slope(self, block: Block, motion: Motion, tau: Array, suspect: Misreading, values: Array, value: float) -> Array:
        """Change (m, n) of prediction minus torque where a little more of a mistake is taken out."""
        ends = (value + _STEP, value - _STEP)
        torque = [suspect.torque(tau, end) for end in ends]
        joints = [suspect.motion(motion.joint, end) for end in ends]
        change = torque[1] - torque[0]
        if joints[0] is not motion.joint:
            predicted = [self.problem.model.torque(self._moved(motion, joint, values), values) for joint in joints]
            change = change + block.reduce(predicted[0] - predicted[1])
        return change / (2.0 * _STEP)

    def _moved(self, motion: Motion, joint: Coordinates, values: Array) -> Motion:
        """The same samples at other coordinates."""
        if joint is motion.joint:
            return motion
        model = self.problem.model
        moved = motion.moved(model.robot, joint)
        return moved.with_reference(Reference(model, values)) if model.needs & {Need.LOAD, Need.REFERENCE} else moved


def _block_size(signals: Signals) -> int:
    """Samples of one of the blocks that are looked at, with the margins of its rows."""
    factor, margin = (1, 1) if signals.row_filter is None else (signals.row_filter.factor, len(signals.row_filter.taps))
    return factor * (max(_FEW * _PIECES // _BLOCKS, _SAMPLES // (_BLOCKS * factor)) - 1) + margin

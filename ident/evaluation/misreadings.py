"""What a log has misread: a joint's zero that is off, a joint's torque in another unit, a clock that runs wrong, columns in the opposite
direction or of another joint; told by the fit's own residual.

A mistake of one number θ moves the residual along its derivative by θ. What base parameters cannot follow of that column must not be in the
residual: a score test finds the mistake, Gauss-Newton steps take it out, and it is named only where the fit is then of another kind. So no
cause is named that does not account for what is wrong, and of several that might, those that account for most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..effects.kinds import Need
from ..effects.motion import Motion
from ..effects.reference import Reference
from ..effects.registry import make_effect
from ..model import Model
from ..problem.information import Information
from ..problem.linear_solution import full_values, order_of
from ..problem.problem import Problem
from ..problem.reweighting import reweighted
from ..robots.transmission import Side
from .interchanged import Interchange, as_read, interchanges
from .log_mistakes import Misreading, misreadings
from .mounting import mounting

if TYPE_CHECKING:
    from ..effects.motion import Coordinates
    from ..estimate.estimate import Estimate
    from ..signals.signals import Block, Signals

Array = np.ndarray
#: Samples that are looked at, of long logs in so many blocks; scatter is told by so many pieces of time, of so many rows at least.
_SAMPLES, _BLOCKS, _PIECES, _FEW = 6_000, 8, 24, 2
#: Standard deviations, by the scatter between pieces of time; share of the residual's squares; share of the column that base
#: parameters cannot follow: a mistake is looked at from these on.
_SURELY, _PART, _SEEN = 5.0, 0.05, 1e-3
#: Taken out, it must lower the product of all joints' relative errors so many times, and that of one of them, and raise that of none by
#: more: what is no cause makes one joint fit at the cost of another.
FALL, _RISE = 1.3, 1.25
#: What drives usually do stands beside the declared model: what that explains is no mistake of the log.
_USUAL = ("rotor_inertia", "viscous", "coulomb", "offset")
#: Others whose errors are no further from the best one's are named too; no more than so many are tried.
_TRIED = 4
#: Gauss-Newton steps, the change at which they end, how many may gain nothing, passes of weighting, and the step of differences.
_STEPS, _SETTLED, _VAIN, PASSES, _STEP = 8, 3e-3, 3, 5, 1e-5


#: Columns of other joints, or in the opposite direction, are looked for where a joint's relative error lies above this. Corrected, they
#: must lower the product of all errors so many times, and the worst of them to half: no right column does that.
_POOR, _FAR, _HALF = 0.05, 4.0, 0.5


@dataclass(frozen=True)
class _Found:
    """A mistake (`told`), the logarithm of the `fall` of all joints' errors without it, and these (n,) with and without it."""

    told: str
    remedy: str
    fall: float
    before: Array
    after: Array

    @property
    def of_another_kind(self) -> bool:
        """Whether the fit is of another kind without it: all errors together, one joint's by itself, and none at the cost of another's.

        A number that all joints share, such as a delay, takes a little away everywhere, whatever is wrong."""
        one = float(np.nanmax(self.before / self.after))
        return self.fall > np.log(FALL) and one > FALL and bool(np.all(self.after < _RISE * self.before))


def misreading(estimate: Estimate) -> str:
    """A sentence on what makes the fit as bad as it is: the zero or the torque's unit of a joint, the clock, columns that were reversed or
    exchanged, or gravity in another direction; "" where none does.

    What base parameters follow whole (the zero of the last joint) is not seen here (`against_nominal`)."""
    rows = _Sampled.of(estimate)
    if rows is None:
        return ""
    robot = rows.problem.model.robot
    found = [one for suspect in rows.suspected(misreadings(robot, rows.problem.signals.rate)) if (one := rows.without(suspect)) is not None]
    return _sentence([*found, *rows.interchanged()], robot.joint_names)


def misassigned(estimate: Estimate) -> str:
    """A sentence on columns in the opposite direction or of another joint, and on gravity in another direction, where one of these is all
    that is wrong with a poor fit; "" otherwise. What a diagnosis finds in such a log is not the robot's."""
    rows = _Sampled.of(estimate)
    return "" if rows is None else _sentence(rows.interchanged(), estimate.model.robot.joint_names)


def beside_the_usual(estimate: Estimate) -> Problem | None:
    """The plain problem of an estimate, with what drives usually do beside its model; None where it has none."""
    problem = estimate.problem
    if problem is None or type(problem) is not Problem or Need.HISTORY in problem.model.needs:
        return None
    declared = problem.model
    known = {effect.name for effect in declared.effects}
    model = Model(declared.robot, (*declared.effects, *(make_effect(name) for name in _USUAL if name not in known)))
    values = np.concatenate([estimate.all_values, np.zeros(len(model.parameters) - len(declared.parameters))])
    return Problem(model, problem.signals, reference=None if problem.reference is None else values)


def _sentence(found: list[_Found], names: Sequence[str]) -> str:
    """What the mistakes that were found are, the one that accounts for most first; "" without any."""
    if not found:
        return ""
    best = max(found, key=lambda one: one.fall)
    others = [one.told for one in found if one is not best and one.fall > best.fall - np.log(FALL)]
    worst = int(np.nanargmax(best.before / best.after))
    more = f"; or {'; or '.join(others)} (these data cannot distinguish them)" if others else ""
    return (
        f"{best.told}{more}. With that corrected, the torque error of {names[worst]} falls from"
        f" {100 * best.before[worst]:.2g} to"
        f" {100 * best.after[worst]:.2g} % of its torque; the parameters of this fit are biased by it. {best.remedy}"
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
        problem = beside_the_usual(estimate)
        if problem is None:
            return None
        signals = problem.signals
        values = np.concatenate([estimate.all_values, np.zeros(len(problem.model.parameters) - len(estimate.model.parameters))])
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
        best: tuple[_Found, float] | None = None
        for number in range(_STEPS):
            whole = Information.empty(len(self.weights), names)
            for block in self.blocks:
                columns, slopes, tau = self._rows(block, values, [suspect], value)
                whole = whole.with_rows(np.concatenate([columns, slopes], axis=2), tau, self.problem.valid[block.rows])
            fit, errors = self._fitted(whole.selected(np.arange(mistake)))
            before = errors if before is None else before
            fall = float(np.sum(np.log(before / errors)))
            if best is None or fall > best[0].fall:
                best = _Found(suspect.told(value), suspect.remedy, fall, before, errors), value
            solution, _ = reweighted(whole, [*order, mistake], iterations=PASSES)
            step = float(np.clip(solution.values[solution.columns == mistake].sum(), -suspect.reach, suspect.reach))
            if abs(step) < _SETTLED or (number == _VAIN and best[0].fall < np.log(FALL)):
                break
            values = self.problem.base.expand(fit)
            value += step
        assert best is not None
        found, value = best
        return found if found.of_another_kind and suspect.noteworthy(value) else None

    def interchanged(self) -> list[_Found]:
        """Columns of another joint or in the opposite direction, and gravity in another one, without which the fit is of another kind."""
        names = self.problem.model.robot.joint_names
        used = np.array([self.problem.valid[block.rows].sum(axis=0) for block in self.blocks]).sum(axis=0) > 0
        before = self._errors_with([as_read(len(names))])[0]
        if len(names) < 2 or not np.any(before[used] > _POOR):
            return []
        tried = [(one.told, one.remedy, after) for group in interchanges(names, before) for one, after in self._paired(group)]
        if (turned := mounting(self.problem, self.blocks)) is not None and self._no_springs(turned.errors, used):
            tried.append((turned.told, turned.remedy, turned.errors))
        falls = [float(np.sum(np.log(before[used] / after[used]))) for _, _, after in tried]
        return [
            _Found(told, remedy, fall, before, after)
            for (told, remedy, after), fall in zip(tried, falls, strict=True)
            if fall > np.log(_FAR) and after[used].max() < _HALF * before[used].max()
        ]

    def _no_springs(self, turned: Array, used: Array) -> bool:
        """Whether gravity in another direction, with these errors (n,), accounts for more than a torque of each joint that goes with the
        sine of its own position.

        The least tilt of an axis along gravity frees first moments about it, and such a torque is all that they make."""
        problem = self.problem
        turning = [joint.name for joint in problem.model.robot.joints if not joint.prismatic]
        if not turning:
            return True
        springs = problem.model + make_effect("cogging", joints=turning, angle=Side.JOINT, order=1.0, label="spring")
        own = replace(self, problem=Problem(springs, problem.signals))._errors_with([as_read(len(used))])[0]
        return float(np.sum(np.log(own[used] / turned[used]))) > np.log(FALL)

    def _paired(self, group: list[Interchange]) -> list[tuple[Interchange, Array]]:
        return list(zip(group, self._errors_with(group), strict=True))

    def _errors_with(self, group: list[Interchange]) -> list[Array]:
        """Relative error (n,) of each joint for interchanges of the same motion."""
        problem, first = self.problem, group[0]
        robot = problem.model.robot
        parts = [Information.empty(robot.n, problem.base.names) for _ in group]
        for block in self.blocks:
            recorded, valid, tau = problem.motion(block.samples), problem.valid[block.rows], problem.tau[block.rows]
            q, dq, ddq = (first.motion(x) for x in (recorded.joint.q, recorded.joint.dq, recorded.joint.ddq))
            motion = Motion.of(
                robot, q, dq, ddq, recorded.t,
                rate=recorded.rate, torque=recorded.torque, start=recorded.start, cutoff_hz=recorded.cutoff_hz,
            )  # fmt: skip
            if problem.model.needs & {Need.LOAD, Need.REFERENCE}:
                motion = motion.with_reference(Reference(problem.model, self.values))
            columns = block.reduce(problem.model.columns(motion)[:, :, problem.base.independent])
            for k, one in enumerate(group):
                used = valid & valid[:, one.torque_of]
                torque = np.where(used, one.torque(np.where(valid, tau, 0.0)), 0.0)
                parts[k] = parts[k].with_rows(np.where(used[:, :, None], columns, 0.0), torque, used)
        return [self._fitted(part)[1] for part in parts]

    def _fitted(self, information: Information) -> tuple[Array, Array]:
        """Base values (b,) that fit rows best, and the relative error (n,) of each joint then."""
        fit = full_values(self.problem, reweighted(information, order_of(self.problem.base), iterations=PASSES)[0])
        return fit, information.relative_errors(fit)

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

"""Which candidates are worth a fit: by what one step of each, at the fitted values, takes off the residual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..._utils.singular_values import lstsq, svd
from ...drives.folds import turns
from ...drives.limits import SEEN
from ...drives.plant import DrivePlant, joined
from ...drives.residual import FORETOLD, structure
from ...drives.search import Fitted, derivatives
from ...drives.uncertainty import memory
from .candidates import DriveCandidate, candidates, values_in

Array = np.ndarray
#: Standard deviations from which on a candidate is worth a fit, or the share of the squared error of readings held out that it takes off:
#: where a constant is far off, what one step leaves is no noise, and its size in standard deviations says little. What takes less off than
#: the last is none.
SIGNIFICANT, _GAIN, LEAST = SEEN, 0.02, 0.01
_DOUBTED = ("kp", "kd", "delay_s", "load", "gear_loss", "effort_limit", "deadband")
#: Share of a direction that the fitted unknowns must leave over, for it to be one of its own.
_OWN = 1e-4


@dataclass(frozen=True, eq=False)
class Screened:
    """A candidate on the `joints` on which it counts, with the step (j,) to its value, and what it takes off the squared residual of
    readings for which it was not adjusted (share)."""

    candidate: DriveCandidate
    joints: tuple[int, ...]
    step: Array
    gain: float


@dataclass(frozen=True, eq=False)
class _Base:
    """Weighted residual (M,) and orthonormal directions (M, p) of the fitted unknowns, each turn's as well; M = N n."""

    residual: Array
    directions: Array
    turn: Array
    lags: int
    n: int

    def without(self, columns: Array) -> tuple[Array, Array]:
        """Columns (M, k) without what the fitted unknowns take up, and the share that is left."""
        left = columns - self.directions @ (self.directions.T @ columns)
        size = np.sum(columns**2, axis=0)
        return left, np.sum(left**2, axis=0) / np.maximum(size, 1e-300)

    def significance(self, column: Array) -> tuple[float, float]:
        """Step along a column (M,) that fits best, and its size in standard deviations; the residual's memory is counted."""
        size = float(column @ column)
        step = -float(column @ self.residual) / size
        left = self.residual + step * column
        score = np.sum((column * left).reshape(-1, self.n), axis=1)
        spread = float(score @ score)
        for lag in range(1, self.lags + 1):
            spread += 2.0 * (1.0 - lag / (self.lags + 1)) * float(score[lag:] @ score[:-lag])
        white = float(left @ left) / max(int(np.count_nonzero(left)), 1) * size
        return step, step * size / max(spread, white) ** 0.5

    def gain(self, J: Array, columns: Array) -> float:
        """Share of the squared residual that the columns (M, k) take off readings that had no part in their adjustment."""
        before = after = 0.0
        for number in np.unique(self.turn):
            held = self.turn == number
            for whole in (False, True):
                X = np.concatenate([J, columns], axis=1) if whole else J
                change = lstsq(X[~held], -self.residual[~held], rcond=1e-9)
                error = float(np.sum((self.residual[held] + X[held] @ change) ** 2))
                before, after = (before, after + error) if whole else (before + error, after)
        return 1.0 - after / max(before, 1e-300)


def screened(plant: DrivePlant, fit: Fitted, inertia: Array) -> list[Screened]:
    """Candidates that count, those first that take most off.

    Where the residual is no noise, declared gains and delay, and friction that follows the load, count in any case: one step from a gain
    that is far off, or to friction that is large, may lead nowhere."""
    doubted = _DOUBTED if structure(fit) > FORETOLD else ()
    n = plant.robot.n
    weights = fit.weights.reshape(-1)
    J = (fit.slopes * fit.weights[..., None]).reshape(-1, fit.slopes.shape[2])
    J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    directions, sizes, _ = svd(J, full_matrices=False)
    weighted = fit.residual * fit.weights
    base = _Base(
        weighted.reshape(-1), directions[:, sizes > 1e-7 * sizes[0]], np.repeat(turns(plant), n), memory(weighted), n
    )  # fmt: skip
    found = []
    offered = list(candidates(plant))
    far = [one for one in offered if one.far]
    distant = _distant(plant, fit.values, far, inertia)
    for candidate in offered:
        if candidate.far:
            steps, columns = distant[far.index(candidate)]
        else:
            steps, columns = _columns(plant, fit.values, candidate, inertia)
        columns, own = base.without(columns * weights[:, None])
        kept, moves = [], []
        for k in np.flatnonzero(own > _OWN):
            step, size = base.significance(columns[:, k])
            size = abs(size) if candidate.either_way else size
            doubt = candidate.place in doubted
            if doubt or size > SIGNIFICANT or (size > 0.0 and base.gain(J, columns[:, [k]]) > _GAIN):
                kept.append(int(k))
                moves.append(step)
        if candidate.place == "joint_stiffness" and len(kept) > 1:
            # Joints that move each other each seem to hang on a spring where one does: the best first.
            best = int(np.argmax([base.gain(J, columns[:, [k]]) for k in kept]))
            kept, moves = [kept[best]], [moves[best]]
        if kept and ((gain := base.gain(J, columns[:, kept])) > LEAST or candidate.place in doubted):
            found.append(Screened(candidate, tuple(steps[k] for k in kept), np.array(moves), gain))
    return _best_settings(found)


def _columns(plant: DrivePlant, values: Array, candidate: DriveCandidate, inertia: Array) -> tuple[list[int], Array]:
    """Joints, and what a step of the candidate on each changes (M, k)."""
    wider = candidate.added_to(plant, list(range(plant.robot.n)))
    at, sizes, own = values_in(wider, plant, values, candidate, inertia)
    mine = np.array([i for i in np.flatnonzero(own) if wider.unknowns[i].place == candidate.place])
    return [max(wider.unknowns[i].joint, 0) for i in mine], derivatives(wider, at, sizes, mine).reshape(-1, len(mine))


def _distant(
    plant: DrivePlant, values: Array, far: list[DriveCandidate], inertia: Array
) -> list[tuple[list[int], Array]]:  # fmt: skip
    """Of each candidate that starts from a number of its own: joints, and what it changes on each (M, k)."""
    if not far:
        return []
    (plain,) = joined(plant.positions(values))
    out: list[tuple[list[int], Array]] = [([], plain)] * len(far)
    for place in dict.fromkeys(one.place for one in far):
        at = [i for i, one in enumerate(far) if one.place == place]
        own = [far[i] for i in at]
        joints = [j for j in range(plant.robot.n) if place != "joint_stiffness" or np.isinf(plant.law.constants[place][j])]
        columns = np.empty((len(own), plain.size, len(joints)))
        for k, j in enumerate(joints):
            wider = own[0].added_to(plant, [j])
            sets = np.stack([values_in(wider, plant, values, one, inertia)[0] for one in own])
            columns[..., k] = np.nan_to_num(joined(wider.positions(sets)) - plain).reshape(len(own), -1)
        for i, changed in zip(at, columns, strict=True):
            out[i] = (joints, changed)
    return out


def _best_settings(found: list[Screened]) -> list[Screened]:
    """Of each effect the setting that takes most off."""
    out: list[Screened] = []
    for one in sorted(found, key=lambda s: -s.gain):
        if one.candidate.name not in {s.candidate.name for s in out}:
            out.append(one)
    return out

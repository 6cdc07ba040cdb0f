"""Hidden: what this motion could not have shown, however long the log.

Nothing found means something only of what would have been seen. A spring on a joint that swings a little looks like a moment of the links;
an error of a torque constant like their masses. What the declared parameters take up of such an effect on this motion, and not on any,
is told: how large it can be without being seen, and the motion that would show it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..effects.base import Effect, Need
from ..effects.places import motors_of, place_of_joints
from ..effects.reduction import random_motion
from ..effects.reference import Reference
from .advice import motion_for
from .evidence import FALSE_ALARM
from .stage import Stage

if TYPE_CHECKING:
    from .candidates import Candidate

Array = np.ndarray
#: An effect is told if what it could be without being seen makes up this share of its joint's torque.
_SHARE = 0.3
#: From so many times its joint's torque on, no robot has it, and its size is of no interest.
_ANY = 10.0
#: Places of an effect that are told to people.
_PLACES = 4
#: A column whose standard deviation is this share of its root mean square is the same all the time.
_STEADY = 1e-3
#: Seen in nineteen of twenty such logs.
_MOSTLY = 1.645
#: Shares of a column's power that are the error of its making, on this motion and on states without any.
_ROUNDING = 1e-13
_SAME = 1e-10
_STATES = 60
#: What an effect may ask for and still be known at a state by itself.
_AT_ONCE = frozenset({Need.LOAD, Need.REFERENCE})


@dataclass(frozen=True, eq=False)
class Hidden:
    """An effect's parameter that may be as large as `least` (SI, `unit`) without being seen.

    Then it makes a torque of `torque` (`torque_unit`, standard deviation) on `joint`, `share` of what that joint's torque varies by; both
    are root mean squares where the effect is the same all the time. `advice`: the motion that would show it."""

    effect: str
    joints: tuple[str, ...]
    motors: tuple[str, ...]
    parameter: str
    unit: str
    least: float
    joint: str
    torque: float
    torque_unit: str
    share: float
    advice: str

    @property
    def place(self) -> str:
        """Where it sits, for people."""
        return place_of_joints(self.joints, self.motors)

    def __str__(self) -> str:
        """Place and size."""
        if self.share > _ANY:
            size = "of any size"
        else:
            size = (
                f"up to {self.least:.2g}{f' {self.unit}' if self.unit != '1' else ''}: {self.torque:.2g} {self.torque_unit} on {self.joint}"
            )
        return f"{self.place or 'whole robot'} ({size})"

    def to_dict(self) -> dict[str, Any]:
        motors = {"motors": list(self.motors)} if self.motors else {}
        return {
            "effect": self.effect, "joints": list(self.joints), **motors, "parameter": self.parameter, "unit": self.unit,
            "least": self.least, "joint": self.joint, "torque": self.torque, "torque_unit": self.torque_unit, "share": self.share,
            "advice": self.advice,
        }  # fmt: skip


def hidden(stage: Stage) -> tuple[Hidden, ...]:
    """What could be there beside a stage's model without being seen, the largest first: of each effect without a shape at each place the
    parameter that hides best."""
    from scipy.stats import chi2

    robot, frame = stage.problem.model.robot, stage.frame
    signals, measured = stage.problem.signals, robot.transmission.measured
    torque = _sizes(signals.tau[:, :, None], signals.valid)
    X, inverse = frame.columns.reshape(-1, frame.columns.shape[2]), frame.inverse_gram
    seen_from = math.sqrt(float(chi2.isf(FALSE_ALARM / stage.number, 1))) + _MOSTLY
    best: dict[tuple[str, tuple[str, ...], tuple[str, ...]], Hidden] = {}
    structure = _Structure(stage)
    for candidate in stage.search.candidates:
        effect = candidate.variants[0]
        if effect.shape():
            continue
        columns = stage.search.bank.columns(stage.search.seen_by(effect), [effect])[0]
        z = frame.whitened(columns).reshape(-1, columns.shape[2])
        cross = X.T @ z
        own, taken = np.sum(z**2, axis=0), np.einsum("bk,bc,ck->k", cross, inverse, cross)
        sizes = _sizes(columns, signals.valid)
        # What is the same all the time is compared with all of the torque, what varies with what it varies by.
        steady = sizes[0] <= _STEADY * sizes[1]
        size, level = np.where(steady, sizes[1], sizes[0]), np.where(steady, torque[1], torque[0])
        spread = np.divide(size, level, out=np.zeros_like(size), where=level > 0.0)
        for k, parameter in enumerate(effect.parameters(robot)):
            j = int(np.argmax(spread[:, k]))
            if own[k] <= 0.0 or spread[j, k] <= 0.0:
                continue  # its joint stands still, which the log's audit says
            least = seen_from / math.sqrt(max(own[k] - taken[k], _ROUNDING * own[k]))
            share, key = least * float(spread[j, k]), (candidate.name, candidate.joints, motors_of(effect))
            if share < _SHARE or (key in best and best[key].share >= share) or structure.holds(effect, k):
                continue
            name = parameter.name.replace("+", "")
            where, unit = robot.joint_names[j], robot.force_unit(j, measured)
            made, motion = least * float(size[j, k]), motion_for(effect, _joint(candidate, where))
            best[key] = Hidden(*key, name, parameter.unit, least, where, made, unit, share, motion)
    return tuple(sorted(best.values(), key=lambda h: -h.share))


def _joint(candidate: Candidate, where: str) -> str:
    return candidate.joints[0] if candidate.joints else where


def _sizes(columns: Array, valid: Array) -> tuple[Array, Array]:
    """Standard deviation and root mean square, (n, k) each, of columns (M, n, k) over the rows in use (M, n)."""
    use = valid[:, :, None]
    count = np.maximum(use.sum(axis=0), 1)
    mean, square = (np.sum(np.where(use, x, 0.0), axis=0) / count for x in (columns, columns**2))
    return np.sqrt(np.sum(np.where(use, columns - mean, 0.0) ** 2, axis=0) / count), np.sqrt(square)


class _Structure:
    """What the model's own parameters take up on any motion, so that no log tells it: states without a motion tell."""

    def __init__(self, stage: Stage) -> None:
        whole = stage.problem.model
        values, at_once = whole.base.expand(stage.frame.base_values), [not e.needs - _AT_ONCE for e in whole.effects]
        # What remembers the motion has nothing to say of states without any.
        model = replace(whole, effects=tuple(e for e, kept in zip(whole.effects, at_once, strict=True) if kept))
        own = np.concatenate([values[part] for part, kept in zip(whole.slices, at_once, strict=True) if kept])
        self.robot = model.robot
        motion = random_motion(self.robot, 4 * len(model.parameters) // self.robot.n + _STATES)
        self.motion = motion.with_reference(Reference(model, own))
        self.base = self._orthonormal(model.columns(self.motion))

    @staticmethod
    def _orthonormal(columns: Array) -> Array:
        flat = columns.reshape(-1, columns.shape[2])
        size = np.linalg.norm(flat, axis=0)
        U, s, _ = np.linalg.svd(flat / np.where(size > 0.0, size, 1.0), full_matrices=False)
        return np.asarray(U[:, s > 1e-9 * s[0]])

    def holds(self, effect: Effect, k: int) -> bool:
        """Whether the k-th column of an effect lies within the model's on any motion."""
        if effect.needs - _AT_ONCE:
            return False
        values, measured = effect.columns(self.motion, self.robot), self.robot.transmission.measured
        if effect.side != measured:
            values = np.matmul(self.robot.transmission.torque_map(effect.side, measured), values)
        own = values[:, :, k].reshape(-1)
        left = own - self.base @ (self.base.T @ own)
        return bool(left @ left <= _SAME * max(float(own @ own), 1e-300))


def by_effect(found: Sequence[Hidden]) -> list[tuple[str, str, str]]:
    """For people: each effect, the largest first, the places where it hides and how large, and the motion that would show it."""
    effects = dict.fromkeys(h.effect for h in found)
    own = {name: [h for h in found if h.effect == name] for name in effects}
    return [(name, ", ".join(map(str, each[:_PLACES])) + _others(len(each) - _PLACES), each[0].advice) for name, each in own.items()]


def _others(count: int) -> str:
    return f", {count} more" if count > 0 else ""

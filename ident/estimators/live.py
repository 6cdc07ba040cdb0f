"""A recursion in a live loop: one sample at a time into the compiled factors, the state out when it is asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, Self, TypeVar

import numpy as np

from ..effects.factors import declares
from ..effects.joint_effect import JointEffect
from ..effects.kinds import Factor
from ..effects.rigid_body import RigidBody
from ..errors import ConfigurationError
from ..problem.information import Information
from ..regressor import row_information
from ..regressor.drive_terms import state_not_finite
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..model import Model
    from ..regressor.base_parameters.reduction import BaseReduction

Array = np.ndarray
#: Signals of a side, in the order in which they stand: position, speed and acceleration come as they are measured.
_SIGNALS = (Factor.POSITION, Factor.SPEED, Factor.ACCELERATION, Factor.DIRECTION)


class Recursion(Protocol):
    """Where a recursion stands, as far as a live loop goes on from it; `estimators.recursive.RecursiveState` says what each of these is."""

    @property
    def model(self) -> Model: ...

    @property
    def base(self) -> BaseReduction: ...

    @property
    def information(self) -> Information: ...

    @property
    def effective(self) -> Array: ...

    @property
    def seen(self) -> int: ...

    def observe(self, q: Array, dq: Array, ddq: Array, tau: Array) -> Self: ...

    def at(self, information: Information, effective: Array, seen: int) -> Self: ...


_S = TypeVar("_S", bound=Recursion)


class LiveRecursion(Generic[_S]):
    """A recursion that changes with every sample; `RecursiveState.live` makes it. One thread at a time.

    Models of a rigid body, rotor inertia, viscous and Coulomb friction, offsets and linear springs take a sample in some 20 µs (six
    joints); with other effects a sample costs what `RecursiveState.observe` does.

    Examples
    --------
    >>> import ident
    >>> import numpy as np
    >>> robot = ident.load_robot("scara")
    >>> live = ident.estimators.RecursiveLeastSquares().start(robot.rigid_body()).live()
    >>> for _ in range(3):
    ...     live.add(np.zeros(4), np.ones(4), np.ones(4), np.full(4, 0.5))
    >>> live.state.seen
    3
    """

    def __init__(self, state: _S, forgetting: float) -> None:
        self._state, self._fast = state, _FastRows.of(state, forgetting)

    def add(self, q: Array, dq: Array, ddq: Array, tau: Array) -> None:
        """Take one measured instant, each array (n,): joint-side motion in rad, rad/s, rad/s² (m, …), measured-side torque in N m (N), NaN
        where it is missing. Raises DataError for a motion that is not finite; the recursion then stays what it was."""
        if self._fast is None:
            self._state = self._state.observe(q, dq, ddq, tau)
        else:
            self._fast.add(q, dq, ddq, tau)

    @property
    def state(self) -> _S:
        """Where the recursion stands: values, standard deviations, and all that a state can do."""
        return self._state if self._fast is None else self._state.at(*self._fast.taken(self._state.base))


class _FastRows:
    """Room for one sample, and the factors it goes into."""

    def __init__(self, state: Recursion, layout: _LiveLayout, forgetting: float) -> None:
        robot, n = state.model.robot, state.model.robot.n
        self._n, self._layout, self._robot = n, layout, robot
        self._direct = robot.loop.is_trivial and robot.tree.nq == n
        self._forgetting = forgetting
        start = state.information if layout.plain else state.information.selected(layout.order)
        self._rows = row_information.live_information(robot.tree, start.factors, layout.rows, layout.columns, layout.pattern)
        self._effective, self._counts, self._seen = np.array(state.effective, float), state.information.counts.copy(), state.seen
        self._signals = np.zeros(1 + 8 * n)
        self._signals[0] = 1.0
        both = self._signals[1:].reshape(2, 4, n)
        self._joint, self._motor = both
        self._rates, self._zero = np.ascontiguousarray(robot.transmission.K_inverse.T), robot.transmission.motor_position(np.zeros(n))
        self._moved = np.zeros((3, n))
        self._tau, self._valid, self._extra = np.zeros(n), np.zeros(n, bool), np.zeros(len(layout.index))
        self._ones = np.ones(3 * n)

    @classmethod
    def of(cls, state: Recursion, forgetting: float) -> _FastRows | None:
        """None where an effect does not declare what its columns are, or the rows are not those of the robot."""
        if state.information.n != state.model.robot.n:
            return None
        layout = _LiveLayout.of(state.model, state.base)
        return None if layout is None else cls(state, layout, forgetting)

    def add(self, q: Array, dq: Array, ddq: Array, tau: Array) -> None:
        """Take one instant."""
        joint, moved = self._joint, self._moved
        try:
            moved[0], moved[1], moved[2], self._tau[:] = q, dq, ddq, tau
        except (ValueError, TypeError):
            raise ConfigurationError(f"a live sample is q, dq, ddq and tau of {self._n} joints each.") from None
        if not math.isfinite(self._ones.dot(moved.ravel())):
            raise state_not_finite()
        joint[:3] = moved
        np.sign(joint[1], out=joint[3])
        np.dot(moved, self._rates, out=self._motor[:3])
        self._motor[0] += self._zero
        np.sign(self._motor[1], out=self._motor[3])
        np.take(self._signals, self._layout.index, out=self._extra, mode="clip")
        valid = None
        if not math.isfinite(self._ones[: self._n].dot(self._tau)):
            valid = np.isfinite(self._tau, out=self._valid)
            self._tau[~valid] = 0.0
        if self._forgetting != 1.0:
            self._rows.scale(math.sqrt(self._forgetting))
            self._effective *= self._forgetting
        q, dq, ddq = (joint[0], joint[1], joint[2]) if self._direct else self._on_tree()
        self._rows.add(q, dq, ddq, self._tau, self._extra, valid)
        self._counts += 1 if valid is None else valid
        self._effective += 1.0 if valid is None else valid
        self._seen += 1

    def _on_tree(self) -> tuple[Array, Array, Array]:
        robot, (q, dq, ddq) = self._robot, self._moved[:, None]
        return robot.tree_position(q)[0], robot.tree_rate(dq)[0], robot.tree_rate(ddq)[0]

    def taken(self, base: BaseReduction) -> tuple[Information, Array, int]:
        """Information on the base parameters, samples that it is worth per row, and instants taken."""
        layout = self._layout
        made = Information(self._rows.factors(), self._counts.copy(), tuple(base.names[i] for i in layout.order))
        return made if layout.plain else made.selected(np.argsort(layout.order)), self._effective.copy(), self._seen


@dataclass(frozen=True, eq=False)
class _LiveLayout:
    """Columns of a live sample: `rows` and `columns` as `live_information` takes them, signal `index` of each extra one and its
    `pattern` (n, e); `order`: base columns in this order."""

    rows: Array
    columns: Array
    index: Array
    pattern: Array
    order: Array

    @property
    def plain(self) -> bool:
        """The columns come in the order of the base."""
        return bool(np.all(np.diff(self.order) == 1))

    @classmethod
    def of(cls, model: Model, base: BaseReduction) -> _LiveLayout | None:
        robot, keep = model.robot, base.independent
        drive, rigid_columns = robot.transmission, 10 * robot.tree.nb
        if robot.tree.floating:
            return None
        rows, columns, order = np.zeros((robot.n, robot.tree.nv)), [], []
        index: list[int] = []
        pattern: list[Array] = []
        for effect, part in zip(model.effects, model.slices, strict=True):
            at = np.flatnonzero((keep >= part.start) & (keep < part.stop))
            mine, to_measured = keep[at] - part.start, drive.torque_map(effect.side, drive.measured)
            if isinstance(effect, RigidBody):
                rows = to_measured @ robot.loop.W.T
                columns += mine.tolist()
            elif declares(effect) and isinstance(effect, JointEffect):
                columns += range(rigid_columns + len(index), rigid_columns + len(index) + len(at))
                joints, width = effect.at(robot), len(effect.symbols)
                index += [_signal(effect.factors[c % width], effect.side, joints[c // width], robot.n) for c in mine]
                pattern += [to_measured[:, joints[c // width]] for c in mine]
            else:
                return None
            order += at.tolist()
        wide = np.array(pattern).T if pattern else np.zeros((robot.n, 0))
        return cls(rows, np.array(columns, int), np.array(index, int), np.ascontiguousarray(wide), np.array(order, int))


def _signal(factor: Factor, side: Side, joint: int, n: int) -> int:
    """Place of a factor of one joint among the signals of a sample: one, then those of the joint side, then those of the motor side."""
    if factor == Factor.ONE:
        return 0
    return 1 + 4 * n * (side == Side.MOTOR) + n * _SIGNALS.index(factor) + joint

"""Inertia matrix and bias torque of the rigid body at a few states at a time, as fast as a single state can be had."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..errors import UnsupportedError
from ..regressor import rigid
from ..regressor.kernel_choice import kernel

if TYPE_CHECKING:
    import pinocchio as pin

    from ..robots.robot import Robot

Array = np.ndarray


class _Terms(Protocol):
    def terms(self, q: Array, dq: Array) -> tuple[Array, Array]: ...


class RigidDynamics:
    """`H(q)` and `h(q, dq)` of a robot's independent joints, gravity included, loop closure applied: τ = H ddq + h.

    `inertia` (10 nb,): linear parameters of all bodies; they need not be physical. Raises UnsupportedError for a free-flyer."""

    def __init__(self, robot: Robot, inertia: Array) -> None:
        require_fixed_base(robot)
        self._robot = robot
        self._trivial = robot.loop.is_trivial
        self._W = robot.loop.W
        #: Linear parameters (10 nb,) of all bodies.
        self.inertia = inertia = np.asarray(inertia, float)
        # One state in NumPy costs a thousand calls of it; without the compiled kernel Pinocchio is the faster way.
        self._tree: _Terms = rigid.dynamics(robot.tree, inertia) if kernel().compiled else PinocchioTerms(robot, inertia)

    def terms(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """`H` (B, n, n) and `h` (B, n) at states q, dq (B, n) of the independent joints."""
        if self._trivial:
            return self._tree.terms(q, dq)
        H, h = self._tree.terms(self._robot.tree_position(q), self._robot.tree_rate(dq))
        return self._W.T @ H @ self._W, h @ self._W


class PinocchioTerms:
    """The same of all tree joints through Pinocchio, state by state; `inertia` (10 nb,)."""

    def __init__(self, robot: Robot, inertia: Array) -> None:
        # Pinocchio divides the first moment by the mass. Bodies whose mass is too small for that get a point mass at
        # their frame, and the dynamics of those point masses alone, linear as they are, are subtracted again.
        bodies = np.asarray(inertia, float).reshape(-1, 10)
        self._upper = np.triu(np.ones((len(bodies), len(bodies)), bool))
        added = _ballast(bodies)
        loaded = bodies.copy()
        loaded[:, 0] += added
        self._systems = [(1.0, *_pinocchio(robot, loaded))]
        if added.any():
            ballast = np.zeros_like(bodies)
            ballast[:, 0] = added
            self._systems.append((-1.0, *_pinocchio(robot, ballast)))

    def terms(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Mass matrix (B, nv, nv) and bias (B, nv)."""
        import pinocchio as pin

        lanes, nv = q.shape
        H = np.zeros((lanes, nv, nv))
        h = np.zeros((lanes, nv))
        for sign, model, data in self._systems:
            for lane in range(lanes):
                H[lane] += sign * pin.crba(model, data, q[lane])
                h[lane] += sign * pin.nonLinearEffects(model, data, q[lane], dq[lane])
        # crba fills the upper triangle alone.
        return np.where(self._upper, H, np.swapaxes(H, 1, 2)), h


def require_fixed_base(robot: Robot) -> None:
    """Raise UnsupportedError for a robot on a free-flyer."""
    if robot.floating_base:
        raise UnsupportedError(
            f"robot {robot.name!r} has a floating base: simulation covers fixed-base robots;"
            " use regressor.rigid.forward_dynamics with the base's own motion."
        )


def _ballast(bodies: Array) -> Array:
    """Mass (nb,) to add to each body so that dividing its first moment by its mass loses no digits."""
    moment = np.linalg.norm(bodies[:, 1:4], axis=1)
    inertia = np.abs(bodies[:, 4:]).max(axis=1)
    mass = bodies[:, 0]
    enough = (mass > 0) & (moment**2 <= 10.0 * mass * np.maximum(inertia, 0.1 * moment))
    needed = ~enough & (np.abs(bodies).max(axis=1) > 0)
    return np.where(needed, 1.0 + moment - mass, 0.0)


def _pinocchio(robot: Robot, bodies: Array) -> tuple[pin.Model, pin.Data]:
    import pinocchio as pin

    model = robot.model.copy()
    for i, parameters in enumerate(bodies):
        model.inertias[i + 1] = pin.Inertia.FromDynamicParameters(parameters) if parameters.any() else pin.Inertia.Zero()
    return model, model.createData()

"""Rigid-body dynamics over arrays of samples: torque regressor, inverse and forward dynamics of any tree of joints.

Every function takes a `RigidBodyTree` and arrays whose first axis is the sample. Conventions are Pinocchio's: inertial
parameters per body `m mx my mz Ixx Ixy Iyy Ixz Iyz Izz` about the joint frame's origin; a free-flyer's velocity is linear then
angular, in the body's frame, its position is x y z and the quaternion x y z w. The parameters need not be physical: nothing
divides by a mass. Input that is not finite is refused with DataError, a wrong shape with ConfigurationError.

The compiled kernel does the work where it was built, NumPy elsewhere, with the same numbers; IDENT_KERNEL=native or numpy
chooses. `threads` (default: IDENT_NUM_THREADS, else all processors) counts for the compiled kernel only; results are the same for
the same number of threads, and differ by round-off for another."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ..robots.tree import RigidBodyTree
from .checked import added_inertia, inertia_of, states
from .drive_terms import DriveTerms
from .kernel_choice import kernel

Array = np.ndarray


def regressor(tree: RigidBodyTree, q: Any, dq: Any, ddq: Any, *, threads: int | None = None) -> Array:
    """Joint torque regressor: tau = regressor @ inertia, gravity included.

    Parameters
    ----------
    tree : RigidBodyTree
        The kinematic tree, `robot.tree`.
    q : array (N, nq)
        Positions, rad or m.
    dq, ddq : array (N, nv)
        Velocities and accelerations, rad/s, m/s and their rates.
    threads : int, optional
        Of the compiled kernel.

    Returns
    -------
    array (N, nv, 10 nb)
        Ten columns per moving body, in Pinocchio's order.

    Raises
    ------
    ConfigurationError, DataError
        A wrong shape; numbers that are not finite.

    Examples
    --------
    >>> import ident, numpy as np
    >>> robot = ident.load_robot("scara")
    >>> q = np.zeros((3, robot.n))
    >>> ident.regressor.regressor(robot.tree, q, q, q).shape
    (3, 4, 40)
    """
    q, dq, ddq = states(tree, q, dq=dq, ddq=ddq)
    return kernel().dynamics.regressor(tree, q, dq, ddq, threads)


def inverse_dynamics(tree: RigidBodyTree, inertia: Any, q: Any, dq: Any, ddq: Any, *, threads: int | None = None) -> Array:
    """Joint torque of a motion.

    Parameters
    ----------
    tree : RigidBodyTree
        The kinematic tree, `robot.tree`.
    inertia : array (10 nb,)
        Inertial parameters in Pinocchio's order; they need not be physical.
    q : array (N, nq)
        Positions, rad or m.
    dq, ddq : array (N, nv)
        Velocities and accelerations.
    threads : int, optional
        Of the compiled kernel.

    Returns
    -------
    array (N, nv)
        Torque, N m or N.

    Examples
    --------
    >>> import ident, numpy as np
    >>> robot = ident.load_robot("scara")
    >>> q = np.zeros((3, robot.n))
    >>> ident.regressor.inverse_dynamics(robot.tree, robot.nominal, q, q, q)[0].round(2).tolist()
    [0.0, 0.0, 39.24, 0.0]
    """
    q, dq, ddq = states(tree, q, dq=dq, ddq=ddq)
    return kernel().dynamics.inverse_dynamics(tree, inertia_of(tree, inertia), q, dq, ddq, threads)


def mass_matrix(tree: RigidBodyTree, inertia: Any, q: Any, *, threads: int | None = None) -> Array:
    """Joint-space mass matrix.

    Parameters
    ----------
    tree : RigidBodyTree
        The kinematic tree, `robot.tree`.
    inertia : array (10 nb,)
        Inertial parameters in Pinocchio's order.
    q : array (N, nq)
        Positions, rad or m.
    threads : int, optional
        Of the compiled kernel.

    Returns
    -------
    array (N, nv, nv)
        Symmetric; not positive definite where the parameters are not physical.

    Examples
    --------
    >>> import ident, numpy as np
    >>> robot = ident.load_robot("scara")
    >>> q = np.zeros((3, robot.n))
    >>> ident.regressor.mass_matrix(robot.tree, robot.nominal, q).shape
    (3, 4, 4)
    """
    (q,) = states(tree, q)
    return kernel().dynamics.mass_matrix(tree, inertia_of(tree, inertia), q, threads)


def bias_torque(tree: RigidBodyTree, inertia: Any, q: Any, dq: Any, *, threads: int | None = None) -> Array:
    """Coriolis, centrifugal and gravity torque: the torque at zero acceleration.

    Parameters
    ----------
    tree : RigidBodyTree
        The kinematic tree, `robot.tree`.
    inertia : array (10 nb,)
        Inertial parameters in Pinocchio's order.
    q : array (N, nq)
        Positions, rad or m.
    dq : array (N, nv)
        Velocities.
    threads : int, optional
        Of the compiled kernel.

    Returns
    -------
    array (N, nv)
        Torque, N m or N.

    Examples
    --------
    >>> import ident, numpy as np
    >>> robot = ident.load_robot("scara")
    >>> q = np.zeros((3, robot.n))
    >>> ident.regressor.bias_torque(robot.tree, robot.nominal, q, q)[0].round(2).tolist()
    [0.0, 0.0, 39.24, 0.0]
    """
    q, dq = states(tree, q, dq=dq)
    return kernel().dynamics.bias_torque(tree, inertia_of(tree, inertia), q, dq, threads)


def terms(tree: RigidBodyTree, inertia: Any, q: Any, dq: Any) -> tuple[Array, Array]:
    """`mass_matrix` and `bias_torque` together, in one pass."""
    q, dq = states(tree, q, dq=dq)
    return dynamics(tree, inertia).terms(q, dq)


def forward_dynamics(
    tree: RigidBodyTree, inertia: Any, q: Any, dq: Any, tau: Any, added: Any = None, *, threads: int | None = None
) -> Array:
    """Joint acceleration from (M(q) + added) ddq = tau - bias(q, dq).

    Parameters
    ----------
    tree : RigidBodyTree
        The kinematic tree, `robot.tree`.
    inertia : array (10 nb,)
        Inertial parameters in Pinocchio's order.
    q : array (N, nq)
        Positions, rad or m.
    dq, tau : array (N, nv)
        Velocities, and joint torques in N m or N.
    added : array (nv, nv), optional
        Constant symmetric matrix that is added to the mass matrix, such as the reflected rotor inertia K^-T R K^-1.
    threads : int, optional
        Of the compiled kernel.

    Returns
    -------
    array (N, nv)

    Raises
    ------
    DataError
        A singular matrix.

    Examples
    --------
    >>> import ident, numpy as np
    >>> robot = ident.load_robot("scara")
    >>> q = np.zeros((3, robot.n))
    >>> ident.regressor.forward_dynamics(robot.tree, robot.nominal, q, q, q)[0].round(2).tolist()
    [0.0, 0.0, -9.81, 0.0]
    """
    q, dq, tau = states(tree, q, dq=dq, tau=tau)
    return kernel().dynamics.forward_dynamics(tree, inertia_of(tree, inertia), q, dq, tau, added_inertia(tree, added), threads)


class Dynamics(Protocol):
    """Dynamics with fixed parameters, for integrators: one state (1-D arrays) or a batch of N."""

    def forward(self, q: Array, dq: Array, tau: Array, threads: int = 1) -> Array:
        """Acceleration (nv,) or (N, nv)."""

    def terms(self, q: Array, dq: Array, threads: int = 1) -> tuple[Array, Array]:
        """Mass matrix (nv, nv) or (N, nv, nv), without `added`, and bias torque (nv,) or (N, nv)."""


def dynamics(tree: RigidBodyTree, inertia: Any, added: Any = None) -> Dynamics:
    """Dynamics of a tree with fixed parameters: checked once here, then as little as possible around each call.

    `inertia` (10 nb,), `added` (nv, nv) as in `forward_dynamics`. States that are not finite raise DataError."""
    made: Dynamics = kernel().dynamics.fixed_dynamics(tree, inertia_of(tree, inertia), added_inertia(tree, added))
    return made


class Drive(Protocol):
    """A robot with the terms of its drives, parameters fixed, for control: one state (1-D arrays) or a batch of N."""

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torque (nv,) or (N, nv) of a motion."""

    def acceleration(self, q: Array, dq: Array, tau: Array) -> Array:
        """Acceleration (nv,) or (N, nv) at a torque."""


def drive(tree: RigidBodyTree, inertia: Any, terms: DriveTerms) -> Drive:
    """A fixed-base tree with `inertia` (10 nb,) and the terms of its drives: checked once, then as little as possible around each call."""
    made: Drive = kernel().drive.fixed_drive(tree, inertia_of(tree, inertia), terms)
    return made
